"""Make the whole dataset: a drive in each of seven towns under three weathers and two traffic levels.

Examples:
  carlaloc dataset --out data --sample 5
  carlaloc dataset --out data --towns Town01,Town07 --rig lidar --format rosbag2 --yes
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from carlaloc_env import TOWNS
from carlaloc_env.core.errors import UsageError
from recorder.cli.arguments import (
    OutputFolder,
    input_path,
    names,
    positive_int,
    positive_seconds,
    seed,
)
from recorder.cli.progress import Progress

if TYPE_CHECKING:
    from recorder.generation.dataset import Record


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc dataset`."""
    parser.add_argument("--out", type=OutputFolder(), required=True, help="folder of the dataset")
    parser.add_argument("--towns", type=names, default=TOWNS, metavar="A,B", help="towns; else all seven")
    parser.add_argument(
        "--weather",
        type=names,
        default=("ClearNoon", "FoggyNoon", "RainyNight"),
        metavar="A,B",
        help="weathers (default: ClearNoon,FoggyNoon,RainyNight)",
    )
    parser.add_argument(
        "--traffic", type=names, default=("static", "dynamic"), metavar="A,B", help="default: static,dynamic"
    )
    parser.add_argument(
        "--episodes", type=input_path, metavar="DIR", help="drives of your own, DIR/Town03.mcap and so on"
    )
    parser.add_argument("--sample", type=positive_seconds, metavar="S", help="only so much of each drive [s]")
    parser.add_argument("--rig", default="paper", help="name of a rig or a .yaml file (default: paper)")
    parser.add_argument(
        "--format", type=names, default=("rosbag1", "euroc"), metavar="A,B", help="default: rosbag1,euroc"
    )
    parser.add_argument("--topics", default="standard", help="topic profile of bags (default: standard)")
    parser.add_argument("--quality", default="medium", help="low, medium or high")
    parser.add_argument("--seed", type=seed, default=0, help="seed of traffic and driver (default: 0)")
    parser.add_argument("--workers", type=positive_int, metavar="N", help="processes; else one per core")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Dask scheduler whose workers do the work")
    parser.add_argument(
        "--manifest", type=OutputFolder(), metavar="DIR", help="also write drives, recipe and checksums there"
    )
    parser.add_argument("--no-preview", action="store_true", help="make no films")
    parser.add_argument("--yes", action="store_true", help="do not ask")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Plan, ask, make."""
    from recorder.generation.dataset import DatasetConfig, make_dataset, plan_dataset, write_manifest
    from recorder.generation.replay_plan import ReplayConfig

    config = DatasetConfig(
        out=arguments.out,
        towns=arguments.towns,
        weathers=arguments.weather,
        traffic=arguments.traffic,
        episodes=arguments.episodes,
        sample_s=arguments.sample,
        seed=arguments.seed,
        replay=ReplayConfig(
            episode=Path(),
            out=arguments.out,
            rig=arguments.rig,
            formats=arguments.format,
            topics=arguments.topics,
            quality=arguments.quality,
            workers=arguments.workers,
            cluster=arguments.cluster,
            preview=not arguments.no_preview,
        ),
    )
    plan = plan_dataset(config)
    print(
        f"{plan.sequences} sequences, {plan.driven_s:.0f} s of driving: about {plan.size / 1e9:.1f} GB, "
        f"{plan.needed / 1e9:.1f} GB while it is made; the time is told when the first seconds are made",
        file=sys.stderr,
    )
    if not arguments.yes:
        _ask()
    arguments.out.mkdir(parents=True, exist_ok=True)
    log = logging.FileHandler(arguments.out / ".carlaloc-dataset.log", encoding="utf-8")
    log.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    logger = logging.getLogger("recorder")
    logger.addHandler(log)
    logger.setLevel(min(logging.INFO, logger.getEffectiveLevel()))
    try:
        with Progress("dataset") as progress:
            path = make_dataset(config, _teller(progress), record=_recorder(arguments.seed))
    finally:
        logger.removeHandler(log)
        log.close()
    if arguments.manifest is not None:
        write_manifest(arguments.out, arguments.manifest)
    return {"dataset": str(path), **asdict(plan)}


def _recorder(seed: int) -> Record:
    """The scripted driver."""
    from recorder.drive.record import RecordConfig, record

    def drive(town: str, out: Path, duration_s: float | None, tell: Callable[[], None]) -> None:
        config = RecordConfig(map=town, out=out, duration_s=duration_s, seed=seed)
        record(config, progress=lambda *_: tell())

    return drive


def _ask() -> None:
    if not sys.stdin.isatty():
        raise UsageError("nobody is there to be asked; give --yes to begin")
    print("Begin? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise UsageError("nothing was made")


def _teller(progress: Progress) -> Any:
    """Tells a terminal how far it is; a log file that nobody watches stays quiet."""
    if not sys.stderr.isatty():
        return None
    return lambda stage, done_s, total_s: progress.update(done_s, total_s, stage)


def show(result: dict[str, Any]) -> None:
    """Print what was made."""
    print(f"{result['dataset']}  ({result['sequences']} sequences)")
