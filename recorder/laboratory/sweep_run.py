"""Runs a sweep as one benchmark, so that it shares rays, resumes, and takes workers and clusters."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import pandas as pd

from recorder.benchmark.config import BenchmarkConfig
from recorder.benchmark.results import read_shared
from recorder.benchmark.run import BenchmarkResult, Progress, run_benchmark
from recorder.benchmark.score import Score
from recorder.laboratory.sweep import Point, SweepConfig, points_of, sequences_of_points


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepResult:
    """Result of a sweep: a row of figures for each point and system."""

    config: SweepConfig
    """Its configuration."""
    runs: pd.DataFrame
    """A row for each point and system: swept quantities, ``drive``, ``seed``, figures of the score."""
    benchmark: BenchmarkResult
    """The runs themselves; several points may share one."""
    instants: int
    """Instants whose rays were cast or pictures drawn by this call."""
    frames: int
    """Sweeps and pairs that were made of them."""


def run_sweep(
    config: SweepConfig,
    benchmark: BenchmarkConfig,
    progress: Progress = lambda *_: None,
    report: Callable[[str], None] = lambda _: None,
) -> SweepResult:
    """Run systems at every point of a sweep, as one benchmark.

    Args:
        config: Quantities and drives.
        benchmark: Systems, workers, clouds and the rule of failure; its data are those of the sweep.
        progress: Called with the progress of the runs.
        report: Called with a line about every drive that is simulated anew.

    Raises:
        CarlaLocError: a drive cannot be read, an option does not fit it, or a system is missing.
    """
    points = points_of(config)
    sequences = sequences_of_points(config, points, report)
    before = len(read_shared(config.out))
    unique = list({sequence.path: sequence for sequence in sequences}.values())
    result = run_benchmark(benchmark, progress, sequences=unique)
    passes = read_shared(config.out)[before:]
    # Systems run once where sweeps are the same in all weathers.
    scores = {
        key: (job, score)
        for job, score in zip(result.jobs, result.scores, strict=True)
        for key in ((job.sequence.path, job.title, job.run), (*_alike(job.sequence), job.title, job.run))
    }
    titles = dict.fromkeys((job.title, job.run) for job in result.jobs)
    rows = []
    for point, sequence in zip(points, sequences, strict=True):
        for title, run in titles:
            scored = scores.get((sequence.path, title, run)) or scores.get((*_alike(sequence), title, run))
            if scored is not None:
                rows.append(row_of(point, scored[1], title))
    return SweepResult(
        config=config,
        runs=pd.DataFrame(rows),
        benchmark=result,
        instants=sum(made["instants"] for made in passes),
        frames=sum(made["frames"] for made in passes),
    )


def _alike(sequence: object) -> tuple[object, ...]:
    return tuple(getattr(sequence, name) for name in ("dataset", "town", "traffic", "faults"))


def row_of(point: Point, score: Score, title: str) -> dict[str, object]:
    """Row of `SweepResult.runs` for one run: figures of its score, swept quantities, drive and seed."""
    figures = asdict(score)
    # The quantity swept may be called as the level is.
    level = {"traffic_level": figures.pop("traffic"), "title": title}
    return {**figures, **level, **dict(point.values), "drive": point.drive.stem, "seed": point.number}
