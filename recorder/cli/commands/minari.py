"""Make a Minari data set of recorded drives: observations of any rig, the driver's actions, rewards.

Examples:
  carlaloc minari drive.mcap --out sets/town01-scripted-v0
  carlaloc minari day/*.mcap --out sets/town01-seen-v0 --rig bev --frame-skip 4
"""

import argparse
from dataclasses import asdict
from typing import Any

from recorder.cli.arguments import OutputFolder, config_of, input_path, option, positive_int
from recorder.cli.progress import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc minari`."""
    parser.add_argument("episodes", type=input_path, nargs="+", help="recorded drives (.mcap)")
    parser.add_argument(
        "--out", type=OutputFolder(), required=True, help="folder of the data set, named as it: town01-v0"
    )
    parser.add_argument("--rig", default="state", help="state, bev, a rig or a .yaml file (default: state)")
    parser.add_argument("--action", default="continuous", help="continuous or controls (default: continuous)")
    parser.add_argument("--weather", default="ClearNoon", help="weather for the sensors (default: ClearNoon)")
    parser.add_argument("--quality", default="medium", help="low, medium or high")
    option(parser, "--frame-skip", positive_int, "N", "steps of 50 ms per action (default: 1)", 1)
    parser.add_argument("--map", help="map of the drives, where they name none that is known")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write the data set."""
    from recorder.minari.dataset import MinariConfig, write_minari

    config = config_of(MinariConfig, arguments, episodes=tuple(arguments.episodes))
    with Progress("observing") as progress:
        return asdict(write_minari(config, progress.update))


def show(result: dict[str, Any]) -> None:
    """Print what was written."""
    print(f"{result['path']}  {result['episodes']} episodes, {result['steps']} steps")
