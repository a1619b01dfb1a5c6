"""Streaks on the pixels that they touch, against every streak on every pixel."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.rain_drops import Streaks
from carlaloc_env.render.rain_layer import RainLayer, developed
from carlaloc_env.render.streak_kernels import THINNEST_PX
from carlaloc_env.render.views import CameraView

CAMERA = Pinhole(width_px=160, height_px=90, fx_px=80.0, fy_px=80.0, cx_px=80.0, cy_px=45.0)
VIEW = CameraView.of(CAMERA, transforms.from_rotation(transforms.R_FLU_OPTICAL, (0.0, 0.0, 0.0)))


def streaks(count: int) -> tuple[Streaks, NDArray[np.float64]]:
    """Drops at 0.5 to 2 m that fall and drift during an exposure, and their light."""
    random = np.random.default_rng(3)
    end = random.uniform([0.5, -0.8, -0.5], [2.0, 0.8, 0.5], (count, 3))
    begin = end + random.uniform([-0.1, -0.1, 0.02], [0.1, 0.1, 0.15], (count, 3))
    found = Streaks(end_m=end, begin_m=begin, diameter_m=random.uniform(2e-3, 20e-3, count))
    return found, random.uniform(0.0, 1.5, (count, 3))


def plain_layer(
    depth_m: NDArray[np.float32], drops: Streaks, light: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Light that they add and share that they hide, one streak after the other, shape (H, W, 4)."""
    layer = np.zeros((*depth_m.shape, 4))
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px].astype(float)
    optical = [points @ VIEW.R_camera_world.T for points in (drops.begin_m, drops.end_m)]
    for n in range(len(drops)):
        (x0, y0, z0), (x1, y1, z1) = optical[0][n], optical[1][n]
        first = np.array([80.0 * x0 / z0 + 80.0, 80.0 * y0 / z0 + 45.0])
        line = np.array([80.0 * x1 / z1 + 80.0, 80.0 * y1 / z1 + 45.0]) - first
        along = ((u - first[0]) * line[0] + (v - first[1]) * line[1]) / (line @ line)
        z = z0 + along * (z1 - z0)
        wide = drops.diameter_m[n] * 80.0 / z
        drawn = np.maximum(wide, THINNEST_PX)
        side = 2.0 * ((u - first[0]) * line[1] - (v - first[1]) * line[0]) / np.linalg.norm(line) / drawn
        hidden = np.minimum(drops.opacity[n] * wide / drawn * 1.5 * (1.0 - side**2), 1.0)
        shown = (along >= 0.0) & (along <= 1.0) & (hidden > 1e-6) & ((depth_m == 0.0) | (depth_m > z))
        hidden = np.where(shown, hidden, 0.0)[..., None]
        layer = layer * (1.0 - hidden) + hidden * np.append(light[n], 1.0)
    return layer


def test_the_layer_is_that_of_every_streak_on_every_pixel() -> None:
    drops, light = streaks(400)
    depth = np.where(np.arange(160) < 60, 1.2, 0.0) * np.ones((90, 1))
    found = RainLayer().layer(VIEW, depth.astype(np.float32), drops, light)
    expected = plain_layer(depth.astype(np.float32), drops, light)
    assert 0.05 < np.mean(expected[..., 3] > 0.0) < 0.9
    np.testing.assert_allclose(found, expected, atol=2e-6)


def test_rain_over_a_finished_image_is_rain_over_its_light() -> None:
    """Within the step of the image itself, that of dither, and a quarter that nobody sees."""
    drops, light = streaks(200)
    behind = np.random.default_rng(1).uniform(0.02, 0.5, (90, 160, 3))
    sky = np.zeros((90, 160), np.float32)
    layer = plain_layer(sky, drops, light)
    expected = 255.0 * developed(behind * (1.0 - layer[..., 3:]) + layer[..., :3])
    image = np.full((90, 160, 4), 255, np.uint8)
    image[..., :3] = np.rint(255.0 * developed(behind))
    RainLayer().over_image(image, VIEW, sky, drops, light, key=5, electrons=(0.0, 0.0))
    assert np.mean(np.abs(expected - 255.0 * developed(behind)) > 3.0) > 0.05
    assert np.abs(image[..., :3] - np.minimum(expected, 255.0)).max() < 2.0
