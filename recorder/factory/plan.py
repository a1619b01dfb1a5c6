"""What a dataset of several drives will be, looked at before the first byte: sequences, time, size, room."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.core.files.output_paths import check_output_folder
from carlaloc_env.town.sources import ALIASES, known_towns
from recorder.dataset.layout import EPISODES, DatasetFolder
from recorder.dataset.manifest import DatasetManifest
from recorder.episode.episode import Episode
from recorder.factory.quantities import size_text
from recorder.factory.size_estimate import bytes_per_second, spool_bytes_per_second
from recorder.factory.time_estimate import DRIVING_COST, processes_of, replay_cost
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
    """What the dataset consists of."""

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
class DrivePlan:
    """One town of a dataset."""

    town: str
    """Its name."""
    length_s: float
    """Length of the stretch that is replayed [s]; a rough one where the drive is yet to be recorded."""
    recorded_s: float
    """Length of the drive that is yet to be recorded [s]; 0: there is one."""
    is_whole: bool
    """Whether all its sequences are there."""
    driving_s: float
    """Time that recording takes [s], roughly."""
    replaying_s: float
    """Time that its sequences take [s], roughly."""


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
    """Most disk space that is yet to be taken while it is made [bytes], roughly."""
    free: int
    """Disk space that is free [bytes]."""
    work_s: float
    """Time that what is left takes on this machine [s], roughly, by unit costs measured on another."""
    drives: tuple[DrivePlan, ...]
    """Towns in their order."""


def town_names(names: Sequence[str]) -> tuple[str, ...]:
    """Towns without repetition, other names of a town replaced by its own."""
    return tuple(dict.fromkeys(ALIASES.get(name, name) for name in names))


def plan_dataset(config: DatasetConfig) -> DatasetPlan:
    """Look at what is asked for, before the first byte.

    Raises:
        ConfigError: an unknown rig, town, weather or level, or no drive of a town.
        WriterError: too little disk space.
        OutputError: the folder cannot be written.
    """
    check_output_folder(config.out)
    replay = config.replay
    conditions = conditions_of(replay.weathers, replay.traffic)
    rig = rig_of(replay)
    cost, processes = replay_cost(rig, replay, conditions), processes_of(replay)
    has_drives = DatasetFolder(config.out).description.exists()
    whole = DatasetManifest.read(config.out, WriterError).drives if has_drives else {}
    drives = []
    for town in config.towns:
        length_s, recorded_s = _lengths_s(config, town)
        drives.append(
            DrivePlan(
                town=town,
                length_s=length_s,
                recorded_s=recorded_s,
                is_whole=town in whole,
                driving_s=DRIVING_COST * (recorded_s + cost.opening) if recorded_s else 0.0,
                replaying_s=cost.seconds(length_s, processes),
            )
        )
    left = [drive for drive in drives if not drive.is_whole]
    rate = len(conditions) * bytes_per_second(rig, replay.formats, replay.topics)
    # The spools of a drive lie beside what has been assembled of it.
    spools = spool_bytes_per_second(rig, replay, conditions) * max((d.length_s for d in left), default=0.0)
    plan = DatasetPlan(
        sequences=len(conditions) * len(drives),
        driven_s=sum(drive.length_s for drive in drives),
        size=rate * sum(drive.length_s for drive in drives),
        needed=rate * sum(drive.length_s for drive in left) + spools,
        free=shutil.disk_usage(_existing(config.out)).free,
        work_s=sum(drive.driving_s + drive.replaying_s for drive in left),
        drives=tuple(drives),
    )
    if plan.needed > plan.free:
        raise WriterError(
            f"the dataset needs about {size_text(plan.needed)} while it is made, and {size_text(plan.free)} "
            f"are free in {config.out}; make room for {size_text(plan.needed - plan.free)}, or take fewer "
            "--towns, another --format, --topics compact or a --sample"
        )
    return plan


def _lengths_s(config: DatasetConfig, town: str) -> tuple[float, float]:
    """Length of the stretch that is replayed, and of the drive that is yet to be recorded [s].

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
            return whole_s if config.sample_s is None else min(config.sample_s, whole_s), 0.0
    if config.episodes is not None:
        raise ConfigError(f"{config.episodes} holds no {town}.mcap; record it, or leave it out of --towns")
    if config.sample_s is None:
        length_s = ROUTE_M.get(town, 800) / PACE_MPS
        return length_s, length_s
    return config.sample_s, SAMPLE_FROM_S + config.sample_s


def _existing(folder: Path) -> Path:
    return next(one for one in (folder.absolute(), *folder.absolute().parents) if one.exists())
