"""Results of runs on the disk: each is kept with the fingerprint of its inputs, and holds for that alone."""

import hashlib
import json
import os
import threading
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path

from carlaloc_env.core.files.atomic_files import write_whole
from recorder.benchmark.config import BenchmarkConfig
from recorder.benchmark.plan import BenchmarkSequence, Job
from recorder.benchmark.score import Score, score_run
from recorder.dataset.layout import SequenceFolder
from recorder.slam.supervisor import RunRecord, run_isolated

RESULT = "result.json"
"""File of a run with its score."""
SHARED = Path("runs", "shared.jsonl")
"""File of what runs over drives have shared, a line for each pass over a drive."""
_FORMAT = 4
"""Changes when older results would be read wrongly."""


def keep(job: Job, record: RunRecord, config: BenchmarkConfig, fingerprint: str) -> Score:
    """Score a run that has ended and keep the score, whole or not at all.

    Args:
        job: The run.
        record: How it ended.
        config: The benchmark.
        fingerprint: What the run depends on, as it was when it began; empty: the result is none of the
            system's, and the same command runs it again.
    """
    folder = config.out / job.folder
    folder.mkdir(parents=True, exist_ok=True)
    score = score_run(job, folder, record, config.rule)
    document = {
        "format": _FORMAT,
        "fingerprint": fingerprint,
        "score": asdict(score),
        "record": asdict(record),
    }
    write_whole(folder / RESULT, json.dumps(document, indent=1) + "\n")
    return score


def keep_shared(config: BenchmarkConfig, shared: tuple[int, int], runs: int) -> None:
    """Append the number of measured instants of a drive, and of frames made of them, to a file."""
    line = json.dumps({"instants": shared[0], "frames": shared[1], "runs": runs})
    with (config.out / SHARED).open("a", encoding="utf-8") as file:
        file.write(line + "\n")


def read_shared(out: Path) -> list[dict[str, int]]:
    """All that `keep_shared` has written."""
    file = out / SHARED
    return [json.loads(line) for line in file.read_text().splitlines()] if file.is_file() else []


def read_result(job: Job, config: BenchmarkConfig) -> tuple[Score, str] | None:
    """The score of a run, and what that depended on; None: there is none that can be read."""
    try:
        document = json.loads((config.out / job.folder / RESULT).read_text(encoding="utf-8"))
        if document["format"] != _FORMAT:
            return None
        return Score(**document["score"]), str(document["fingerprint"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def run_job(
    job: Job,
    config: BenchmarkConfig,
    cores: tuple[int, ...],
    *,
    sequence: Path | None = None,
    together: int = 1,
    stop: threading.Event | None = None,
    feed: Connection | None = None,
) -> RunRecord:
    """Run a system over its sequence, see `run_isolated`.

    Args:
        job: The run.
        config: The benchmark.
        cores: Cores that it may use.
        sequence: Folder of the sequence where it is another one than the job's.
        together: Runs that take turns, so that each may take so many times as long.
        stop: Ends the run when it is set.
        feed: Connection to a feed.
    """
    return run_isolated(
        job.method, sequence or job.sequence.path, config.out / job.folder, cloud=job.cloud,
        limit_s=limit_s(job, config) * together, cores=cores, stop=stop, feed=feed, lidar=job.sequence.lidar,
    )  # fmt: skip


def limit_s(job: Job, config: BenchmarkConfig) -> float:
    """Longest time of a run on the clock [s]."""
    return 60.0 + config.limit_per_second * _duration_s(job.sequence)


def _duration_s(sequence: BenchmarkSequence) -> float:
    """Length of the truth [s], by its first and last lines."""
    with SequenceFolder(sequence.path).drive.truth("base_link").open("rb") as file:
        file.readline()
        first = float(file.readline().split()[0])
        file.seek(max(file.seek(0, os.SEEK_END) - 1000, 0))
        return float(file.read().splitlines()[-1].split()[0]) - first


def fingerprint_of(job: Job, config: BenchmarkConfig) -> str:
    """Fingerprint of a run's inputs: the data, the system, its file and version, and the rule."""
    source = Path(job.method).read_bytes() if job.method.endswith((".py", ".yaml", ".yml")) else b""
    facts = [
        job.sequence.digest,
        repr(job.system),
        job.system.version,
        job.cloud,
        json.dumps(asdict(config.rule)),
        f"{config.limit_per_second:g}",
    ]
    if job.system.file:
        given = Path(os.environ[job.system.file]).stat()
        facts.append(f"{given.st_size} {given.st_mtime_ns}")
    return hashlib.sha256(source + "\n".join(facts).encode()).hexdigest()[:32]
