"""The whole dataset: a drive in each town, each of them replayed under all conditions.

Drives are the standard ones, or others by the scripted driver, or a person's. All are replayed into one
folder, after a plan that is checked before the first byte. The same command resumes an interrupted run.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.ego import DEFAULT_RIDE
from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.core.files.atomic_files import atomic_write, remove
from carlaloc_env.core.files.config_files import set_paths
from carlaloc_env.core.files.file_locks import claim
from carlaloc_env.core.files.output_paths import check_output_folder
from carlaloc_env.map.sources import ALIASES, known_towns
from carlaloc_env.rigs.presets import RIG_RIDES
from recorder.dataset.layout import EPISODES, SEQUENCE, DatasetFolder, files_below
from recorder.dataset.manifest import DatasetManifest, write_manifest
from recorder.drive.standard_drives import ROUTE_M, STANDARD_SEEDS, expected_drive_s, record_drive
from recorder.episode.episode import Episode
from recorder.replaying.conditions import conditions_of
from recorder.replaying.cost import ReplayCost, replay_cost
from recorder.replaying.options import ReplayOptions, rig_of
from recorder.replaying.replay import replay
from recorder.replaying.working_folder import OWNER, busy
from recorder.writers.stream_sizes import Stretch

SAMPLE_FROM_S = 8.0
"""Where a sample begins [s]: the car has left the kerb then."""
WORK = ".carlaloc-dataset"
"""Folder with the recipe of the run; locked, so that only a single run works at a time."""
Progress = Callable[[float, float, str], None]
"""Called about every second with seconds of driving that are replayed and in all, and the present step."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetConfig:
    """Configuration of a dataset."""

    out: Path
    """Folder of the dataset."""
    towns: tuple[str, ...] = tuple(ROUTE_M)
    """Names of the towns."""
    episodes: Path | None = None
    """Folder of a person's drives, ``<town>.mcap``; None: the scripted driver records them."""
    sample_s: float | None = None
    """Length of the stretch of each drive [s]; None: all of it."""
    replay: ReplayOptions
    """Conditions, rig, formats, topics, quality, workers."""
    seed: int | None = None
    """Seed by which drives are recorded; None: the standard drive of each town."""

    def __post_init__(self) -> None:
        set_paths(self, "out", "episodes")
        for town in self.towns:
            if town not in known_towns():
                raise ConfigError(f"no town '{town}'; use some of {', '.join(ROUTE_M)}")
        conditions_of(self.replay.weathers, self.replay.traffic)

    def seed_of(self, town: str) -> int:
        """Seed by which a town's drive is recorded."""
        return STANDARD_SEEDS.get(town, 0) if self.seed is None else self.seed


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetPlan:
    """Plan of a dataset: its sequences and lengths, finished parts, and cost."""

    sequences: int
    """Number of sequences."""
    lengths_s: dict[str, float]
    """Length of each town's stretch [s]; an estimate where the drive is not recorded yet."""
    whole: tuple[str, ...]
    """Towns whose sequences are all finished."""
    drives: int
    """Drives that are already recorded or copied."""
    parts: int
    """Finished units and sequences of unfinished towns."""
    kept: int
    """Size of all existing files [bytes]."""
    cost: ReplayCost
    """Disk and time that all drives take, those that are whole included."""

    @property
    def driven_s(self) -> float:
        """Length of all drives together [s]."""
        return sum(self.lengths_s.values())


def town_names(names: Sequence[str]) -> tuple[str, ...]:
    """Towns without repetition, by their main names."""
    return tuple(dict.fromkeys(ALIASES.get(name, name) for name in names))


def plan_dataset(config: DatasetConfig) -> DatasetPlan:
    """Check a request, before the first byte.

    Raises:
        ConfigError: an unknown rig, town, weather or level, or no drive of a town.
        OutputError: the folder cannot be written.
        WriterError: the disk is too small.
    """
    check_output_folder(config.out)
    rig_of(config.replay)
    has_drives = DatasetFolder(config.out).description.exists()
    whole = DatasetManifest.read(config.out, WriterError).drives if has_drives else {}
    there = files_below(config.out)
    kept = sum(path.stat().st_size for path in there)
    lengths_s = {town: length_s(config, town) for town in config.towns}
    workers = config.replay.workers or len(usable_cores())
    cost = replay_cost(config.replay, [Stretch(s, s) for s in lengths_s.values()], workers)
    cost.check(config.out, kept_bytes=kept)
    return DatasetPlan(
        sequences=len(config.towns) * len(conditions_of(config.replay.weathers, config.replay.traffic)),
        lengths_s=lengths_s,
        whole=tuple(town for town in config.towns if town in whole),
        drives=len([*(config.out / EPISODES).glob("*.mcap")]),
        parts=sum(_is_part(path.relative_to(config.out)) for path in there),
        kept=kept,
        cost=cost,
    )


def length_s(config: DatasetConfig, town: str) -> float:
    """Length of the stretch of a drive that is replayed [s]; an estimate where there is no drive yet.

    Raises:
        ConfigError: a person's drive is missing or was driven elsewhere.
    """
    for folder in (config.out / EPISODES, config.episodes):
        if folder is not None and (folder / f"{town}.mcap").exists():
            episode = Episode.load(folder / f"{town}.mcap")
            if episode.header.map_name != town:
                raise ConfigError(
                    f"{folder / town}.mcap was driven in {episode.header.map_name}; name it "
                    f"{episode.header.map_name}.mcap"
                )
            whole_s = float(episode.duration_s)
            return whole_s if config.sample_s is None else min(config.sample_s, whole_s)
    if config.episodes is not None:
        raise ConfigError(f"{config.episodes} holds no {town}.mcap; record it, or leave it out of --towns")
    return expected_drive_s(town) if config.sample_s is None else config.sample_s


def _is_part(path: Path) -> bool:
    """Whether a file of the dataset makes a unit or a sequence whole in a working folder."""
    return path.parts[0].startswith(".") and path.name in ("unit.json", SEQUENCE)


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


def _recipe(config: DatasetConfig) -> dict[str, Any]:
    """Recipe of a dataset as plain values: everything that determines it beside the drives."""
    r = config.replay
    return {
        "towns": list(config.towns), "weathers": list(r.weathers), "traffic": list(r.traffic),
        "rig": r.rig, "formats": list(r.formats), "topics": r.topics, "quality": r.quality,
        "preview": r.preview, "truth_tf": r.truth_tf, "clock": r.clock,
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
        if (holder := claim(out / WORK / OWNER, file)) is not None:
            raise WriterError(busy(out, holder))
        file.seek(0)
        text = file.read()
        begun_recipe: Any = json.loads(text) if text else {}
        if not begun_recipe and DatasetFolder(out).description.exists():
            begun_recipe = DatasetManifest.read(out, WriterError).recipe or {"towns": None}
        other = [name for name, value in recipe.items() if begun_recipe and begun_recipe.get(name) != value]
        if other:
            raise WriterError(
                f"{out} holds a dataset of other {other[0]}; choose another --out or delete it first"
            )
        if not text:
            file.write(json.dumps(recipe))
            file.flush()
        try:
            yield
        finally:
            remove(out / WORK / OWNER)


def _get_drive(config: DatasetConfig, town: str, report: _DriveProgress) -> None:
    """Add the drive of a town to the dataset: a copy of a person's, or a new one by the scripted driver."""
    target = DatasetFolder(config.out).episode(town)
    if target.exists():
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    if config.episodes is not None:
        with atomic_write(target, WriterError) as part:
            shutil.copy(config.episodes / f"{town}.mcap", part)
        return
    duration_s = None if config.sample_s is None else SAMPLE_FROM_S + config.sample_s + 0.1
    ride = RIG_RIDES.get(config.replay.rig, DEFAULT_RIDE)
    record_drive(
        town, target, seed=config.seed_of(town), duration_s=duration_s, ride=ride,
        progress=report.driving,
    )  # fmt: skip


def _make_drive(config: DatasetConfig, town: str, report: _DriveProgress, later_s: Sequence[float]) -> None:
    """Replay a drive, or resume its replay."""
    begin_s = 0.0 if config.sample_s is None or config.episodes is not None else SAMPLE_FROM_S
    _log.info("replaying %s", town)
    replayed = config.replay.of_drive(
        episode=DatasetFolder(config.out).episode(town),
        out=config.out,
        start_s=begin_s,
        duration_s=config.sample_s,
    )
    replay(replayed, report.replaying, later_s=later_s)
    _log.info("%s is whole", town)
