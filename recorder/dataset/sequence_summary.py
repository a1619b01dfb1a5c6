"""What a finished sequence amounts to, from its `sequence.yaml`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.files.text_files import read_text

FILE_NAME = "sequence.yaml"
"""Name of the file in a sequence's folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceSummary:
    """Figures of a sequence."""

    path: str
    """Folder."""
    name: str
    """Weather and traffic level."""
    rig: str
    """Sensor rig."""
    samples: dict[str, int]
    """Number of samples by stream."""
    movers: dict[str, float]
    """Fraction of labelled points and pixels that lie on vehicles and walkers of the traffic, by stream."""


def is_sequence(path: Path) -> bool:
    """Whether a path is a folder, or the `sequence.yaml` in one."""
    return path.is_dir() or path.name == FILE_NAME


def summarise_sequence(path: Path) -> SequenceSummary:
    """Figures of a sequence.

    Raises:
        ConfigError: the folder holds no finished sequence, or its file cannot be read.
    """
    file = path / FILE_NAME if path.is_dir() else path
    if not file.exists():
        raise ConfigError(
            f"{path} holds no {FILE_NAME}; give the folder of one sequence, or an episode (.mcap)"
        )
    try:
        found: Any = yaml.safe_load(read_text(file, "sequence's description"))
        return SequenceSummary(
            path=str(file.parent),
            name=str(found["name"]),
            rig=str(found["rig"]),
            samples={str(k): int(v) for k, v in found["samples"].items()},
            movers={str(k): float(v) for k, v in found.get("movers", {}).items()},
        )
    except (AttributeError, KeyError, TypeError, ValueError, yaml.YAMLError) as error:
        raise ConfigError(f"cannot read {file}: {' '.join(str(error).split())}; replay it anew") from error
