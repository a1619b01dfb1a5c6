"""The work of a worker: making the pieces of a unit, or assembling a sequence of them.

Both are functions of a job that is plain data, on any machine that sees the episode and the working folder.
"""

import json
import shutil
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from secrets import token_hex
from typing import Any

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import CarlaLocError, WriterError
from carlaloc_env.core.freed_memory import give_back_freed_memory
from recorder.dataset.layout import DriveFolder
from recorder.episode.traffic_level import TrafficLevel
from recorder.replaying.camera_history import past_ns
from recorder.replaying.conditions import Condition
from recorder.replaying.level_sensors import LevelSensors
from recorder.replaying.recipe import Recipe, Unit
from recorder.replaying.sample_counts import SampleCounts
from recorder.replaying.sequence_writers import SequenceWriters, outputs_of
from recorder.replaying.spool import SpoolFile, SpoolWriter, merged

SUMMARY = "unit.json"
"""File that makes a unit's folder whole."""
SHARED = "shared"
"""Spool of the pieces that all weathers share."""
STOP = "stop"
"""File in the folder of all units at which workers stop."""

Report = Callable[[float], None]
"""Called with seconds of sensor data that are done."""

_held = threading.local()
"""The sensors that this thread has built last; OpenGL's contexts belong to threads."""


class Stopped(CarlaLocError):
    """The run that a unit belongs to has been asked to end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitJob:
    """A unit, as a worker gets it."""

    recipe: Recipe
    """Sequences to make of the drive."""
    unit: Unit
    """The stretch."""
    folder: Path
    """Folder of all units."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AssemblyJob:
    """A sequence, as a worker gets it."""

    recipe: Recipe
    """Sequences to make of the drive."""
    condition: Condition
    """Weather and traffic of the sequence."""
    drive: Path
    """Folder of the drive in which the sequence's folder is made."""
    units: tuple[Path, ...]
    """Folders of its units, in the order of time."""


def make_unit(job: UnitJob, report: Report) -> None:
    """Make all pieces of a unit; its folder gets its name when it is whole.

    Args:
        job: The unit.
        report: Called after every step.

    Raises:
        Stopped: the run has been asked to end.
        WriterError: the disk is full.
        RenderError: pictures cannot be drawn here.
        RaycastError: rays cannot be cast here.
    """
    final = job.folder / job.unit.name
    part = job.folder / f"{job.unit.name}.{token_hex(4)}.part"
    try:
        part.mkdir(parents=True)
        _fill(job, part, report)
        try:
            part.rename(final)
        except OSError:
            # Another worker has made it, too, when this worker was presumed lost; the bytes are the same.
            if not (final / SUMMARY).exists():
                raise
    except OSError as error:
        raise WriterError(f"cannot write {final}: {error.strerror}") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _fill(job: UnitJob, part: Path, report: Report) -> None:
    recipe = job.recipe
    sensors = _sensors_of(recipe, job.unit.level)
    encoders = [output.encoder for output in outputs_of(recipe, sensors.streams)]
    weathers = [condition.weather_name for condition in recipe.conditions_of(job.unit.level)]
    names = (SHARED, *weathers)
    counts = {name: SampleCounts() for name in names}
    with ExitStack() as closing:
        spools = {name: SpoolWriter(part / f"{name}.spool") for name in names}
        for spool in spools.values():
            closing.callback(spool.drop)
        first, end = job.unit.span_ns
        past = past_ns(recipe.rig, recipe.camera_ns, job.unit.span_ns)
        for at_ns in sensors.recall(job.unit.span_ns):
            _check_stop(job)
            report((at_ns - past[0]) / 1e9)
        for begin in range(first, end, STEP_NS):
            _check_stop(job)
            window = (begin, min(begin + STEP_NS, end))
            for measured in sensors.measure(window):
                name = SHARED if measured.weather is None else weathers[measured.weather]
                counts[name].count(measured.sample)
                for number, encoder in enumerate(encoders):
                    for piece in encoder.encode(measured.sample):
                        spools[name].put(measured.order, number, piece)
            report((past[1] - past[0] + window[1] - first) / 1e9)
        files = {name: spool.complete() for name, spool in spools.items()}
    summary = {
        "streams": sensors.streams,
        "counts": {name: count.numbers() for name, count in counts.items()},
        "files": {name: asdict(file) for name, file in files.items()},
    }
    (part / SUMMARY).write_text(json.dumps(summary), encoding="utf-8")


def _check_stop(job: UnitJob) -> None:
    if (job.folder / STOP).exists():
        raise Stopped("the run has been asked to end")


def _sensors_of(recipe: Recipe, level: TrafficLevel) -> LevelSensors:
    """Sensors of a level; the last ones built are reused where they fit."""
    held: LevelSensors | None = getattr(_held, "sensors", None)
    if held is None or (held.recipe, held.level) != (recipe, level):
        # The old sensors are released first: each set takes a gigabyte.
        del held
        release_sensors()
        held = _held.sensors = LevelSensors(recipe, level)
    return held


def release_sensors() -> None:
    """Release the sensors that this thread holds for the next unit."""
    held: LevelSensors | None = getattr(_held, "sensors", None)
    _held.sensors = None
    if held is not None:
        held.close()
        del held
        give_back_freed_memory()


def _forget_level(level: TrafficLevel) -> None:
    """Release held sensors of a level whose units are all whole."""
    held: LevelSensors | None = getattr(_held, "sensors", None)
    if held is not None and held.level == level:
        del held
        release_sensors()


def is_whole(folder: Path, names: Sequence[str]) -> bool:
    """Whether a unit's folder has spools of these names, each with its checksum."""
    try:
        files = read_summary(folder)["files"]
        return all(asdict(SpoolFile.of(folder / f"{name}.spool")) == files[name] for name in names)
    except (OSError, KeyError, ValueError, TypeError):
        return False


def read_summary(folder: Path) -> dict[str, Any]:
    """The summary of a unit."""
    summary: dict[str, Any] = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    return summary


def assemble(job: AssemblyJob, report: Report) -> None:
    """Write a sequence from the pieces of its units; its folder gets its name when it is whole.

    Args:
        job: The sequence.
        report: Called after every unit with the number done.

    Raises:
        WriterError: the disk is full.
    """
    _forget_level(job.condition.traffic)
    weather = job.condition.weather_name
    summaries = [read_summary(folder) for folder in job.units]
    streams = tuple(summaries[0]["streams"])
    writers = SequenceWriters(DriveFolder(job.drive), job.condition, job.recipe, streams)
    counts = SampleCounts()
    try:
        writers.open()
        for done, (folder, summary) in enumerate(zip(job.units, summaries, strict=True), start=1):
            for name in (SHARED, weather):
                counts.add(summary["counts"][name])
            for _, number, piece in merged(folder / f"{name}.spool" for name in (SHARED, weather)):
                writers.place(number, piece)
            report(float(done))
        writers.close(counts)
    except BaseException:
        writers.abort()
        raise
    # They are no longer needed; the shared spool is deleted with the last weather's.
    for folder in job.units:
        (folder / f"{weather}.spool").unlink(missing_ok=True)
