"""Make new episodes of recorded ones: cut, join, drop or thin actors, other traffic.

Examples:
  carlaloc edit cut drive.mcap --start 10 --end 70 --out part.mcap
  carlaloc edit join part1.mcap part2.mcap --out whole.mcap
  carlaloc edit actors drive.mcap --drop walkers,bus --out without.mcap
  carlaloc edit actors drive.mcap --keep 0.5 --out half.mcap
  carlaloc edit traffic drive.mcap --seed 8 --out other.mcap
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import UsageError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX
from recorder.cli.arguments import OutputFile, force_option, input_path, seed, shared_options
from recorder.cli.progress import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Sub-commands of `carlaloc edit`."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    shared = [shared_options(nested=True)]
    cut = actions.add_parser("cut", parents=shared, help="a stretch of a drive as a drive of its own")
    cut.add_argument("--start", type=float, default=0.0, metavar="S", help="where it begins [s]")
    cut.add_argument("--end", type=float, required=True, metavar="S", help="where it ends [s]")
    join = actions.add_parser("join", parents=shared, help="two drives as one, at a standstill")
    actors = actions.add_parser("actors", parents=shared, help="the same drive with fewer others")
    actors.add_argument("--drop", help="all, vehicles, walkers, models or ids, with commas between them")
    actors.add_argument("--keep", type=float, metavar="FRACTION", help="fraction of the others that stays")
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
    from recorder.episode.episode import Episode
    from recorder.episode.summary import summarise

    extra = {"cut": _cut, "join": _join, "actors": _actors, "traffic": _traffic}[arguments.action](arguments)
    return {**asdict(summarise(Episode.load(arguments.out))), **extra}


def show(result: dict[str, Any]) -> None:
    """Print what came out."""
    print(
        f"{result['path']}: {result['duration_s']:.1f} s, {result['driven_m']:.1f} m driven, "
        f"{result['vehicles']} vehicles, {result['walkers']} walkers"
    )
    if result.get("touching_s"):
        print(f"  another box overlaps the ego's for {result['touching_s']:.2f} s; try another seed")


def _cut(arguments: argparse.Namespace) -> dict[str, Any]:
    from recorder.episode.edit import cut_episode

    span = (arguments.start, arguments.end)
    cut_episode(arguments.episode, arguments.out, *span, overwrite=arguments.force)
    return {}


def _join(arguments: argparse.Namespace) -> dict[str, Any]:
    from recorder.episode.edit import join_episodes

    join_episodes(arguments.episode, arguments.second, arguments.out, overwrite=arguments.force)
    return {}


def _actors(arguments: argparse.Namespace) -> dict[str, Any]:
    from recorder.episode.edit import drop_actors, thin_actors

    if (arguments.drop is None) == (arguments.keep is None):
        raise UsageError("give either --drop or --keep, e.g. --drop walkers")
    if arguments.drop is not None:
        names = [name.strip() for name in arguments.drop.split(",")]
        drop_actors(arguments.episode, arguments.out, names, overwrite=arguments.force)
    else:
        thin_actors(arguments.episode, arguments.out, arguments.keep, overwrite=arguments.force)
    return {}


def _traffic(arguments: argparse.Namespace) -> dict[str, Any]:
    from recorder.drive.resimulate_traffic import change_traffic

    with Progress("traffic") as progress:

        def told(done: int, total: int) -> None:
            progress.update(done * STEP_NS * 1e-9, total * STEP_NS * 1e-9)

        result = change_traffic(
            arguments.episode,
            arguments.out,
            arguments.seed,
            map=arguments.map,
            overwrite=arguments.force,
            progress=told,
        )
    return {"touching_s": result.touching_s}
