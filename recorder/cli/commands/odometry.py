"""Run a LiDAR odometry over a bag, and write its trajectory.

Examples:
  carlaloc odometry data/Town03/ClearNoon_dynamic/ClearNoon_dynamic.bag --out estimate.tum
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
    parser.add_argument(
        "--topic",
        help="topic of the clouds, or TOPIC:FRAME where sensors share it (default: /lidar/points, else the "
        "only one that looks like a LiDAR's)",
    )
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
    from recorder.slam.bag_odometry import run_odometry

    times = ScanTimes(field=arguments.time_field, unit=arguments.time_unit)
    with Progress(arguments.method, unit="scans") as progress:
        trajectory = run_odometry(
            arguments.bag, arguments.method, arguments.topic, progress.update, times=times
        )
    path = write_tum(arguments.out, trajectory)
    return {
        "out": str(path),
        "method": arguments.method,
        "poses": len(trajectory),
        "duration_s": trajectory.duration_s,
        "length_m": trajectory.length_m,
    }


def show(result: dict[str, Any]) -> None:
    """Print what was estimated."""
    print(
        f"{result['out']}  {result['poses']} poses, {result['duration_s']:.1f} s, {result['length_m']:.1f} m"
    )
