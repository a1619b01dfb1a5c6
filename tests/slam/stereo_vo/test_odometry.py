"""Our stereo odometry before a textured wall, where its way is known in closed form."""

import cv2
import numpy as np

from recorder.dataset.readings import StereoPair
from recorder.slam.stereo_vo import StereoOdometry

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


def test_it_says_so_when_it_recognises_nothing() -> None:
    odometry = StereoOdometry(FOCAL_PX, np.array([WIDTH / 2, HEIGHT / 2]), BASELINE_M)
    black = np.zeros((HEIGHT, WIDTH), np.uint8)
    pair = StereoPair(stamp_ns=0, left=black, right=black)
    assert odometry.add(pair)  # where it begins is known
    assert not odometry.add(pair)
