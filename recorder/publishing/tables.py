"""Trajectories and conditions of a dataset as Parquet, which hubs show as tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from carlaloc_env.core.errors import ConfigError
from recorder.evaluation.trajectory_files import read_tum

TRAJECTORIES, CONDITIONS = "data/trajectories.parquet", "data/conditions.parquet"
"""Paths of the tables in a folder for a hub."""


def write_trajectories(dataset: Path, path: Path) -> int:
    """Write the true poses of all frames of all towns, a row each.

    Columns: town, frame, stamp_ns, tx ty tz [m], qx qy qz qw; the world of `docs/conventions.md`.

    Returns:
        Number of rows.
    """
    arrow, parquet = _pyarrow()
    columns: dict[str, list[Any]] = {"town": [], "frame": [], "stamp_ns": [], "pose": []}
    for file in sorted(dataset.glob("*/ground_truth/*.tum")):
        truth = read_tum(file)
        columns["town"].append(np.full(len(truth.stamp_ns), file.parents[1].name))
        columns["frame"].append(np.full(len(truth.stamp_ns), file.stem))
        columns["stamp_ns"].append(truth.stamp_ns)
        columns["pose"].append(np.hstack([truth.position_m, truth.quat_xyzw]))
    poses = np.concatenate(columns.pop("pose"))
    table = {name: np.concatenate(parts) for name, parts in columns.items()}
    table |= dict(zip(("tx", "ty", "tz", "qx", "qy", "qz", "qw"), poses.T, strict=True))
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(arrow.table(table), path, compression="zstd")
    return len(poses)


def write_conditions(dataset: Path, path: Path, sha256: dict[str, str]) -> int:
    """Write a row for each sequence: town, weather, traffic, rig, samples and their number, checksum.

    Args:
        dataset: The dataset.
        path: File to write.
        sha256: Checksums of all files of the dataset.

    Returns:
        Number of rows.
    """
    arrow, parquet = _pyarrow()
    rows = []
    for file in sorted(dataset.glob("*/*/sequence.yaml")):
        found = yaml.safe_load(file.read_text("utf-8"))
        name = str(file.parent.relative_to(dataset))
        rows.append(
            {
                "sequence": name,
                "town": file.parents[1].name,
                "weather": found["weather"]["name"],
                "traffic": found["traffic"]["name"],
                "traffic_fraction": float(found["traffic"]["fraction"]),
                "rig": found["rig"],
                "samples": sum(found["samples"].values()),
                "samples_by_stream": json.dumps(found["samples"]),
                "weather_parameters": json.dumps(found["weather"]),
                "size_bytes": sum(p.stat().st_size for p in file.parent.rglob("*") if p.is_file()),
                "sha256": sha256[f"{name}/sequence.yaml"],
            }
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(arrow.Table.from_pylist(rows), path, compression="zstd")
    return len(rows)


def check_parquet() -> None:
    """Make sure that tables can be written.

    Raises:
        ConfigError: pyarrow is missing.
    """
    _pyarrow()


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ConfigError(f"Parquet needs pyarrow ({error}); pip install 'carlaloc-env[report]'") from error
    return pyarrow, parquet
