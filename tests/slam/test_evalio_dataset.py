"""Our sequences as evalio sees them, by its own classes."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import COLUMNS, ELEVATIONS_DEG, write_dataset

from recorder.dataset.sequence import SlamSequence

pytest.importorskip("evalio", reason="the data set is a class of evalio's")


def test_sequences_are_members_with_sweeps_and_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = write_dataset(tmp_path / "d", sweeps=4)
    monkeypatch.setenv("CARLALOC_DATA", str(data))
    module = importlib.reload(importlib.import_module("recorder.slam.runners.evalio"))
    (sequence,) = module.CarlaLoc.sequences()
    assert sequence.full_name == "carla_loc/box_clearnoon_dynamic"
    assert len(sequence) == 4
    parameters = sequence.lidar_params()
    assert (parameters.num_rows, parameters.num_columns) == (len(ELEVATIONS_DEG), COLUMNS)
    scans = SlamSequence(data / "Box" / "ClearNoon_dynamic").scans()
    monkeypatch.setattr(SlamSequence, "imu_samples", lambda _: iter(()))
    for measured, scan in zip(sequence.data_iter().lidar_iter(), scans, strict=True):
        assert measured.stamp.to_nsec() == scan.stamp_ns
        points = np.array([(p.x, p.y, p.z) for p in measured.points])
        assert np.isclose(np.abs(points).sum(), np.abs(scan.points_xyz_m).sum())
