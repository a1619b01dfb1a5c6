#!/bin/sh
# ros1_play.sh BAG OUT_BAG ODOMETRY_TOPIC "REMAPS" COMMAND...
# Plays a bag to a ROS 1 node at half speed and records its odometry: roscore, node, rosbag record, rosbag play.
set -e
bag=$1 out=$2 topic=$3 remaps=$4
shift 4
roscore & core=$!
trap 'kill -INT $node $record $core 2>/dev/null; wait' EXIT
until rosparam set use_sim_time true 2>/dev/null; do sleep 0.2; done
"$@" & node=$!
rosbag record --quiet -O "$out" "$topic" & record=$!
sleep 5
# REMAPS stands without quotes: it is words.
rosbag play --quiet --clock -r 0.5 "$bag" $remaps
sleep 3
kill -INT $record
wait $record || true
