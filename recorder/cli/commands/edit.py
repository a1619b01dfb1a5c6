"""Make new episodes of recorded ones: the same drive among other traffic.

Examples:
  carlaloc edit traffic drive.mcap --seed 8 --out other.mcap
"""

import argparse
from dataclasses import asdict
from typing import Any

from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX
from recorder.cli.arguments import OutputFile, force_option, input_path, seed, shared_options
from recorder.cli.progress import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Sub-commands of `carlaloc edit`."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    shared = [shared_options(nested=True)]
    traffic = actions.add_parser("traffic", parents=shared, help="the same drive among other traffic")
    traffic.add_argument("--seed", type=seed, required=True, help="seed of the new traffic")
    traffic.add_argument("--map", help="map of the drive, where the episode names none that is known")
    traffic.add_argument("episode", type=input_path, help="episode (.mcap)")
    traffic.add_argument("--out", type=OutputFile(EPISODE_SUFFIX), required=True, help="new episode")
    force_option(traffic, "an older episode of this name")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Simulate the traffic anew."""
    from recorder.drive.change_traffic import change_traffic
    from recorder.episode.episode import Episode
    from recorder.episode.summary import summarise

    with Progress("traffic") as progress:
        changed = change_traffic(
            arguments.episode, arguments.out, arguments.seed, map=arguments.map, overwrite=arguments.force,
            progress=progress.update,
        )  # fmt: skip
    return {**asdict(summarise(Episode.load(arguments.out))), "touching_s": changed.touching_s}


def show(result: dict[str, Any]) -> None:
    """Print the figures of the new episode."""
    print(
        f"{result['path']}: {result['duration_s']:.1f} s, {result['driven_m']:.1f} m driven, "
        f"{result['vehicles']} vehicles, {result['walkers']} walkers"
    )
    if result["touching_s"]:
        print(f"  another box overlaps the ego's for {result['touching_s']:.2f} s; try another seed")
