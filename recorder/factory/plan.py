"""The plan of a dataset of several drives, checked before the first byte."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.core.files.output_paths import check_output_folder
from carlaloc_env.town.sources import ALIASES, known_towns
from recorder.dataset.layout import EPISODES, SEQUENCE, DatasetFolder
from recorder.dataset.manifest import DatasetManifest
from recorder.episode.episode import Episode
from recorder.replaying.conditions import conditions_of
from recorder.replaying.plan import ReplayOptions, rig_of

SAMPLE_FROM_S = 8.0
"""Where a sample begins [s]: the car has left the kerb then."""
ROUTE_M = {
    "Town01": 678, "Town03": 970, "Town04": 2108, "Town05": 473, "Town06": 266, "Town07": 747, "Town10": 1115,
}  # fmt: skip
"""Lengths of the paper's seven routes [m] (Table III), by town."""
STANDARD_SEEDS = {
    "Town01": 7, "Town03": 1, "Town04": 5, "Town05": 2, "Town06": 0, "Town07": 8, "Town10": 6,
}  # fmt: skip
"""Seeds of the standard drives. Of seeds 0 to 9, the one whose drive among the paper's traffic comes to the
route's end in the fewest seconds, rounded, without a collision or a broken rule; the smallest of several."""
PACE_MPS = 5.0
"""Pace of a drive, waiting included, by which its length is guessed before it is driven [m/s]."""


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
        for town in self.towns:
            if town not in known_towns():
                raise ConfigError(f"no town '{town}'; use some of {', '.join(ROUTE_M)}")
        conditions_of(self.replay.weathers, self.replay.traffic)

    def seed_of(self, town: str) -> int:
        """Seed by which a town's drive is recorded."""
        return STANDARD_SEEDS.get(town, 0) if self.seed is None else self.seed


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetPlan:
    """Work that a dataset takes."""

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
    free: int
    """Disk space that is free [bytes]."""

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
    """
    check_output_folder(config.out)
    rig_of(config.replay)
    has_drives = DatasetFolder(config.out).description.exists()
    whole = DatasetManifest.read(config.out, WriterError).drives if has_drives else {}
    there = [path for path in config.out.rglob("*") if path.is_file()]
    return DatasetPlan(
        sequences=len(config.towns) * len(conditions_of(config.replay.weathers, config.replay.traffic)),
        lengths_s={town: length_s(config, town) for town in config.towns},
        whole=tuple(town for town in config.towns if town in whole),
        drives=len([*(config.out / EPISODES).glob("*.mcap")]),
        parts=sum(_is_part(path.relative_to(config.out)) for path in there),
        kept=sum(path.stat().st_size for path in there),
        free=shutil.disk_usage(_existing(config.out)).free,
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
    return ROUTE_M.get(town, 800) / PACE_MPS if config.sample_s is None else config.sample_s


def _existing(folder: Path) -> Path:
    return next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())


def _is_part(path: Path) -> bool:
    """Whether a file of the dataset makes a unit or a sequence whole in a working folder."""
    return path.parts[0].startswith(".") and path.name in ("unit.json", SEQUENCE)
