"""Make the whole dataset: a drive in each of seven towns under three weathers and two traffic levels.

Examples:
  carlaloc dataset --out data --sample 5s
  carlaloc dataset --out data --towns Town01,Town07 --rig lidar --format rosbag2 --yes
"""

from __future__ import annotations

import argparse
import sys
from datetime import timedelta
from typing import TYPE_CHECKING, Any

from carlaloc_env.core.errors import UsageError
from recorder.cli.arguments import (
    OutputFolder,
    add_replay_options,
    config_of,
    input_path,
    names,
    option,
    positive_seconds,
    replay_options,
    seed,
)
from recorder.cli.output import logged_to
from recorder.cli.progress import Progress

if TYPE_CHECKING:
    from recorder.factory import DatasetConfig, DatasetPlan

LOG = ".carlaloc-dataset.log"
"""Name of the log in the dataset's folder."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc dataset`."""
    add_replay_options(
        parser, weathers=("ClearNoon", "FoggyNoon", "RainyNight"), traffic=("static", "dynamic")
    )
    option(parser, "--towns", names, "A,B", "towns; else the paper's seven")
    option(parser, "--episodes", input_path, "DIR", "drives of your own, DIR/Town03.mcap and so on")
    option(parser, "--sample", positive_seconds, "S", "only so much of each drive, such as 5s")
    parser.add_argument(
        "--seed", type=seed, help="seed of traffic and driver; else that of each town's standard drive"
    )
    option(parser, "--hub", OutputFolder(), "DIR", "also prepare it there for a hub; nothing is sent")
    parser.add_argument("--yes", action="store_true", help="do not ask")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Plan, ask, make."""
    from recorder.drive.standard_drives import ROUTE_M
    from recorder.factory import (
        DatasetConfig,
        make_dataset,
        plan_dataset,
        town_names,
    )

    towns, replay = town_names(arguments.towns or tuple(ROUTE_M)), replay_options(arguments, seed=None)
    config = config_of(DatasetConfig, arguments, towns=towns, replay=replay)
    if arguments.hub is not None:
        from recorder.publishing.prepare import check_packages

        check_packages()
    plan = plan_dataset(config)
    _print_plan(config, plan)
    if not arguments.yes:
        _ask()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with logged_to(arguments.out / LOG, "recorder"), Progress("dataset") as progress:
        path = make_dataset(config, progress.update)
    if arguments.hub is not None:
        from recorder.publishing.prepare import prepare_for_hub

        prepare_for_hub(arguments.out, arguments.hub)
    return {
        "dataset": str(path),
        "log": str(arguments.out / LOG),
        "sequences": plan.sequences,
        "driven_s": plan.driven_s,
        "kept": plan.kept,
    }


def _print_plan(config: DatasetConfig, plan: DatasetPlan) -> None:
    """Print what will be made, size and time, and what is kept of an earlier run."""
    driver = "the scripted driver" if config.episodes is None else f"drives of {config.episodes}"
    towns = "1 town" if len(config.towns) == 1 else f"{len(config.towns)} towns"
    lines = [
        f"{plan.sequences} sequences: {towns}, {', '.join(config.replay.weathers)}; "
        + ", ".join(config.replay.traffic),
        f"{timedelta(seconds=round(plan.driven_s))} of driving by {driver}",
        str(plan.cost),
    ]
    if plan.drives or plan.whole:
        lines.append(
            f"resuming with {plan.kept / 1e9:.3f} GB that are there: drives of {plan.drives}, all sequences "
            f"of {len(plan.whole)} of {towns}, and {plan.parts} units and sequences of the next"
        )
    print("\n".join(lines), file=sys.stderr)


def _ask() -> None:
    if not sys.stdin.isatty():
        raise UsageError("no terminal to ask on; give --yes to begin")
    print("Begin? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise UsageError("stopped before the first file")


def show(result: dict[str, Any]) -> None:
    """Print what was made."""
    print(f"{result['dataset']}  ({result['sequences']} sequences; log: {result['log']})")
