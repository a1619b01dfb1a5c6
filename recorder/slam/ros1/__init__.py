"""ROS 1 nodes as systems: fed in lock-step by a player that runs under the system's Python."""
