"""Drive and record an episode.

Examples:
  carlaloc record --map Town03 --device scripted --out drive.mcap
  carlaloc record --map Town03 --duration 40 --seed 7 --traffic 0.5 --out short.mcap
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

from recorder.cli.arguments import path_argument, positive_seconds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc record`."""
    parser.add_argument("--map", default="Town03", help="town, or a .xodr file (default: Town03)")
    parser.add_argument("--device", default="scripted", help="who drives (default: scripted)")
    parser.add_argument("--out", type=path_argument, required=True, help="episode to write, e.g. drive.mcap")
    parser.add_argument("--duration", type=positive_seconds, metavar="S", help="length [s]; else the route")
    parser.add_argument("--seed", type=int, default=0, help="seed of traffic and scripted driver")
    parser.add_argument("--traffic", default="dynamic", help="dynamic, static or a fraction")
    parser.add_argument("--force", action="store_true", help="replace an older episode of this name")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Record."""
    from tqdm import tqdm

    from recorder.record import RecordConfig, record

    config = RecordConfig(
        map=arguments.map,
        out=arguments.out,
        device=arguments.device,
        duration_s=arguments.duration,
        seed=arguments.seed,
        traffic=arguments.traffic,
        overwrite=arguments.force,
    )
    total = arguments.duration
    with tqdm(total=total, unit="s", desc="recording", disable=None, leave=False) as bar:

        def progress(driven_s: float, route_m: float) -> None:
            bar.set_postfix_str(f"{route_m:.0f} m")
            bar.update(round(driven_s - bar.n, 3))

        result = record(config, progress=progress)
    return {**asdict(result), "path": str(result.path)}


def show(result: dict[str, Any]) -> None:
    """Print what was recorded."""
    print(
        f"{result['path']}: {result['duration_s']:.1f} s, {result['length_m']:.0f} m, "
        f"{result['collisions']} collisions"
    )
