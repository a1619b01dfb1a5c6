"""Whether the rest of a replay fits on the disk, by what its first unit takes there."""

from __future__ import annotations

import shutil
from pathlib import Path

from carlaloc_env.core.errors import WriterError
from recorder.replaying.sample_counts import SampleCounts
from recorder.replaying.sequence_writers import WriterGroup
from recorder.replaying.spool import merged
from recorder.replaying.unit_work import SHARED, AssemblyJob, read_summary


def check_room(job: AssemblyJob, length_s: float, *, spools_s: float, sequences_s: float, out: Path) -> None:
    """Compare what is yet to be written with what is free.

    Args:
        job: Assembly of the first unit alone, in a folder of its own; nothing is left of it.
        length_s: Length of that unit [s].
        spools_s: Time of which spools are yet to be written, at most at once [s].
        sequences_s: Time of all sequences that are yet to be assembled [s].
        out: Folder of the dataset.

    Raises:
        WriterError: the rest does not fit.
    """
    (unit,) = job.units
    spools = sum(file["size"] for file in read_summary(unit)["files"].values())
    needed = (spools_s * spools + sequences_s * _assembled_bytes(job, unit)) / length_s
    free = shutil.disk_usage(out).free
    if needed > free:
        raise WriterError(
            f"the rest needs about {needed / 1e9:.3f} GB, and {free / 1e9:.3f} GB are free in {out}; "
            "make room, or choose fewer conditions, another --format or --topics compact"
        )


def _assembled_bytes(job: AssemblyJob, unit: Path) -> int:
    """Size of a unit as a sequence: formats compress what lies in spools as it is [bytes]."""
    group = WriterGroup(job.sequence, job.config, tuple(read_summary(unit)["streams"]))
    folder = job.sequence.folder
    try:
        group.open()
        names = (SHARED, job.sequence.condition.weather_name)
        for _, writer, piece in merged(unit / f"{name}.spool" for name in names):
            group.place(writer, piece)
        group.close(SampleCounts())
        return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    except BaseException:
        group.abort()
        raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)
