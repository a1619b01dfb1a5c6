"""Trajectories and conditions of a dataset as tables, which hubs show."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from recorder.dataset.layout import SEQUENCE, files_below, sequences_below
from recorder.dataset.manifest import SequenceDescription
from recorder.evaluation.trajectory_files import read_tum

if TYPE_CHECKING:
    import pandas as pd

TRAJECTORIES, CONDITIONS = "data/trajectories.parquet", "data/conditions.parquet"
"""Paths of the tables in a folder for a hub."""


def trajectories(dataset: Path) -> pd.DataFrame:
    """True poses of all frames of all towns, a row each.

    Columns: town, frame, stamp_ns, tx ty tz [m], qx qy qz qw; the world of `docs/conventions.md`.
    """
    import pandas as pd  # comes with mlcroissant

    tables = []
    for file in sorted(dataset.glob("*/ground_truth/*.tum")):
        truth = read_tum(file)
        columns = {"town": file.parents[1].name, "frame": file.stem, "stamp_ns": truth.stamp_ns}
        columns |= dict(zip(("tx", "ty", "tz"), truth.position_m.T, strict=True))
        columns |= dict(zip(("qx", "qy", "qz", "qw"), truth.quat_xyzw.T, strict=True))
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def conditions(dataset: Path, sha256: Mapping[str, str]) -> pd.DataFrame:
    """A row for each sequence: town, weather, traffic, rig, samples and their number, checksum.

    Args:
        dataset: The dataset.
        sha256: Checksums of all files of the dataset.
    """
    import pandas as pd

    rows = []
    for folder in sequences_below(dataset):
        description = SequenceDescription.read(folder)
        name = f"{folder.path.parent.name}/{folder.name}"
        rows.append(
            {
                "sequence": name,
                "town": folder.path.parent.name,
                "weather": description.weather["name"],
                "traffic": description.traffic["name"],
                "traffic_fraction": float(description.traffic["fraction"]),
                "rig": description.rig,
                "samples": sum(description.samples.values()),
                "samples_by_stream": json.dumps(description.samples),
                "weather_parameters": json.dumps(description.weather),
                "size_bytes": sum(p.stat().st_size for p in files_below(folder.path)),
                "sha256": sha256[f"{name}/{SEQUENCE}"],
            }
        )
    return pd.DataFrame(rows)
