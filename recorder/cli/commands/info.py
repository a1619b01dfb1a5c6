"""Summarise an episode (length, loop, actors, collisions, device, health) or a sequence's movers.

Examples:
  carlaloc info drive.mcap
  carlaloc info data/Town03/ClearNoon_dynamic
  carlaloc info --repair drive.mcap.recording
  carlaloc info --repair drive.mcap.recording --out whole.mcap
"""

import argparse
from dataclasses import asdict
from typing import Any

from carlaloc_env.core.errors import UsageError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX
from recorder.cli.arguments import OutputFile, force_option, input_path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc info`."""
    parser.add_argument("episode", type=input_path, help="episode (.mcap), or a sequence's folder")
    parser.add_argument("--repair", action="store_true", help="make a whole file of a cut-off recording")
    parser.add_argument(
        "--out",
        type=OutputFile(EPISODE_SUFFIX),
        help="path of the whole file (default: beside the recording)",
    )
    force_option(parser, "an older episode of that name")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Look at an episode or a sequence, or repair an episode."""
    if arguments.out is not None and not arguments.repair:
        raise UsageError("--out is for --repair; add it")
    from recorder.dataset.layout import is_sequence, sequence_at

    if arguments.episode.is_dir() or is_sequence(arguments.episode):
        if arguments.repair:
            raise UsageError("--repair is for recordings of drives; replay a broken sequence anew")
        from recorder.dataset.manifest import SequenceDescription

        sequence = sequence_at(arguments.episode)
        return {"path": str(sequence.path), **asdict(SequenceDescription.read(sequence))}
    from recorder.episode.episode import open_episode
    from recorder.episode.repair import repair_episode
    from recorder.episode.summary import summarise

    if arguments.repair:
        episode = repair_episode(arguments.episode, arguments.out, overwrite=arguments.force)
    else:
        episode = open_episode(arguments.episode)
    return asdict(summarise(episode))


def show(result: dict[str, Any]) -> None:
    """Print the summary."""
    if "movers" in result:
        _show_sequence(result)
        return
    print(f"{result['path']}")
    print(f"  map        {result['map']} ({result['town_hash'][:12]})")
    route = "" if result["route_m"] is None else f", {result['route_m']:.1f} m along the route"
    print(f"  drive      {result['duration_s']:.1f} s by {result['device']}, ride {result['ride']}")
    print(f"  distance   {result['driven_m']:.1f} m driven{route}")
    if result["closure_m"] is not None:
        ends = f"ends {result['closure_m']:.1f} m and {result['closure_deg']:.1f}° from where it began"
        print(f"  loop       {'closed' if result['loop_closed'] else 'open'}: {ends}")
    print(f"  actors     {result['vehicles']} vehicles, {result['walkers']} walkers, seed {result['seed']}")
    print(f"  standing   {100 * result['standing']:.0f} % of the time, {result['stops']} stops")
    print(f"  close      a mover less than 10 m ahead for {result['mover_close_s']:.0f} s")
    broken = ", ".join(f"{kind.replace('_', ' ')} {count}" for kind, count in result["violations"].items())
    print(f"  collisions {result['collisions']}; rules broken: {broken or 'none'}")
    for number, car in enumerate(result["cars"], 1):
        figures = f"{car['driven_m']:.1f} m by {car['device']}, {car['collisions']} collisions"
        print(f"  car {number}      {figures}")
    if result["meets_table"] is not None:
        verdict = "meets" if result["meets_table"] else "does not meet"
        print(
            f"  table      {verdict} the paper's: {result['table_length_m']:.0f} m within 1 %, and its loop"
        )
    print(f"  health     {result['health']}")


def _show_sequence(result: dict[str, Any]) -> None:
    print(f"{result['path']}")
    print(f"  sequence   {result['name']}, rig {result['rig']}")
    print(f"  samples    {', '.join(f'{name} {count}' for name, count in result['samples'].items())}")
    shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in result["movers"].items())
    print(f"  movers     {shares or 'not counted: the rig has no labelled stream'}")
