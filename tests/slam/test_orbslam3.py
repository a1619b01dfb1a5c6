"""ORB-SLAM3 behind a pipe: what it is fed with, what is said when it is missing, and a real run."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.dataset.readings import ImuSample, StereoPair
from recorder.dataset.sequence import SlamSequence
from recorder.slam.runners import orbslam3
from recorder.slam.system import FrameClock
from recorder.slam.systems import SYSTEMS
from recorder.writers.calibration.files import calibration_texts
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.topic_profiles import STANDARD

FOCAL_PX, BASELINE_M, DEPTH_M = 320.0, 0.5, 6.4
WIDTH, HEIGHT, IMAGES = 640, 360, 40
EYE = Pinhole(width_px=WIDTH, height_px=HEIGHT, fx_px=FOCAL_PX, fy_px=FOCAL_PX, cx_px=320.0, cy_px=180.0)
CAMERAS = tuple(
    CameraConfig(name=name, mount=Mount(position_m=(1.5, y_m, 1.6), axes="optical"), pinhole=EYE)
    for name, y_m in (("left", 0.5 * BASELINE_M), ("right", -0.5 * BASELINE_M))
)


class Wall(SlamSequence):
    """A drive along a textured wall across the view, 0.16 m an image."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        noise = np.random.default_rng(1).integers(0, 256, (HEIGHT, 1400), dtype=np.uint8)
        wall = cv2.GaussianBlur(noise, (0, 0), 2.0)
        self._wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)  # type: ignore[call-overload]
        texts = calibration_texts(RigCalibration.from_configs(CAMERAS), STANDARD)
        (folder / "orbslam3_stereo.yaml").write_text(texts["orbslam3_stereo.yaml"])

    @property
    def calibration(self) -> Path:
        return self._folder

    def stereo_pairs(self) -> Iterator[StereoPair]:
        disparity = round(FOCAL_PX * BASELINE_M / DEPTH_M)
        for k in range(IMAGES):
            left, right = (self._wall[:, a : a + WIDTH].copy() for a in (8 * k, 8 * k + disparity))
            yield StereoPair(stamp_ns=10**18 + k * 50_000_000, left=left, right=right)

    def imu_samples(self) -> Iterator[ImuSample]:
        for k in range(IMAGES * 10):
            stamp_ns = 10**18 + k * 5_000_000
            yield ImuSample(
                stamp_ns=stamp_ns, acceleration_mps2=np.full(3, k), angular_velocity_radps=np.zeros(3)
            )


def test_every_inertial_sample_is_fed_once_with_the_image_that_ends_it(tmp_path: Path) -> None:
    fed = list(orbslam3._fed(Wall(tmp_path), inertial=True))
    assert [len(samples) for _, samples in fed] == [1, *[10] * (IMAGES - 1)]
    assert np.array_equal(np.concatenate([s for _, s in fed])[:, 4], np.arange(IMAGES * 10 - 9))
    assert all(samples[-1, 0] == pair.stamp_ns * 1e-9 for pair, samples in fed)


def test_loops_are_not_closed(tmp_path: Path) -> None:
    assert orbslam3._settings(Wall(tmp_path), inertial=False).endswith("\nloopClosing: 0\n")


def test_what_it_lacks_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    system = SYSTEMS["orbslam3_stereo"]
    monkeypatch.setenv(orbslam3.PYTHON, str(tmp_path / "no_python"))
    assert "is not installed for" in system.missing
    monkeypatch.setattr("recorder.slam.system._version_by", lambda *_: "0.1.1")
    monkeypatch.delenv(orbslam3.VOCABULARY, raising=False)
    assert "needs a file that CARLALOC_ORBSLAM3_VOCABULARY names; give ORBvoc.txt" in system.missing
    monkeypatch.setenv(orbslam3.VOCABULARY, __file__)
    assert not system.missing
    with pytest.raises(EvaluationError, match="is no vocabulary"):
        orbslam3.stereo(Wall(tmp_path), FrameClock())


def test_a_python_without_it_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "voc.txt").write_text("10 5 0 0\n")
    monkeypatch.setenv(orbslam3.VOCABULARY, str(tmp_path / "voc.txt"))
    monkeypatch.setenv(orbslam3.PYTHON, sys.executable)
    if SYSTEMS["orbslam3_stereo"].version != "own":
        pytest.skip("this Python has pyorbslam3")
    with pytest.raises(EvaluationError, match="does not start, exit status 1"):
        orbslam3.stereo(Wall(tmp_path), FrameClock())


@pytest.mark.skipif(bool(SYSTEMS["orbslam3_stereo"].missing), reason="needs ORB-SLAM3 and a vocabulary")
def test_a_real_run_measures_a_drive_along_a_wall(tmp_path: Path) -> None:
    clock = FrameClock()
    poses = orbslam3.stereo(Wall(tmp_path), clock)
    assert len(clock.wall_s) == IMAGES
    assert os.environ[orbslam3.VOCABULARY].split("/")[-1] in clock.notes[0]
    assert len(poses) >= IMAGES - 1
    for stamp_ns, T in poses:
        along = (stamp_ns - 10**18) // 50_000_000 * 8 * DEPTH_M / FOCAL_PX
        np.testing.assert_allclose(T[:3, 3], [along, 0.0, 0.0], atol=0.05)
