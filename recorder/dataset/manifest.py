"""``dataset.yaml``: where a dataset comes from, its sequences, and a checksum of every file."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.files.config_mapping import to_mapping
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.town.sources import TownId
from recorder.episode.episode import Episode

FILE_NAME = "dataset.yaml"
"""Name of the file in the dataset's folder."""
VERSIONED = ("carlaloc-env", "numpy", "open3d", "moderngl", "opencv-python-headless", "rosbags")
"""Distributions whose versions shape a dataset."""


def origin_of(
    town: TownId, episode: Episode, rig: SensorRig, *, seed: int, span_ns: tuple[int, int], topics: str
) -> dict[str, Any]:
    """What all sequences of a dataset share, as YAML values.

    Args:
        town: The town.
        episode: The drive.
        rig: The sensors.
        seed: Seed of their noise.
        span_ns: First stamp and end (not included) of the stretch [ns].
        topics: Topic profile of bags and calibration.
    """
    header = episode.header
    origin = {
        "town": town.name,
        "town_hash": header.town_hash,
        "episode": {
            "file": episode.path.name,
            "sha256": hashlib.sha256(episode.path.read_bytes()).hexdigest(),
            "seed": header.seed,
            "device": header.device,
            "duration_s": episode.duration_s,
            "traffic": dict(header.traffic),
            "versions": dict(header.versions),
        },
        "noise_seed": seed,
        "stretch_s": [span_ns[0] / 1e9, span_ns[1] / 1e9],
        "topics": topics,
        "rig": {"name": rig.name, "sensors": [{"kind": s.kind, **to_mapping(s)} for s in rig.sensors]},
    }
    plain: dict[str, Any] = yaml.safe_load(as_yaml(origin))
    return plain


def is_begun(out: Path, origin: dict[str, Any]) -> bool:
    """Whether the folder holds a dataset of this origin, to which sequences can be added.

    Raises:
        WriterError: it holds one of another drive, rig, stretch or noise.
    """
    path = out / FILE_NAME
    if not path.exists():
        return False
    try:
        found = yaml.safe_load(read_text(path, "dataset's description", WriterError))
        other = [key for key, value in origin.items() if found.get(key) != value]
    except (OSError, AttributeError, yaml.YAMLError) as error:
        raise WriterError(
            f"cannot read {path}: {' '.join(str(error).split())}; choose another --out"
        ) from error
    if other:
        raise WriterError(
            f"{out} holds a dataset of another {other[0]}; choose another --out or delete it first"
        )
    return True


def write_record(out: Path, origin: dict[str, Any]) -> Path:
    """Write ``dataset.yaml`` anew: origin, versions, every finished sequence, every file's checksum.

    Raises:
        WriterError: it cannot be written.
    """
    sequences = sorted(str(path.parent.relative_to(out)) for path in out.glob("*/*/sequence.yaml"))
    document = {
        **origin,
        "versions": {**{name: version(name) for name in VERSIONED}, "python": platform.python_version()},
        "sequences": [name for name in sequences if ".part" not in name],
        "sha256": checksums(out),
    }
    part = out / f".{FILE_NAME}.part"
    try:
        part.write_text(as_yaml(document), encoding="utf-8")
        return part.replace(out / FILE_NAME)
    except OSError as error:
        raise WriterError(f"cannot write {out / FILE_NAME}: {error.strerror}") from error


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of every file below a folder, by its path there; big files are read in pieces."""
    found: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        if path.is_file() and not hidden and path.name != FILE_NAME:
            digest = hashlib.sha256()
            with path.open("rb") as file:
                while piece := file.read(1 << 20):
                    digest.update(piece)
            found[str(path.relative_to(folder))] = digest.hexdigest()
    return found


def as_yaml(document: dict[str, Any]) -> str:
    """A YAML document with keys in their order."""
    text: str = yaml.safe_dump(
        document, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
    )
    return text
