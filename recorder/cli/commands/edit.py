"""Make new episodes of recorded ones: cut, join, drop or thin actors, other traffic.

Examples:
  carlaloc edit cut drive.mcap --start 10 --end 70 --out part.mcap
  carlaloc edit join part1.mcap part2.mcap --out whole.mcap
  carlaloc edit actors drive.mcap --drop walkers,bus --out without.mcap
  carlaloc edit actors drive.mcap --keep 0.5 --out half.mcap
  carlaloc edit traffic drive.mcap --seed 8 --out other.mcap
"""

import argparse
from dataclasses import asdict
from typing import Any

from carlaloc_env.core.errors import UsageError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX
from recorder.cli.arguments import OutputFile, force_option, input_path, option, seed, shared_options
from recorder.cli.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Sub-commands of `carlaloc edit`."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    shared = [shared_options(nested=True)]
    cut = actions.add_parser("cut", parents=shared, help="a stretch of a drive as a drive of its own")
    option(cut, "--start", float, "S", "where it begins [s]", 0.0)
    cut.add_argument("--end", type=float, required=True, metavar="S", help="where it ends [s]")
    join = actions.add_parser("join", parents=shared, help="two drives as one, at a standstill")
    actors = actions.add_parser("actors", parents=shared, help="the same drive with fewer others")
    actors.add_argument("--drop", help="all, vehicles, walkers, models or ids, with commas between them")
    option(actors, "--keep", float, "FRACTION", "fraction of the others that stays")
    traffic = actions.add_parser("traffic", parents=shared, help="the same drive among other traffic")
    traffic.add_argument("--seed", type=seed, required=True, help="seed of the new traffic")
    traffic.add_argument("--map", help="map of the drive, where the episode names none that is known")
    for action in (cut, join, actors, traffic):
        action.add_argument("episode", type=input_path, help="episode (.mcap)")
        if action is join:
            action.add_argument("second", type=input_path, help="episode that follows")
        action.add_argument("--out", type=OutputFile(EPISODE_SUFFIX), required=True, help="new episode")
        force_option(action, "an older episode of this name")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Edit."""
    from recorder.episode.edit import cut_episode, drop_actors, join_episodes, thin_actors
    from recorder.episode.episode import Episode
    from recorder.episode.summary import summarise

    action, source, out, overwrite = arguments.action, arguments.episode, arguments.out, arguments.force
    extra = {}
    if action == "cut":
        cut_episode(source, out, arguments.start, arguments.end, overwrite=overwrite)
    elif action == "join":
        join_episodes(source, arguments.second, out, overwrite=overwrite)
    elif action == "traffic":
        from recorder.drive.resimulate import change_traffic

        with Progress("traffic") as progress:
            changed = change_traffic(
                source, out, arguments.seed, map=arguments.map, overwrite=overwrite, progress=progress.update
            )
        extra["touching_s"] = changed.touching_s
    elif (arguments.drop is None) == (arguments.keep is None):
        raise UsageError("give either --drop or --keep, e.g. --drop walkers")
    elif arguments.drop is not None:
        drop_actors(source, out, [name.strip() for name in arguments.drop.split(",")], overwrite=overwrite)
    else:
        thin_actors(source, out, arguments.keep, overwrite=overwrite)
    return {**asdict(summarise(Episode.load(out))), **extra}


def show(result: dict[str, Any]) -> None:
    """Print what came out."""
    print(
        f"{result['path']}: {result['duration_s']:.1f} s, {result['driven_m']:.1f} m driven, "
        f"{result['vehicles']} vehicles, {result['walkers']} walkers"
    )
    if result.get("touching_s"):
        print(f"  another box overlaps the ego's for {result['touching_s']:.2f} s; try another seed")
