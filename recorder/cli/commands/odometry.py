"""Run a LiDAR odometry over a bag, and write its trajectory.

Examples:
  carlaloc odometry data/Town03/ClearNoon_dynamic/ClearNoon_dynamic.bag --out estimate.tum
  carlaloc odometry data/Town03/ClearNoon_dynamic/ClearNoon_dynamic.bag --lidar rear --out estimate.tum
  carlaloc odometry run.bag --method gicp --topic /velodyne_points --out gicp.tum
  carlaloc odometry run_0.mcap --time-field t --time-unit us --out estimate.tum
"""

import argparse
from typing import Any

from recorder.cli.arguments import OutputFile, force_option, input_path
from recorder.cli.progress import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc odometry`."""
    parser.add_argument("bag", type=input_path, help="bag with point clouds: .bag, .mcap, .db3, or a folder")
    parser.add_argument("--out", type=OutputFile(".tum", ".txt"), required=True, help="TUM file to write")
    parser.add_argument("--method", default="kiss_icp", help="kiss_icp, genz_icp or gicp (default: kiss_icp)")
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument(
        "--topic",
        help="topic of the clouds, or TOPIC:FRAME where sensors share it (default: that of the dataset's "
        "first LiDAR; in other bags /lidar/points, else the only one that looks like a LiDAR's)",
    )
    chosen.add_argument("--lidar", metavar="NAME", help="LiDAR of the bag's dataset, by its name in the rig")
    parser.add_argument(
        "--time-field", metavar="NAME", help="field with the times of points, or none (default: by its name)"
    )
    parser.add_argument(
        "--time-unit", choices=("s", "ms", "us", "ns"), help="unit of that field (default: by its values)"
    )
    force_option(parser, "an older trajectory")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run the method."""
    from recorder.dataset.scans import ScanTimes
    from recorder.evaluation.trajectory_files import write_tum
    from recorder.slam.bag_odometry import clouds_of, run_odometry, system_of_bags

    system_of_bags(arguments.method)
    lidar, topic = clouds_of(arguments.bag, arguments.lidar, arguments.topic)
    times = ScanTimes(field=arguments.time_field, unit=arguments.time_unit)
    with Progress(arguments.method, unit="scans") as progress:
        trajectory = run_odometry(arguments.bag, arguments.method, topic, progress.update, times=times)
    path = write_tum(arguments.out, trajectory)
    return {
        "out": str(path),
        "method": arguments.method,
        "topic": topic,
        "lidar": lidar,
        "poses": len(trajectory),
        "duration_s": trajectory.duration_s,
        "length_m": trajectory.length_m,
    }


def show(result: dict[str, Any]) -> None:
    """Print what was estimated."""
    print(
        f"{result['out']}  {result['poses']} poses, {result['duration_s']:.1f} s, {result['length_m']:.1f} m"
    )
    name = f" of LiDAR {result['lidar']}" if result["lidar"] else ""
    print(f"read: {result['topic']}{name}")
