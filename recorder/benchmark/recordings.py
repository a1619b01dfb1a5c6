"""Recordings of rerun of a benchmark: each sequence with what all systems made of it."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path

from recorder.benchmark.page import evaluated_runs
from recorder.benchmark.run import BenchmarkResult
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.evaluate import EvaluationResult
from recorder.view.sequence_view import record_sequence

FOLDER = "recordings"
"""Where they lie below the results."""


def write_recordings(result: BenchmarkResult, out: Path) -> list[Path]:
    """Write a recording of each sequence with the first run of every system; older ones are replaced.

    Raises:
        OutputError: a file may not be written.
        MissingDependencyError: rerun is not installed.
    """
    estimates: dict[str, list[EvaluationResult]] = defaultdict(list)
    for job, found in evaluated_runs(result, out):
        if job.run == 1:
            title = job.system.title + ("" if job.cloud == "raw" else f" {job.cloud}")
            named = replace(found, estimate=replace(found.estimate, name=title))
            estimates[job.sequence.key].append(named)
    return [
        record_sequence(
            SlamSequence(sequence.path),
            out / FOLDER / f"{sequence.key}.rrd",
            estimates=estimates[sequence.key],
            overwrite=True,
        )
        for sequence in result.sequences
    ]
