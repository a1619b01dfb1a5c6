"""``dataset.yaml`` and ``sequence.yaml``: origin of a dataset, and content of each of its sequences.

A dataset has one or more drives, each in the folder of its town. `carlaloc replay` adds one drive,
`carlaloc dataset` as many as its recipe names; the description is the same.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env.core.errors import CarlaLocError, ConfigError, WriterError
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.core.files.library_versions import library_version
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.rigs.rig import SensorRig
from recorder.dataset.checksums import file_sha256, write_checksums
from recorder.dataset.layout import DATASET, DatasetFolder, SequenceFolder, sequences_below
from recorder.episode.episode import Episode
from recorder.writers.topic_profiles import profile_by_name, profile_for
from recorder.writers.topics import TopicProfile

VERSIONED = ("carlaloc", "numpy", "open3d", "moderngl", "opencv-python-headless", "rosbags")
"""Distributions whose versions shape a dataset."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetManifest:
    """Content of ``dataset.yaml``."""

    drives: Mapping[str, Mapping[str, Any]]
    """Origin of each drive, by town: `drive_origin`."""
    recipe: Mapping[str, Any] | None = None
    """Request of `carlaloc dataset`; None: the drives were replayed separately."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of the software that made the dataset, by distribution."""
    sequences: tuple[str, ...] = ()
    """Paths of all finished sequences, ``TOWN/WEATHER_TRAFFIC``."""

    @classmethod
    def read(cls, folder: Path, error: type[CarlaLocError] = ConfigError) -> DatasetManifest:
        """The manifest of a dataset.

        Raises:
            CarlaLocError: of the kind `error`; the folder holds no dataset, or its description is damaged.
        """
        file = DatasetFolder(folder).description
        if not file.is_file():
            raise error(f"{folder} holds no {DATASET}; give the folder of a finished dataset")
        try:
            document = yaml.safe_load(read_text(file, "dataset's description", error))
            return cls(
                drives=dict(document["drives"]),
                recipe=document.get("recipe"),
                versions=dict(document["versions"]),
                sequences=tuple(document["sequences"]),
            )
        except (AttributeError, KeyError, TypeError, ValueError, yaml.YAMLError) as fault:
            raise error(f"cannot read {file}: {_reason(fault)}; make the dataset anew") from fault

    def rig(self, town: str) -> SensorRig:
        """Sensors of a drive.

        Raises:
            ConfigError: the description is damaged.
        """
        return SensorRig.from_yaml(as_yaml(self._of(town, "rig")), where=DATASET)

    def profile(self, town: str) -> TopicProfile:
        """Topics of the bags of a drive.

        Raises:
            WriterError: the profile is unknown.
            ConfigError: the description is damaged.
        """
        name = str(self._of(town, "topics"))
        # A user's file is read first: its folder may hold the sensors of the rig, too.
        profile_by_name(name)
        return profile_for(name, self.rig(town).sensors)

    def _of(self, town: str, name: str) -> Any:
        try:
            return self.drives[town][name]
        except (KeyError, TypeError):
            raise ConfigError(
                f"{DATASET} has no {name} of a drive in {town}; make the dataset anew"
            ) from None


def drive_origin(
    episode: Episode,
    rig: SensorRig,
    *,
    seed: int,
    span_ns: tuple[int, int],
    topics: str,
    roadside: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Description that all sequences of a drive share, as YAML values.

    Args:
        episode: The drive.
        rig: The sensors.
        seed: Seed of their noise.
        span_ns: First stamp and end (not included) of the stretch [ns].
        topics: Topic profile of bags and calibration.
        roadside: Place of the fixed unit that carries them; None: a car does.
    """
    header = episode.header
    origin = {
        "town_hash": header.town_hash,
        "episode": {
            "file": episode.path.name,
            "sha256": file_sha256(episode.path),
            "seed": header.seed,
            "device": header.device,
            **({"car": episode.car} if header.cars and not roadside else {}),
            "duration_s": episode.duration_s,
            "traffic": dict(header.traffic),
            "versions": dict(header.versions),
        },
        **({"roadside": dict(roadside)} if roadside else {}),
        "noise_seed": seed,
        "stretch_s": [span_ns[0] / 1e9, span_ns[1] / 1e9],
        "topics": topics,
        "rig": {key: rig.to_mapping()[key] for key in ("name", "sensors")},
    }
    plain: dict[str, Any] = yaml.safe_load(as_yaml(origin))
    return plain


def has_drive(out: Path, town: str, origin: Mapping[str, Any]) -> bool:
    """Whether a folder holds a dataset with this drive, to which sequences can be added.

    Raises:
        WriterError: the town's folder is of another drive, rig, stretch or noise.
    """
    if not DatasetFolder(out).description.exists():
        return False
    drive = DatasetManifest.read(out, WriterError).drives.get(town)
    if drive is None:
        return False
    other = [key for key, value in origin.items() if drive.get(key) != value]
    if other:
        raise WriterError(
            f"{out} holds a dataset of another {other[0]} in {town}; choose another --out or delete it first"
        )
    return True


def list_drive(out: Path, town: str, origin: Mapping[str, Any]) -> None:
    """Add a drive to ``dataset.yaml``, list all finished sequences, and rewrite ``SHA256SUMS``.

    Raises:
        WriterError: they cannot be written.
    """
    drives = {town: origin}
    recipe = None
    if DatasetFolder(out).description.exists():
        manifest = DatasetManifest.read(out, WriterError)
        drives, recipe = dict(sorted({**manifest.drives, town: origin}.items())), manifest.recipe
    write_manifest(out, drives, recipe)


def write_manifest(
    out: Path, drives: Mapping[str, Mapping[str, Any]], recipe: Mapping[str, Any] | None
) -> None:
    """Write ``dataset.yaml`` and ``SHA256SUMS`` of all files in the folder.

    Raises:
        WriterError: they cannot be written.
    """
    document = {
        **({} if recipe is None else {"recipe": dict(recipe)}),
        "drives": {town: dict(origin) for town, origin in drives.items()},
        "versions": {
            **{name: library_version(name) for name in VERSIONED},
            "python": platform.python_version(),
        },
        "sequences": [str(folder.path.relative_to(out)) for folder in sequences_below(out)],
    }
    write_whole(out / DATASET, as_yaml(document), WriterError)
    write_checksums(out)


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceDescription:
    """Content of ``sequence.yaml``."""

    name: str
    """Weather and traffic level."""
    weather: Mapping[str, Any]
    """Name and parameters of the weather, or of its schedule."""
    traffic: Mapping[str, Any]
    """Traffic level."""
    rig: str
    """Name of the sensor rig."""
    epoch_ns: int
    """Unix time of the beginning of the drive in the sequence's files [ns]."""
    samples: Mapping[str, int]
    """Number of samples by stream."""
    movers: Mapping[str, float]
    """Fraction of labelled points and pixels that lie on vehicles and walkers of the traffic, by stream."""
    faults: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Faults of the sensors by sensor and name; the file of a sequence without faults has no such key."""
    readout_ms: Mapping[str, float] = field(default_factory=dict)
    """Time from the first row's exposure to the last row's by rolling-shutter camera [ms]; no key without."""

    @classmethod
    def read(cls, sequence: SequenceFolder, error: type[CarlaLocError] = ConfigError) -> SequenceDescription:
        """The description of a finished sequence.

        Raises:
            CarlaLocError: of the kind `error`; there is none, or it is damaged.
        """
        file = sequence.description
        if not file.is_file():
            raise error(f"{sequence.path} holds no {file.name}; give the folder of one sequence")
        try:
            values = yaml.safe_load(read_text(file, "sequence's description", error))
            return cls(
                name=str(values["name"]),
                weather=dict(values["weather"]),
                traffic=dict(values["traffic"]),
                rig=str(values["rig"]),
                epoch_ns=int(values["epoch_ns"]),
                samples={str(k): int(v) for k, v in values["samples"].items()},
                movers={str(k): float(v) for k, v in values["movers"].items()},
                faults=dict(values.get("faults") or {}),
                readout_ms={str(k): float(v) for k, v in (values.get("readout_ms") or {}).items()},
            )
        except (AttributeError, KeyError, TypeError, ValueError, yaml.YAMLError) as fault:
            raise error(f"cannot read {file}: {_reason(fault)}; replay it anew") from fault

    def to_yaml(self) -> str:
        """Text of the file."""
        values = asdict(self)
        return as_yaml({k: v for k, v in values.items() if v or k not in ("faults", "readout_ms")})


def _reason(fault: Exception) -> str:
    return f"{type(fault).__name__} {' '.join(str(fault).split())}"


def as_yaml(document: Any) -> str:
    """A YAML document with keys in their order."""
    text: str = yaml.safe_dump(
        document, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
    )
    return text
