"""The whole dataset: a drive in each town, each of them replayed under all conditions.

Drives are recorded by the scripted driver with fixed seeds, or are a person's. Each is a replay in a folder
of its own below ``OUT/.carlaloc-dataset`` until it is whole, so that the same command goes on where it was.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env import TOWNS
from carlaloc_env.core.errors import ConfigError, OutputError, WriterError
from carlaloc_env.core.output_paths import check_output_folder, path_below
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.town.sources import known_towns
from recorder.episode.episode import Episode
from recorder.generation.conditions import conditions_of
from recorder.generation.dataset_manifest import FILE_NAME, as_yaml, checksums
from recorder.generation.replay import replay
from recorder.generation.replay_plan import ReplayConfig
from recorder.generation.size_estimate import bytes_per_second

WORK = ".carlaloc-dataset"
"""Folder of drives that are not whole yet."""
DRIVE = "drive.yaml"
"""What a town's folder says of its drive: where it comes from, and checksums."""
EPISODES = "episodes"
"""Folder of the recorded drives."""
SAMPLE_FROM_S = 8.0
"""Where a sample begins [s]: the car has left the kerb then."""
ROUTE_M = {
    "Town01": 678, "Town03": 970, "Town04": 2108, "Town05": 473, "Town06": 266, "Town07": 747, "Town10": 1115,
}  # fmt: skip
"""Lengths of the paper's routes [m] (Table III)."""
PACE_MPS = 5.0
"""Pace of a drive, waiting included, by which its length is guessed before it is driven [m/s]."""

Progress = Callable[[str, float, float], None]
"""Called with the stage, and seconds of all drives that are done and in all."""
Record = Callable[[str, Path, float | None, Callable[[], None]], None]
"""Records a drive through a town, of a length [s] or along the whole route; calls the last while it lasts."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetConfig:
    """What the dataset consists of."""

    out: Path
    """Folder of the dataset."""
    towns: tuple[str, ...] = TOWNS
    """Names of the towns."""
    weathers: tuple[str, ...] = ("ClearNoon", "FoggyNoon", "RainyNight")
    """Names of the weathers."""
    traffic: tuple[str, ...] = ("static", "dynamic")
    """Traffic levels."""
    episodes: Path | None = None
    """Folder of a person's drives, ``<town>.mcap``; None: the scripted driver records them."""
    sample_s: float | None = None
    """Length of the stretch of each drive [s]; None: all of it."""
    replay: ReplayConfig
    """Rig, formats, topics, quality, workers; episode, folder and conditions come from here."""
    seed: int = 0
    """Seed by which drives are recorded."""

    def __post_init__(self) -> None:
        for town in self.towns:
            if town not in known_towns():
                raise ConfigError(f"no town '{town}'; use some of {', '.join(TOWNS)}")
        conditions_of(self.weathers, self.traffic)


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetPlan:
    """What will be made."""

    sequences: int
    """Number of sequences."""
    driven_s: float
    """Length of all drives together [s]; a rough one where they are yet to be recorded."""
    size: float
    """Size of the dataset [bytes], roughly."""
    needed: float
    """Most disk space while it is made [bytes], roughly."""


@dataclass(frozen=True, slots=True)
class _Stage:
    """One town in the progress of all."""

    name: str
    tell: Progress
    begin_s: float
    length_s: float
    total_s: float

    def driving(self) -> None:
        """Tell that its drive is being recorded."""
        self.tell(f"{self.name} driving", self.begin_s, self.total_s)

    def replaying(self, done_s: float, all_s: float) -> None:
        """Tell how far its replay is."""
        self.tell(f"{self.name} replaying", self.begin_s + self.length_s * done_s / all_s, self.total_s)


def plan_dataset(config: DatasetConfig) -> DatasetPlan:
    """Look at what is asked for, before the first byte.

    Raises:
        ConfigError: an unknown rig, town, weather or level, or no drive of a town.
        WriterError: too little disk space.
        OutputError: the folder cannot be written.
    """
    check_output_folder(config.out)
    lengths = {town: _length_s(config, town) for town in config.towns}
    rate = bytes_per_second(rig_by_name(config.replay.rig), config.replay.formats, config.replay.topics)
    conditions = len(conditions_of(config.weathers, config.traffic))
    size = rate * conditions * sum(lengths.values())
    left = [town for town in config.towns if not path_below(config.out, town).exists()]
    # The spools of a drive lie beside what has been assembled of it.
    needed = (
        rate * conditions * (sum(lengths[town] for town in left) + max((lengths[t] for t in left), default=0))
    )
    free = shutil.disk_usage(_existing(config.out)).free
    if needed > free:
        raise WriterError(
            f"the dataset needs about {needed / 1e9:.0f} GB while it is made, and {free / 1e9:.0f} GB "
            f"are free in {config.out}; make room, or take fewer --towns, another --format or --sample"
        )
    return DatasetPlan(
        sequences=conditions * len(config.towns), driven_s=sum(lengths.values()), size=size, needed=needed
    )


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
    tell = progress or (lambda *_: None)
    recipe = _recipe(config)
    _check_recipe(config.out, recipe)
    total_s = plan_dataset(config).driven_s
    done_s = 0.0
    for number, town in enumerate(config.towns, 1):
        length_s = _length_s(config, town)
        if not path_below(config.out, town).exists():
            stage = _Stage(f"{town} ({number} of {len(config.towns)})", tell, done_s, length_s, total_s)
            _make_drive(config, town, _episode(config, town, stage, record), stage)
        done_s += length_s
    drives = {
        town: {
            key: value
            for key, value in yaml.safe_load((config.out / town / DRIVE).read_text("utf-8")).items()
            if key not in ("sha256", "sequences")
        }
        for town in config.towns
    }
    sequences = sorted(
        str(path.parent.relative_to(config.out)) for path in config.out.glob("*/*/sequence.yaml")
    )
    document = {
        "recipe": recipe,
        "topics": config.replay.topics,
        "drives": drives,
        "sequences": sequences,
        "sha256": checksums(config.out),
    }
    part = config.out / f".{FILE_NAME}.part"
    part.write_text(as_yaml(document), encoding="utf-8")
    part.replace(config.out / FILE_NAME)
    shutil.rmtree(config.out / WORK, ignore_errors=True)
    return config.out / FILE_NAME


def write_manifest(dataset: Path, folder: Path) -> None:
    """Write what anybody needs to make the same dataset: drives, recipe, checksums of all files.

    Args:
        dataset: Folder of a finished dataset.
        folder: New folder.

    Raises:
        OutputError: the folder exists.
    """
    if folder.exists():
        raise OutputError(f"{folder} exists; choose another --manifest")
    shutil.copytree(dataset / EPISODES, folder / EPISODES)
    shutil.copy(dataset / FILE_NAME, folder / FILE_NAME)


def _recipe(config: DatasetConfig) -> dict[str, Any]:
    """All that decides about the dataset beside the drives, as plain values."""
    r = config.replay
    return {
        "towns": list(config.towns), "weathers": list(config.weathers), "traffic": list(config.traffic),
        "rig": r.rig, "formats": list(r.formats), "topics": r.topics, "quality": r.quality,
        "preview": r.preview, "noise_seed": r.seed, "seed": config.seed, "sample_s": config.sample_s,
        "episodes": None if config.episodes is None else "a person's",
    }  # fmt: skip


def _check_recipe(out: Path, recipe: dict[str, Any]) -> None:
    """Refuse a folder in which another dataset has been begun."""
    file = out / WORK / "recipe.json"
    finished = out / FILE_NAME
    if finished.exists():
        found = yaml.safe_load(finished.read_text("utf-8")).get("recipe")
    elif file.exists():
        found = json.loads(file.read_text("utf-8"))
    else:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(recipe), encoding="utf-8")
        return
    other = [name for name, value in recipe.items() if (found or {}).get(name) != value]
    if other:
        raise WriterError(
            f"{out} holds a dataset of other {other[0]}; choose another --out or delete it first"
        )


def _episode(config: DatasetConfig, town: str, stage: _Stage, record: Record | None) -> Path:
    """The drive of a town, recorded if there is none yet; a copy of it lies in the dataset."""
    target = config.out / EPISODES / f"{town}.mcap"
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
    record(town, target, duration_s, stage.driving)
    return target


def _make_drive(config: DatasetConfig, town: str, episode: Path, stage: _Stage) -> None:
    """Replay a drive in a folder of its own, and give the town's folder its name."""
    work = path_below(config.out / WORK, town)
    begin_s = 0.0 if config.sample_s is None or config.episodes is not None else SAMPLE_FROM_S
    if not (work / town / DRIVE).exists():
        if not (work / FILE_NAME).exists():
            _log.info("replaying %s", town)
            replay(
                replace(
                    config.replay,
                    episode=episode,
                    out=work,
                    weathers=config.weathers,
                    traffic=config.traffic,
                    start_s=begin_s,
                    duration_s=config.sample_s,
                ),
                stage.replaying,
            )
        (work / FILE_NAME).rename(work / town / DRIVE)
    (work / town).rename(path_below(config.out, town))
    shutil.rmtree(work)
    _log.info("%s is whole", town)


def _length_s(config: DatasetConfig, town: str) -> float:
    for folder in (config.out / EPISODES, config.episodes):
        if folder is not None and (folder / f"{town}.mcap").exists():
            whole_s = float(Episode.load(folder / f"{town}.mcap").duration_s)
            return whole_s if config.sample_s is None else min(config.sample_s, whole_s)
    if config.episodes is not None:
        raise ConfigError(f"{config.episodes} holds no {town}.mcap; record it, or leave it out of --towns")
    return ROUTE_M.get(town, 800) / PACE_MPS if config.sample_s is None else config.sample_s


def _existing(folder: Path) -> Path:
    return next(one for one in (folder.absolute(), *folder.absolute().parents) if one.exists())
