"""Recordings of rerun of a benchmark: each sequence with the estimates of all systems."""

from pathlib import Path

from recorder.benchmark.run import BenchmarkResult
from recorder.dataset.sequence import SlamSequence
from recorder.view.sequence_view import record_sequence

FOLDER = "recordings"
"""Where they lie below the results."""


def write_recordings(result: BenchmarkResult) -> list[Path]:
    """Write a recording of each sequence with the first run of every system; older ones are replaced.

    Raises:
        OutputError: a file may not be written.
        MissingDependencyError: rerun is not installed.
    """
    first_runs = [(job.sequence, errors) for job, errors in result.errors() if job.run == 1]
    return [
        record_sequence(
            SlamSequence(sequence.path, lidar=sequence.lidar),
            result.out / FOLDER / f"{sequence.key}.rrd",
            estimates=[errors for at, errors in first_runs if at == sequence],
            overwrite=True,
        )
        for sequence in result.sequences
    ]
