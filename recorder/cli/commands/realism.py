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
    figures = [{**asdict(figure), "verdict": figure.verdict} for figure in result.figures]
    judged = [figure["verdict"] for figure in figures if figure["verdict"]]
    return {
        "recording": str(result.path),
        "read": result.read,
        "figures": figures,
        "inside": judged.count("inside"),
        "judged": len(judged),
    }


def show(result: dict[str, Any]) -> None:
    """Print each group's figures, and the sources of its ranges."""
    for group, read in result["read"].items():
        print(f"{group}: {read}")
        mine = [figure for figure in result["figures"] if figure["group"] == group]
        known = [figure for figure in mine if figure["value"] == figure["value"]]
        for figure in known:
            real = "" if figure["low"] is None else f"real {figure['low']:g} to {figure['high']:g}"
            print(f"  {figure['name']:40} {figure['value']:10.3f}  {real:22} {figure['verdict']}".rstrip())
        if len(known) < len(mine):
            print(f"  {len(mine) - len(known)} further figures cannot be measured here")
        if judged := [figure["verdict"] for figure in mine if figure["verdict"]]:
            print(f"  {judged.count('inside')} of {len(judged)} inside")
        for source in dict.fromkeys(figure["source"] for figure in known if figure["source"]):
            print(f"  real: {source}")
