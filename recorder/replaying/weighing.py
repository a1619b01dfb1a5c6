"""Estimates a replay anew by its first unit: spools, a second of the sequences, and the machine's speed."""

import shutil
from dataclasses import replace
from pathlib import Path

from carlaloc_env.core.errors import WriterError
from recorder.dataset.layout import DriveFolder
from recorder.replaying.conditions import Condition
from recorder.replaying.cost import SIZE_ERROR, ReplayCost, size_of
from recorder.replaying.machine_speed import measured_slowness, remember_slowness, slowness
from recorder.replaying.plan import ReplayPlan
from recorder.replaying.recipe import Recipe, Unit
from recorder.replaying.sample_counts import SampleCounts
from recorder.replaying.sequence_writers import SequenceWriters
from recorder.replaying.spool import merged
from recorder.replaying.unit_work import SHARED, read_summary

WEIGHED_NS = 1_000_000_000
"""Longest stretch that is assembled [ns]."""


def weighed_cost(plan: ReplayPlan, cost: ReplayCost, unit: Unit, units_dir: Path) -> ReplayCost:
    """The cost by how fast the machine is now, and by what a stretch of the unit takes in all files.

    The machine's slowness is remembered for the next replay. Where nothing else is to come, the cost stays.

    Args:
        plan: The replay.
        cost: Its cost, and that of further drives, estimated before.
        unit: The first unit, which is whole.
        units_dir: Folder of all units.
    """
    folder, recipe = units_dir / unit.name, plan.recipe
    summary, of_unit = read_summary(folder), plan.cost_of(unit.level, unit.span_ns)
    factor = measured_slowness()
    ratio = factor / slowness()
    remember_slowness(factor)
    if cost.seen_s <= of_unit.seen_s:
        return cost
    first_ns = max(unit.span_ns[0], recipe.camera_ns[0]) if plan.shows(unit) else unit.span_ns[0]
    span_ns = (first_ns, min(first_ns + WEIGHED_NS, unit.span_ns[1]))
    of_part, conditions = plan.cost_of(unit.level, span_ns), recipe.conditions_of(unit.level)
    try:
        weighed = float(sum(_assembled_bytes(recipe, c, folder, span_ns, units_dir) for c in conditions))
    except WriterError:
        # A format may refuse a stretch shorter than one of its samples.
        weighed = of_part.written_bytes
    spooled = sum(file["size"] for file in summary["files"].values())
    return replace(
        cost,
        written_bytes=cost.written_bytes + (weighed - of_part.written_bytes) * cost.seen_s / of_part.seen_s,
        spooled_bytes=cost.spooled_bytes * spooled / of_unit.spooled_bytes,
        size_error=min(cost.size_error, SIZE_ERROR),
        cpu_s=ratio * cost.cpu_s,
        weighed_s=(span_ns[1] - span_ns[0]) / 1e9,
    )


def _assembled_bytes(
    recipe: Recipe, condition: Condition, folder: Path, span_ns: tuple[int, int], units_dir: Path
) -> int:
    """Size of a stretch of a unit as a sequence of a condition [bytes]."""
    drive = DriveFolder(units_dir / ".first.part")
    writers = SequenceWriters(drive, condition, recipe, tuple(read_summary(folder)["streams"]))
    try:
        writers.open()
        for order, number, piece in merged(folder / f"{n}.spool" for n in (SHARED, condition.weather_name)):
            if order[0] >= span_ns[1]:
                break
            if order[0] >= span_ns[0]:
                writers.place(number, piece)
        writers.close(SampleCounts())
        return size_of(drive.path)
    except BaseException:
        writers.abort()
        raise
    finally:
        shutil.rmtree(drive.path, ignore_errors=True)
