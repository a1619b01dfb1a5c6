"""Doppler-ICP's files, read as its `utils.py` reads them, against a drive in a bend in closed form."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import cloud_of, rig, truth, write_all

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Sample
from recorder.writers.formats.doppler_icp import DopplerIcpEncoder, DopplerIcpWriter
from recorder.writers.rig_calibration import RigCalibration

SPEED_MPS, RATE_RADPS, SWEEP_NS = 12.0, 0.4, 100_000_000
POINTS_M = np.random.default_rng(1).uniform([-30, -30, 0], [60, 60, 5], (300, 3))


def T_world_base(stamp_ns: int) -> np.ndarray:
    angle, radius = RATE_RADPS * 1e-9 * stamp_ns, SPEED_MPS / RATE_RADPS
    place = [radius * np.sin(angle), radius * (1 - np.cos(angle)), 0.0]
    return transforms.transform(np.array(place), transforms.rpy_to_quat(0.0, 0.0, angle))


def calibration(doppler: bool = True) -> RigCalibration:
    found = rig()
    assert found.lidar is not None
    return replace(found, lidar=replace(found.lidar, doppler=doppler))


def drive(T_base_lidar: np.ndarray, sweeps: int = 4) -> list[Sample]:
    samples: list[Sample] = []
    offsets = np.linspace(0, SWEEP_NS - 1, len(POINTS_M)).astype(np.uint32)
    for stamp in range(500_000_000, 500_000_000 + sweeps * SWEEP_NS + 1, 5_000_000):
        if stamp % SWEEP_NS == 0 and stamp < 500_000_000 + sweeps * SWEEP_NS:
            seen = [
                transforms.apply(transforms.invert(T_world_base(stamp + int(after)) @ T_base_lidar), point)
                for after, point in zip(offsets, POINTS_M, strict=True)
            ]
            cloud = cloud_of(np.array(seen), stamp, labelled=False, sweep_ns=SWEEP_NS, offset_ns=offsets)
            samples.append(replace(cloud, doppler_mps=np.linspace(-9, 9, len(POINTS_M), dtype=np.float32)))
        T = T_world_base(stamp)
        samples.append(truth(stamp, T[:3, 3], transforms.matrix_to_quat(T[:3, :3])))
    return samples


def test_points_rates_and_poses_are_those_of_the_drive(tmp_path: Path) -> None:
    found = calibration()
    assert found.lidar is not None
    T_base_lidar = found.lidar.T_base_lidar
    encoder = DopplerIcpEncoder(found, ("lidar",))
    folder = write_all(DopplerIcpWriter(tmp_path / "sequence", encoder), drive(T_base_lidar))
    files = sorted((folder / "point_clouds").iterdir())
    assert [file.name for file in files] == [f"{k:05d}.bin" for k in range(1, 5)]
    poses = np.loadtxt(folder / "ref_poses.txt")
    assert poses[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    T_first = T_world_base(500_000_000) @ T_base_lidar
    for k, file in enumerate(files):
        table = np.fromfile(file, np.float32).reshape(-1, 4)
        T = transforms.transform(poses[k, 1:4], poses[k, 4:])
        # Between poses 5 ms apart the writer moves straight: 12·0.4·0.005²/8 m beside the arc.
        assert np.abs(transforms.apply(T_first @ T, table[:, :3]) - POINTS_M).max() < 1e-4
        assert table[:, 3] == pytest.approx(np.linspace(-9, 9, len(POINTS_M)), abs=1e-6)
        expected = transforms.invert(T_first) @ T_world_base(500_000_000 + k * SWEEP_NS) @ T_base_lidar
        assert np.abs(T - expected).max() < 1e-6
    place = json.loads((folder / "calibration.json").read_text())["T_V_to_S"]
    assert [place["translation"][axis] for axis in "xyz"] == pytest.approx(T_base_lidar[:3, 3].tolist())
    assert [place["quaternion"][axis] for axis in "wxyz"] == pytest.approx([1.0, 0.0, 0.0, 0.0])


def test_a_lidar_without_rates_is_refused() -> None:
    with pytest.raises(WriterError, match="`doppler: true`"):
        DopplerIcpEncoder(calibration(doppler=False), ("lidar",))
