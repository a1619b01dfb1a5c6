"""Write docs/topics.md from the topic profiles: `python docs/scripts/make_topics.py`."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.rigs.presets import paper_rig
from carlaloc_env.rigs.rig import Rig, SensorRig
from carlaloc_env.samples import (
    DepthImage,
    Events,
    GnssFix,
    Image,
    Imu,
    ObjectList,
    Odometry,
    PointCloud,
    RadarScan,
    Sample,
    SemanticImage,
    Speed,
    WheelTicks,
)
from recorder.writers.ros.messages import ENCODERS
from recorder.writers.topic_profiles import PROFILES
from recorder.writers.topics import TopicProfile

PAGE = Path(__file__).parents[1] / "topics.md"
HEAD = """\
# Topics of ROS bags

`docs/scripts/make_topics.py` writes this page from `recorder/writers/topics.py`; change that file, not this
page.

`carlaloc replay … --topics PROFILE` chooses one of the profiles below: `standard`, `slam`, `paper`,
`paper_seg`, `full`, `compact` or `compact_full`. The table is for the rig `paper`, without its right camera
and its radars `left` and `right`. Topics of other sensors have the same pattern: a camera named `rear` writes
`/camera/rear/image_raw`, a LiDAR named `roof` writes `/roof/points`. [Conventions](conventions.md) has the
frames.
"""
TAIL = """\
## Messages in detail

* Stamps are the time of measurement; the drive's time 0 is 2023-01-01T00:00:00Z (`epoch_ns` in
  `sequence.yaml`). The stamp of a point cloud is the start of its sweep.
* `points`: `x y z intensity` float32, `ring` uint16, `time` float32 in seconds after the header's stamp.
  The offsets are those of velodyne_pointcloud's XYZIRT (0, 4, 8, 12, 16, 18; 22 bytes). `is_dense` is true,
  since rays without a return are left out.
* `points_labelled`: the same, then `label` uint8 (semantic tag, 29: a flake) and `id` uint32 (instance).
* `radar_points`: `x y z` [m], `doppler` [m/s], `snr` [dB], `rcs` [dBsm], `range` [m], `azimuth`,
  `elevation` [rad], float32; then the truth: `label` uint8, `id` uint32, `origin` uint8 (0 an object, 1 its
  mirror image, 2 clutter). `radar_scan`: radar_msgs/RadarScan; the amplitude is the signal-to-noise ratio.
  Doppler is **positive when the distance grows**: an object at rest ahead of a car that drives at 10 m/s
  reads −10 m/s.
* `image_32fc1`: planar depth in metres by [REP 118](https://ros.org/reps/rep-0118.html): +Inf for the sky
  and beyond the range, NaN where nothing is measured ([REP 117](https://ros.org/reps/rep-0117.html)). Our
  cameras measure every pixel. `depth_png`, and files that are no bags, have 0 in both cases. `image_tags`:
  semantic tags as `mono8`.
* `camera_info`: `plumb_bob` with five zeros; R is the identity, P = [K 0].
* `imu`: covariances are those of the white noise in one message, the density squared times the rate; the
  densities are those of the calibration files. An IMU without an attitude has `orientation_covariance[0]` =
  −1. The topic is that of [REP 145](https://ros.org/reps/rep-0145.html); start the filters of imu_tools with
  `imu/data_raw:=/imu/data`.
* `wheel_joints` (rig `flu`, `/wheels/joint_states`): sensor_msgs/JointState, angles of whole ticks [rad]
  and spins [rad/s] of `wheel_front_left`, `wheel_front_right`, `wheel_rear_left`, `wheel_rear_right`.
* `odometry`: header frame `map`, child frame `base_link`; the twist is in the child frame.
* `acceleration`: geometry_msgs/AccelStamped of `base_link` in its own axes, gravity not included.
* `objects`: derived_object_msgs/ObjectArray, the type of CARLA's ROS bridge; boxes (`shape`), attitude,
  velocity in world axes, class, for every actor, seen or not. `object_table`: the same as a
  sensor_msgs/PointCloud with a point per actor and a channel per column. It adds `visible` (share not hidden
  behind other objects, NaN beyond 120 m) and the semantic tag. The `id` of both is that of `points_labelled`,
  `radar_points` and `image_instances`.
* `/tf_static` is latched and holds one transform from `base_link` to each sensor.

## Poses and the clock

* `--truth-tf` adds `/tf` to any profile: the true pose `map` → `base_link`, 200 Hz. With it and
  `/tf_static`, viewers such as Foxglove, RViz and rerun show sensors in the world: choose `map` as the
  fixed frame. It is off by default, since SLAM systems publish their own `/tf`, and a frame has only one
  parent. `paper` and `paper_seg` have no `/tf_static`.
* Frames are those of [REP 105](https://ros.org/reps/rep-0105.html). `map` is our `world`: east, north, up.
  There is no `odom`, since the truth does not drift. Units and axes are those of
  [REP 103](https://ros.org/reps/rep-0103.html): cameras have optical axes, though their frames' names do not
  end in `_optical`.
* Bags have no `/clock`. `ros2 bag play --clock 100 BAG` and `rosbag play --clock BAG` make it, for nodes
  with `use_sim_time`. With two clocks, time jumps. `--clock` writes it into the bag, 100 Hz.

## Topics, messages and sensors of your own

* `--topics <file>.py:<profile>` takes a `TopicProfile` of your file. The file may add functions to
  `ENCODERS`; `definitions` of the profile are new message types.
* `kind: my_sensors:SonarConfig` in a rig's file takes a class of your module.
* Every worker of a replay imports them. [An example](../examples/06_extend.py) has all of it in 60 lines.
* Modules are searched in `PYTHONPATH`, in the folder of work and in that of the topics' file. Workers of a
  Dask cluster need the sensors' folder in `PYTHONPATH`.
* Sensors with a `layout` have their driver's message beside these, in the profiles `standard`, `full` and
  `slam`: [LiDARs](lidars.md#messages-of-drivers).
"""
ALIKE = ("/camera/right/", "/radar/left/", "/radar/right/")
"""Topics of sensors like others."""
_KINDS: tuple[tuple[str, type[Sample]], ...] = (
    ("rgb_", Image),
    ("depth_", DepthImage),
    ("semantic_", SemanticImage),
    ("events_", Events),
)
_KIND_OF_SENSOR: dict[str, type[Sample]] = {
    "lidar": PointCloud,
    "radar": RadarScan,
    "imu": Imu,
    "gnss": GnssFix,
    "speed": Speed,
    "wheels": WheelTicks,
}


def page() -> str:
    """Text of the page."""
    return "\n".join([HEAD, _table(), TAIL])


def streams_of(config: SensorRig) -> Iterator[tuple[str, type[Sample], str, float]]:
    """Stream, kind of sample, frame and rate [Hz] of everything a replay writes."""
    world: Any = SimpleNamespace(seed=0, geo=GeoReference(latitude_deg=0.0, longitude_deg=0.0))
    for sensor in Rig(config, world).sensors:
        for stream in sensor.streams():
            pictures = (kind for start, kind in _KINDS if stream.startswith(start))
            kind = _KIND_OF_SENSOR.get(sensor.config.kind) or next(pictures)
            yield stream, kind, sensor.config.frame_id, sensor.config.rate_hz
    yield "truth", Odometry, "base_link", 200.0
    yield "objects", ObjectList, "map", 20.0


def rows_of(profile: TopicProfile) -> list[tuple[str, str, str, str, float]]:
    """Topic, message type, frame, stream and rate [Hz] of a profile with the paper's rig."""
    listed = list(streams_of(paper_rig()))
    names = [stream for stream, *_ in listed]
    return [
        (
            route.topic,
            f"{ENCODERS[route.message][0].replace('/msg/', '/')} (`{route.message}`)",
            route.frame_id or ("map → base_link" if kind is Odometry else frame),
            stream,
            rate_hz,
        )
        for stream, kind, frame, rate_hz in listed
        for route in profile.routes(kind, stream, names)
    ]


def _table() -> str:
    """All topics with the profiles that hold them."""
    holders: dict[str, list[str]] = {}
    for profile in PROFILES.values():
        for topic, message, frame, stream, rate_hz in rows_of(profile):
            row = f"| `{topic}` | {message} | `{frame}` | `{stream}` | {rate_hz:g} |"
            if not topic.startswith(ALIKE):
                holders.setdefault(row, []).append(profile.name)
    row = "| `/tf_static` | tf2_msgs/TFMessage | `base_link` | – | once |"
    holders[row] = [profile.name for profile in PROFILES.values() if profile.tf_static]
    head = ["| topic | message | frame | stream | Hz | profiles |", "|---|---|---|---|---|---|"]
    rows = [f"{row} {', '.join(names)} |" for row, names in sorted(holders.items())]
    return "\n".join(["## Profiles\n", *head, *rows, ""])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
