"""Make the whole dataset: a drive in each of seven towns under three weathers and two traffic levels.

Examples:
  carlaloc dataset --out data --sample 5s
  carlaloc dataset --out data --towns Town01,Town07 --rig lidar --format rosbag2 --yes
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import asdict
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from carlaloc_env.core.errors import UsageError
from recorder.cli.arguments import OutputFolder, input_path, names, positive_seconds, seed
from recorder.cli.dataset_bars import DatasetBars
from recorder.cli.log_file import logged_to
from recorder.cli.replay_options import add_replay_options, replay_options

if TYPE_CHECKING:
    from recorder.factory.make_dataset import Record
    from recorder.factory.plan import DatasetConfig, DatasetPlan

HUB_URL = "https://huggingface.co/datasets/OWNER/NAME"
"""Put in place of the address in `croissant.json`; whoever uploads writes their own."""
LOG = ".carlaloc-dataset.log"
"""Name of the log in the dataset's folder."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc dataset`."""
    add_replay_options(
        parser, weathers=("ClearNoon", "FoggyNoon", "RainyNight"), traffic=("static", "dynamic")
    )
    parser.add_argument("--towns", type=names, metavar="A,B", help="towns; else the paper's seven")
    parser.add_argument(
        "--episodes", type=input_path, metavar="DIR", help="drives of your own, DIR/Town03.mcap and so on"
    )
    parser.add_argument(
        "--sample", type=positive_seconds, metavar="S", help="only so much of each drive, such as 5s"
    )
    parser.add_argument(
        "--seed", type=seed, help="seed of traffic and driver; else that of each town's standard drive"
    )
    parser.add_argument(
        "--manifest", type=OutputFolder(), metavar="DIR", help="also write drives, recipe and checksums there"
    )
    parser.add_argument(
        "--hub", type=OutputFolder(), metavar="DIR", help="also lay it out for a hub there; nothing is sent"
    )
    parser.add_argument("--yes", action="store_true", help="do not ask")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Plan, ask, make."""
    from recorder.factory.make_dataset import copy_manifest, make_dataset
    from recorder.factory.plan import ROUTE_M, DatasetConfig, plan_dataset, town_names
    from recorder.replaying.plan import ReplayOptions

    config = DatasetConfig(
        out=arguments.out,
        towns=town_names(arguments.towns or tuple(ROUTE_M)),
        episodes=arguments.episodes,
        sample_s=arguments.sample,
        seed=arguments.seed,
        replay=ReplayOptions(**replay_options(arguments)),
    )
    if arguments.hub is not None:
        from recorder.publishing.tables import check_parquet

        check_parquet()
    plan = plan_dataset(config)
    _tell(config, plan)
    if not arguments.yes:
        _ask()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with logged_to(arguments.out / LOG, "recorder"), DatasetBars() as bars:
        path = make_dataset(config, bars.update, record=_recorder(config.seed_of))
    if arguments.manifest is not None:
        copy_manifest(arguments.out, arguments.manifest)
    if arguments.hub is not None:
        from recorder.publishing.prepare import prepare_for_hub

        today = datetime.now(timezone.utc).date().isoformat()
        prepare_for_hub(arguments.out, arguments.hub, url=HUB_URL, date=today)
    figures = {key: value for key, value in asdict(plan).items() if key != "drives"}
    return {"dataset": str(path), "log": str(arguments.out / LOG), **figures}


def _tell(config: DatasetConfig, plan: DatasetPlan) -> None:
    """Say what will be made, how long it takes and how much room."""
    from recorder.factory.quantities import duration_text, size_text
    from recorder.factory.time_estimate import processes_of

    whole = sum(drive.is_whole for drive in plan.drives)
    driver = "the scripted driver" if config.episodes is None else f"drives of {config.episodes}"
    where = (
        f"on {config.replay.cluster}"
        if config.replay.cluster
        else f"with {_count(processes_of(config.replay), 'process')}"
    )
    lines = [
        f"{plan.sequences} sequences: {_count(len(plan.drives), 'town')}, "
        f"{', '.join(config.replay.weathers)}; {', '.join(config.replay.traffic)}",
        f"{duration_text(plan.driven_s)} of driving by {driver}"
        + (f"; {whole} of {len(plan.drives)} towns are whole already" if whole else ""),
        f"about {duration_text(plan.work_s)} {where}; the first unit shows how this machine differs",
        f"about {size_text(plan.size)} in {config.out}; {size_text(plan.needed)} of {size_text(plan.free)} "
        "free are taken while it is made",
    ]
    print("\n".join(lines), file=sys.stderr)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}{'es' if noun.endswith('s') else 's'}"


def _recorder(seed_of: Callable[[str], int]) -> Record:
    """The scripted driver, with the seed of each town."""
    from recorder.drive.record import RecordConfig, record

    def drive(town: str, out: Path, duration_s: float | None, tell: Callable[[float], None]) -> None:
        config = RecordConfig(map=town, out=out, duration_s=duration_s, seed=seed_of(town))
        record(config, progress=lambda driven_s, _: tell(driven_s))

    return drive


def _ask() -> None:
    if not sys.stdin.isatty():
        raise UsageError("nobody is there to be asked; give --yes to begin")
    print("Begin? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise UsageError("nothing was made")


def show(result: dict[str, Any]) -> None:
    """Print what was made."""
    print(f"{result['dataset']}  ({result['sequences']} sequences; what was done when: {result['log']})")
