"""Checks that the rest of a replay fits on the disk, by the size of its first unit."""

import shutil
from pathlib import Path

from carlaloc_env.core.errors import WriterError
from recorder.dataset.layout import DriveFolder
from recorder.replaying.recipe import Recipe, Unit
from recorder.replaying.sample_counts import SampleCounts
from recorder.replaying.sequence_writers import SequenceWriters
from recorder.replaying.spool import merged
from recorder.replaying.unit_work import (
    SHARED,
    read_summary,
)


def check_room(
    recipe: Recipe, unit: Unit, units_dir: Path, *, spools_s: float, sequences_s: float, out: Path
) -> None:
    """Compare the size of the remaining files with the free space.

    Args:
        recipe: Sequences to make of the drive.
        unit: The first unit, which is whole.
        units_dir: Folder of all units.
        spools_s: Time of which spools are yet to be written, at most at once [s].
        sequences_s: Time of all sequences that are yet to be assembled [s].
        out: Folder of the dataset.

    Raises:
        WriterError: the rest does not fit.
    """
    files = read_summary(units_dir / unit.name)["files"].values()
    spools = sum(file["size"] for file in files)
    try:
        assembled = _assembled_bytes(recipe, unit, units_dir)
    except WriterError:
        # A format may refuse a unit shorter than one of its samples; no format is larger than the spools.
        assembled = spools
    needed = (spools_s * spools + sequences_s * assembled) / unit.length_s
    free = shutil.disk_usage(out).free
    if needed > free:
        raise WriterError(
            f"the rest needs about {needed / 1e9:.3f} GB, and {free / 1e9:.3f} GB are free in {out}; "
            "make room, or choose fewer conditions, another --format or --topics compact"
        )


def _assembled_bytes(recipe: Recipe, unit: Unit, units_dir: Path) -> int:
    """Size of a unit as a sequence: formats compress what lies in spools as it is [bytes]."""
    condition, folder = recipe.conditions_of(unit.level)[0], units_dir / unit.name
    drive = DriveFolder(units_dir / ".first.part")
    writers = SequenceWriters(drive, condition, recipe, tuple(read_summary(folder)["streams"]))
    try:
        writers.open()
        for _, number, piece in merged(folder / f"{n}.spool" for n in (SHARED, condition.weather_name)):
            writers.place(number, piece)
        writers.close(SampleCounts())
        return sum(path.stat().st_size for path in drive.path.rglob("*") if path.is_file())
    except BaseException:
        writers.abort()
        raise
    finally:
        shutil.rmtree(drive.path, ignore_errors=True)
