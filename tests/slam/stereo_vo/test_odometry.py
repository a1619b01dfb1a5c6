"""Our stereo odometry before a textured wall, where its way is known in closed form."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.dataset.readings import StereoPair
from recorder.slam.stereo_vo import StereoOdometry, run
from recorder.slam.system import FrameClock

FOCAL_PX, BASELINE_M, DEPTH_M = 200.0, 0.5, 5.0
WIDTH, HEIGHT = 320, 200


def test_it_measures_a_drive_along_a_wall() -> None:
    """A wall across the view shifts by f·x/z; the right eye sees it f·b/z further left."""
    noise = np.random.default_rng(1).integers(0, 256, (HEIGHT, 700), dtype=np.uint8)
    wall = cv2.GaussianBlur(noise, (0, 0), 1.5)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    disparity = round(FOCAL_PX * BASELINE_M / DEPTH_M)
    odometry = StereoOdometry(FOCAL_PX, np.array([WIDTH / 2, HEIGHT / 2]), BASELINE_M)
    for k in range(20):
        at = 4 * k
        left, right = (wall[:, a : a + WIDTH].copy() for a in (at, at + disparity))
        assert odometry.add(StereoPair(stamp_ns=k, left=left, right=right))
        np.testing.assert_allclose(odometry.pose[:3, 3], [at * DEPTH_M / FOCAL_PX, 0.0, 0.0], atol=0.02)
    np.testing.assert_allclose(odometry.pose[:3, :3], np.eye(3), atol=5e-3)


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [("radtan", (-0.283, 0.074, 2e-4, 2e-5)), ("equidistant", (-0.01, 0.002, 0.0, 0.0))],
)
def test_it_measures_the_same_through_lenses(model: str, coefficients: tuple[float, ...]) -> None:
    """The wall as OpenCV's own cameras see it: each pixel shows where its undistorted ray ends."""
    texture = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (600, 1400), np.uint8), (0, 0), 3.0)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    pinhole = Pinhole(
        width_px=WIDTH, height_px=HEIGHT, fx_px=FOCAL_PX, fy_px=FOCAL_PX, cx_px=158.0, cy_px=101.0
    )
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    undistorted = cv2.undistortPoints if model == "radtan" else cv2.fisheye.undistortPoints
    closely = (cv2.TERM_CRITERIA_COUNT, 100, 0.0)
    rays = undistorted(pixels, pinhole.K, np.array(coefficients), criteria=closely)
    x, y = rays.reshape(HEIGHT, WIDTH, 2).transpose(2, 0, 1) * DEPTH_M

    def view(at_m: float) -> np.ndarray:
        """The wall has 80 texels a metre."""
        column, row = (80.0 * (x + at_m) + 500.0).astype(np.float32), (80.0 * y + 300.0).astype(np.float32)
        return cv2.remap(texture, column, row, cv2.INTER_LINEAR)

    lens = Lens(model=model, coefficients=coefficients)
    eyes = tuple(
        CameraConfig(
            name=name, mount=Mount(position_m=(0.0, y_m, 0.0), axes="optical"), pinhole=pinhole, lens=lens
        )
        for name, y_m in (("left", BASELINE_M / 2), ("right", -BASELINE_M / 2))
    )
    pairs = [StereoPair(stamp_ns=k, left=view(0.1 * k), right=view(0.1 * k + BASELINE_M)) for k in range(20)]
    poses = run(SimpleNamespace(stereo=eyes, stereo_pairs=lambda: iter(pairs)), FrameClock())
    assert len(poses) == len(pairs)
    for k, pose in poses:
        np.testing.assert_allclose(pose[:3, 3], [0.1 * k, 0.0, 0.0], atol=0.02)


def test_it_says_so_when_it_recognises_nothing() -> None:
    odometry = StereoOdometry(FOCAL_PX, np.array([WIDTH / 2, HEIGHT / 2]), BASELINE_M)
    black = np.zeros((HEIGHT, WIDTH), np.uint8)
    pair = StereoPair(stamp_ns=0, left=black, right=black)
    assert odometry.add(pair)  # where it begins is known
    assert not odometry.add(pair)
