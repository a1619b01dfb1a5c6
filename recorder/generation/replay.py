"""Replay an episode through a sensor rig, under any weather and traffic, and write datasets.

Traffic levels run in processes of their own. All is written into a working folder and gets its final
names when all is whole.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from carlaloc_env.core.output_paths import path_below
from recorder.generation.replay_plan import ReplayConfig, ReplayPlan, plan_replay, rig_of
from recorder.generation.worker_processes import run_jobs
from recorder.generation.working_folder import WorkingFolder, settle_killed_runs

if TYPE_CHECKING:
    from recorder.generation.replay_level import LevelJob

__all__ = ["Progress", "ReplayConfig", "ReplayResult", "replay", "rig_of"]

Progress = Callable[[float, float], None]
"""Called with seconds of sensor data done and seconds in all, over all traffic levels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayResult:
    """What was written."""

    out: Path
    """Folder of the dataset."""
    sequences: tuple[Path, ...]
    """Folder of each sequence."""
    ground_truth: Path
    """Folder of the true trajectories."""
    samples: dict[str, int]
    """Number of samples of each stream, over all sequences."""


def replay(config: ReplayConfig, progress: Progress | None = None) -> ReplayResult:
    """Replay an episode and write all its sequences.

    What a killed run left in the folder is removed first, or given its names if it was whole.

    Args:
        config: What to replay.
        progress: Told about every second how far all levels are.

    Raises:
        ConfigError: an unknown rig, weather, format or level, or a stretch outside the drive.
        EpisodeError: the episode cannot be read, or its map has changed since or must be given.
        OutputError: `out` is no folder.
        WriterError: a sequence exists already or cannot be written.
    """
    plan = plan_replay(config)
    if plan.request in settle_killed_runs(config.out):
        return _result(plan)
    begun = plan.check_room()
    # Imported when nothing is left that could be refused: these bring all that draws and writes.
    from recorder.generation.sequence_writers import write_shared

    with WorkingFolder(config.out, plan.town.name, plan.origin, plan.request) as work:
        if not begun:
            write_shared(
                work.town_dir, plan.rig, plan.timeline, plan.span_ns, topics=config.topics, seed=plan.seed
            )
        _run(_jobs(plan, work.town_dir), config.workers, progress)
        work.publish()
    return _result(plan)


def _jobs(plan: ReplayPlan, town_dir: Path) -> list[LevelJob]:
    """A job for each traffic level.

    Args:
        plan: What is replayed.
        town_dir: Folder in which its sequences are written.
    """
    from recorder.generation.replay_level import LevelJob
    from recorder.generation.sequence_writers import DatasetSequence

    return [
        LevelJob(
            config=plan.config,
            town=plan.town.source,
            level=level,
            sequences=tuple(
                DatasetSequence(condition=condition, folder=path_below(town_dir, condition.name))
                for condition in plan.conditions
                if condition.traffic == level
            ),
            span_ns=plan.span_ns,
            camera_ns=plan.camera_ns,
            seed=plan.seed,
        )
        for level in dict.fromkeys(condition.traffic for condition in plan.conditions)
    ]


def _run(jobs: list[LevelJob], workers: int | None, progress: Progress | None) -> None:
    from recorder.generation.replay_level import replay_level

    total_s = sum((job.span_ns[1] - job.span_ns[0]) / 1e9 for job in jobs)
    done = [0.0] * len(jobs)

    def report(number: int, done_s: float) -> None:
        done[number] = done_s
        if progress is not None:
            progress(sum(done), total_s)

    run_jobs(replay_level, jobs, min(workers or os.cpu_count() or 1, len(jobs)), report)


def _result(plan: ReplayPlan) -> ReplayResult:
    samples: Counter[str] = Counter()
    for folder in plan.sequences:
        samples.update(yaml.safe_load((folder / "sequence.yaml").read_text(encoding="utf-8"))["samples"])
    return ReplayResult(
        out=plan.config.out,
        sequences=plan.sequences,
        ground_truth=plan.town_dir / "ground_truth",
        samples=dict(sorted(samples.items())),
    )
