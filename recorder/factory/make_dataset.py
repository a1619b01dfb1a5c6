"""The whole dataset: a drive in each town, each of them replayed under all conditions.

Drives are recorded by the scripted driver with fixed seeds, or are a person's. Each is a replay into the same
folder, and the same command goes on where it was.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import ConfigError, OutputError, WriterError
from carlaloc_env.core.files.file_lock import take_lock
from recorder.dataset.layout import CHECKSUMS, DATASET, EPISODES, DatasetFolder
from recorder.dataset.manifest import DatasetManifest, write_manifest
from recorder.factory.plan import (
    SAMPLE_FROM_S,
    DatasetConfig,
    DrivePlan,
    plan_dataset,
)
from recorder.factory.quantities import duration_text
from recorder.factory.time_left import DRIVING, REPLAYING, DatasetClock, DatasetProgress
from recorder.replaying.plan import ReplayConfig, ReplayOptions
from recorder.replaying.replay import replay
from recorder.replaying.working_folder import FOLDER

WORK = ".carlaloc-dataset"
"""Folder that one run holds at a time; it says of which recipe."""
Progress = Callable[[DatasetProgress], None]
"""Called about every second."""
Record = Callable[[str, Path, float | None, Callable[[float], None]], None]
"""Records a drive through a town, of a length [s] or along the whole route; tells how far it is [s]."""
_log = logging.getLogger(__name__)


def make_dataset(
    config: DatasetConfig, progress: Progress | None = None, *, record: Record | None = None
) -> Path:
    """Record, replay and list all drives; what is whole already is kept.

    Args:
        config: What to make.
        progress: Told what is being done, and how far all drives are.
        record: Records the drives that are missing.

    Returns:
        ``dataset.yaml``.

    Raises:
        WriterError: the disk is full, or the folder holds a dataset of another recipe.
        EpisodeError: a drive cannot be read.
    """
    plan = plan_dataset(config)
    clock = DatasetClock(plan, config.replay.unit_s, progress or (lambda _: None))
    recipe = _recipe(config)
    with _begun(config.out, recipe):
        for drive in plan.drives:
            if not drive.is_whole:
                _make_drive(config, drive.town, _episode(config, drive, clock, record), clock)
        manifest = DatasetManifest.read(config.out, WriterError)
        write_manifest(config.out, manifest.drives, recipe)
        shutil.rmtree(config.out / WORK, ignore_errors=True)
    return DatasetFolder(config.out).description


def copy_manifest(dataset: Path, folder: Path) -> None:
    """Copy all that the same dataset is made of: drives, recipe, and checksums to compare with.

    Args:
        dataset: Folder of a finished dataset.
        folder: New folder.

    Raises:
        OutputError: the folder exists.
    """
    if folder.exists():
        raise OutputError(f"{folder} exists; choose another --manifest")
    shutil.copytree(dataset / EPISODES, folder / EPISODES)
    for name in (DATASET, CHECKSUMS):
        shutil.copy(dataset / name, folder / name)


def _recipe(config: DatasetConfig) -> dict[str, Any]:
    """All that decides about the dataset beside the drives, as plain values."""
    r = config.replay
    return {
        "towns": list(config.towns), "weathers": list(r.weathers), "traffic": list(r.traffic),
        "rig": r.rig, "formats": list(r.formats), "topics": r.topics, "quality": r.quality,
        "preview": r.preview, "lens_drops": r.lens_drops, "leaf_wind_mps": r.leaf_wind_mps,
        "noise_seed": r.seed, "sample_s": config.sample_s,
        "drive_seeds": {town: config.seed_of(town) for town in config.towns},
        "episodes": None if config.episodes is None else "a person's",
    }  # fmt: skip


@contextmanager
def _begun(out: Path, recipe: dict[str, Any]) -> Iterator[None]:
    """Hold the folder for one run; refuse one in which another dataset has been begun, or another run works.

    Raises:
        WriterError: it is refused.
    """
    (out / WORK).mkdir(parents=True, exist_ok=True)
    with (out / WORK / "recipe.json").open("a+", encoding="utf-8") as file:
        if not take_lock(file):
            raise WriterError(
                f"another run is at work in {out}; wait until it has ended, or choose another --out"
            )
        file.seek(0)
        text = file.read()
        found: Any = json.loads(text) if text else {}
        if not found and DatasetFolder(out).description.exists():
            found = DatasetManifest.read(out, WriterError).recipe or {"towns": None}
        other = [name for name, value in recipe.items() if found and found.get(name) != value]
        if other:
            raise WriterError(
                f"{out} holds a dataset of other {other[0]}; choose another --out or delete it first"
            )
        if not text:
            file.write(json.dumps(recipe))
            file.flush()
        yield


def _episode(config: DatasetConfig, drive: DrivePlan, clock: DatasetClock, record: Record | None) -> Path:
    """The drive of a town, recorded if there is none yet; a copy of it lies in the dataset."""
    town = drive.town
    target = DatasetFolder(config.out).episode(town)
    if target.exists():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    if config.episodes is not None:
        part = target.with_suffix(".part")
        shutil.copy(config.episodes / f"{town}.mcap", part)
        return part.replace(target)
    duration_s = None if config.sample_s is None else SAMPLE_FROM_S + config.sample_s + 0.1
    _log.info("driving through %s", town)
    for rest in target.parent.glob(f"{town}.mcap.*"):
        rest.unlink()
    if record is None:
        raise ConfigError(f"there is no drive through {town}, and nobody to record one; give episodes")
    stage = clock.stage(town, DRIVING, target.parent)
    record(town, target, duration_s, lambda driven_s: stage.update(driven_s, drive.recorded_s))
    _log.info("drove through %s in %s", town, duration_text(stage.finish()))
    return target


def _make_drive(config: DatasetConfig, town: str, episode: Path, clock: DatasetClock) -> None:
    """Replay a drive; an interrupted replay goes on where it was."""
    begin_s = 0.0 if config.sample_s is None or config.episodes is not None else SAMPLE_FROM_S
    _log.info("replaying %s", town)
    stage = clock.stage(town, REPLAYING, config.out / FOLDER)
    options = {field.name: getattr(config.replay, field.name) for field in fields(ReplayOptions)}
    replay(
        ReplayConfig(**options, episode=episode, out=config.out, start_s=begin_s, duration_s=config.sample_s),
        stage.update,
    )
    _log.info("replayed %s in %s", town, duration_text(stage.finish()))
    clock.finish(town)
