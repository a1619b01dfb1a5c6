"""Your own place descriptor, scored on twins of a drive: rings around a LiDAR, independent of its heading.

python examples/robustness/16_places.py town10.mcap     prints recall at 1, 5 and 10 by day and in fog
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import PointCloud, Sample
from recorder import PlaceDrive, PlacesConfig, compare_places, score_places, similarity_of

RINGS_M = np.arange(0.0, 81.0, 4.0)
"""Distances that bound the rings [m]."""


def ring_key(sample: Sample) -> NDArray[np.float64]:
    """Highest point in each ring around the LiDAR [m], as Scan Context's ring key (Kim and Kim 2018)."""
    assert isinstance(sample, PointCloud)
    points = sample.points_xyz_m
    ring = np.digitize(np.hypot(points[:, 0], points[:, 1]), RINGS_M)
    highest = np.full(len(RINGS_M) + 1, -2.0)
    np.maximum.at(highest, ring, points[:, 2])
    return highest


def main(drive: Path) -> None:
    """Print the recall of the descriptor in each weather."""
    weathers = ("ClearNoon", "FoggyNoon")
    config = PlacesConfig(
        reference=drive, out=Path("out/places"), sensor="lidar", query_weathers=weathers, query_offset_m=1.0,
        duration_s=30.0,
    )  # fmt: skip
    tables = compare_places(config)
    overlap = tables.pairs.matrix(len(tables.query), len(tables.reference))
    known = PlaceDrive(config, drive, (config.weather,), 0.0)
    asking = PlaceDrive(config, drive, weathers, config.query_offset_m)
    reference = np.array([ring_key(row[0]) for row in known.samples(0, lambda: None)])
    rows = [[ring_key(sample) for sample in row] for row in asking.samples(1, lambda: None)]
    for weather, queries in zip(weathers, zip(*rows, strict=True), strict=True):
        score = score_places(similarity_of(reference, np.array(queries)), overlap, least=config.least_overlap)
        print(weather, *(f"recall@{n} {value:.3f}" for n, value in score.recall.items()))
        np.savez(config.out / f"ring_key_{weather}.npz", reference=reference, query=np.array(queries))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
