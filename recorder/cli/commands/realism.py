"""Compare a recording with real ones: its LiDAR, pictures and IMU beside the ranges of real sensors.

Examples:
  carlaloc realism data/Town03/ClearNoon_dynamic/ClearNoon_dynamic.bag
  carlaloc realism run_0.mcap --lidar /velodyne_points --json
  carlaloc realism pictures/
"""

import argparse
from dataclasses import asdict
from typing import Any

from recorder.cli.arguments import input_path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc realism`."""
    text = "bag (.bag, .mcap, .db3, or a folder), or a folder of PNG or JPEG files"
    parser.add_argument("recording", type=input_path, help=text)
    parser.add_argument("--lidar", metavar="TOPIC", help="topic of the clouds (default: that of the LiDAR)")
    parser.add_argument(
        "--camera", metavar="TOPIC", help="topic of the pictures (default: the first by name)"
    )
    parser.add_argument("--imu", metavar="TOPIC", help="topic of the IMU (default: the first by name)")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure."""
    from recorder.verification.realism import measure_realism

    result = measure_realism(
        arguments.recording, lidar=arguments.lidar, camera=arguments.camera, imu=arguments.imu
    )
    metrics = [{**asdict(metric), "verdict": metric.verdict} for metric in result.metrics]
    judged = [metric["verdict"] for metric in metrics if metric["verdict"]]
    return {
        "recording": str(result.path),
        "read": result.read,
        "metrics": metrics,
        "inside": judged.count("inside"),
        "judged": len(judged),
    }


def show(result: dict[str, Any]) -> None:
    """Print each group's metrics, and the sources of its ranges."""
    for group, read in result["read"].items():
        print(f"{group}: {read}")
        mine = [metric for metric in result["metrics"] if metric["group"] == group]
        measured = [metric for metric in mine if metric["value"] == metric["value"]]
        for metric in measured:
            real = "" if metric["low"] is None else f"real {metric['low']:g} to {metric['high']:g}"
            print(f"  {metric['name']:40} {metric['value']:10.3f}  {real:22} {metric['verdict']}".rstrip())
        if len(measured) < len(mine):
            print(f"  {len(mine) - len(measured)} further metrics cannot be measured here")
        if judged := [metric["verdict"] for metric in mine if metric["verdict"]]:
            print(f"  {judged.count('inside')} of {len(judged)} inside")
        for source in dict.fromkeys(metric["source"] for metric in measured if metric["source"]):
            print(f"  real: {source}")
