"""The whole dataset: a drive in each town, each of them replayed under all conditions.

The scripted driver records the drives with fixed seeds, or a person has driven them. Each is replayed into
the same folder. The same command resumes an interrupted run.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import OutputError, WriterError
from carlaloc_env.core.files.output_paths import atomic_write, take_lock
from recorder.dataset.layout import CHECKSUMS, DATASET, EPISODES, DatasetFolder
from recorder.dataset.manifest import DatasetManifest, write_manifest
from recorder.factory.plan import SAMPLE_FROM_S, DatasetConfig, length_s, plan_dataset
from recorder.factory.record_drive import record_drive
from recorder.replaying.plan import ReplayConfig, ReplayOptions
from recorder.replaying.replay import replay

WORK = ".carlaloc-dataset"
"""Folder with the recipe of the run; locked, so that only a single run works at a time."""
Progress = Callable[[float, float, str], None]
"""Called about every second with seconds of driving that are replayed and in all, and the present step."""
_log = logging.getLogger(__name__)


def make_dataset(config: DatasetConfig, progress: Progress | None = None) -> Path:
    """Record, replay and list all drives; whole ones are kept.

    Args:
        config: The dataset.
        progress: Called with the progress of all drives.

    Returns:
        ``dataset.yaml``.

    Raises:
        WriterError: the disk is too small, or the folder holds a dataset of another recipe.
        EpisodeError: a drive cannot be read.
    """
    plan = plan_dataset(config)
    lengths_s = dict(plan.lengths_s)
    recipe = _recipe(config)
    with _begun(config.out, recipe):
        for number, town in enumerate(config.towns):
            if town in plan.whole:
                continue
            report = _DriveProgress(progress, lengths_s, number)
            _get_drive(config, town, report)
            lengths_s[town] = length_s(config, town)
            later = tuple(lengths_s[t] for t in config.towns[number + 1 :] if t not in plan.whole)
            _make_drive(config, town, report, later)
        manifest = DatasetManifest.read(config.out, WriterError)
        write_manifest(config.out, manifest.drives, recipe)
        shutil.rmtree(config.out / WORK, ignore_errors=True)
    return DatasetFolder(config.out).description


class _DriveProgress:
    """Reports the progress of a drive as a part of all drives."""

    def __init__(self, progress: Progress | None, lengths_s: Mapping[str, float], number: int) -> None:
        self._progress, self._lengths_s = progress, lengths_s
        self._town, self._before = list(lengths_s)[number], list(lengths_s)[:number]
        self._name = f"{self._town} ({number + 1} of {len(lengths_s)})"

    def driving(self, driven_s: float, route_m: float) -> None:
        self._report(0.0, f"driving through {self._name}, {driven_s:.0f} s")

    def replaying(self, done_s: float, total_s: float) -> None:
        share = min(done_s / max(total_s, 1e-9), 1.0)
        self._report(share, f"replaying {self._name}, {share:.0%}")

    def _report(self, share: float, what: str) -> None:
        if self._progress is not None:
            done_s = sum(self._lengths_s[town] for town in self._before) + share * self._lengths_s[self._town]
            self._progress(done_s, sum(self._lengths_s.values()), what)


def copy_manifest(dataset: Path, folder: Path) -> None:
    """Copy the input of the dataset: drives and recipe, with checksums to compare.

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
    """Everything that determines the dataset beside the drives, as plain values."""
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
    """Hold the folder for one run; refuse one in which another dataset was begun, or another run works.

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


def _get_drive(config: DatasetConfig, town: str, report: _DriveProgress) -> None:
    """Put the drive of a town into the dataset: a copy of a person's, or a new one by the scripted driver."""
    target = DatasetFolder(config.out).episode(town)
    if target.exists():
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    if config.episodes is not None:
        with atomic_write(target, WriterError) as part:
            shutil.copy(config.episodes / f"{town}.mcap", part)
        return
    duration_s = None if config.sample_s is None else SAMPLE_FROM_S + config.sample_s + 0.1
    record_drive(town, target, seed=config.seed_of(town), duration_s=duration_s, progress=report.driving)


def _make_drive(config: DatasetConfig, town: str, report: _DriveProgress, later_s: Sequence[float]) -> None:
    """Replay a drive, or resume its replay."""
    begin_s = 0.0 if config.sample_s is None or config.episodes is not None else SAMPLE_FROM_S
    _log.info("replaying %s", town)
    options = {field.name: getattr(config.replay, field.name) for field in fields(ReplayOptions)}
    replayed = ReplayConfig(
        **options,
        episode=DatasetFolder(config.out).episode(town),
        out=config.out,
        start_s=begin_s,
        duration_s=config.sample_s,
    )
    replay(replayed, report.replaying, later_s=later_s)
    _log.info("%s is whole", town)
