"""A window of keyframes that slides over a long way, against the truth and against no window."""

import numpy as np

from carlaloc_env.core.array_types import Array
from recorder.slam.bundle_adjustment import StereoCamera
from recorder.slam.keyframe_window import KEYFRAMES, KeyframeWindow

CAMERA = StereoCamera(focal_px=400.0, centre_px=np.array([320.0, 180.0]), baseline_m=0.5)
IMAGES, STEP_M = 20, 0.7


def drift_m(*, noise_px: float, seed: int) -> float:
    """Error of the last place where each image begins from the one before and adds half a pixel of noise."""
    rng = np.random.default_rng(seed)
    count = 900
    points = np.column_stack(
        [rng.uniform(-9, 9, count), rng.uniform(-3, 2, count), rng.uniform(5, 45, count)]
    )
    window, believed, known = KeyframeWindow(CAMERA), np.eye(4), {}
    for k in range(IMAGES):
        local = points - [0.0, 0.0, STEP_M * k]
        seen = np.flatnonzero((local[:, 2] > 4.0) & (np.abs(local[:, 0]) < 0.75 * local[:, 2]))[:300]
        pixel = CAMERA.project(local[seen]) + rng.normal(0.0, noise_px, (len(seen), 3))
        pose = believed.copy()
        pose[2, 3] += STEP_M if k else 0.0
        pose[:3, 3] += rng.normal(0.0, 0.05, 3) if k else 0.0
        depth = CAMERA.focal_px * CAMERA.baseline_m / (pixel[:, 0] - pixel[:, 2])
        ray = np.column_stack([(pixel[:, :2] - CAMERA.centre_px) / CAMERA.focal_px, np.ones(len(seen))])
        first: Array = ray * depth[:, None] + pose[:3, 3]
        position = np.array([known.get(int(label), p) for label, p in zip(seen, first, strict=True)])
        believed, position = window.add(pose, seen.astype(np.int64), pixel, position)
        known.update(zip(seen.tolist(), position, strict=True))
    return float(np.linalg.norm(believed[:3, 3] - [0.0, 0.0, STEP_M * (IMAGES - 1)]))


def test_without_noise_nothing_drifts() -> None:
    """Each pose begins 5 cm off; the window puts it right."""
    assert IMAGES > 2 * KEYFRAMES
    assert drift_m(noise_px=0.0, seed=1) < 2e-3


def test_with_noise_it_drifts_by_a_thousandth_of_the_way() -> None:
    """Half a pixel on 300 landmarks; unadjusted places would be off by √19 · 5 cm = 22 cm on each axis."""
    drifts = [drift_m(noise_px=0.5, seed=seed) for seed in range(6)]
    assert np.median(drifts) < 0.06
