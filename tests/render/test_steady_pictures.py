"""Pictures of one place: the same again, alone or among other weathers, and steady in a slow pan."""

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.readings.orb_features import stereo_poses
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.build import load_town
from carlaloc_env.weather.presets import PRESETS

need_opengl()


@pytest.fixture(scope="module")
def street() -> Iterator[tuple[SceneRenderer, Pinhole, NDArray[np.float64]]]:
    """A street of Town03 and a camera in it."""
    town = load_town("Town03")
    stage = SensorStage(town, seed=1, weather=PRESETS["ClearNoon"])
    pinhole, poses, _ = stereo_poses(town, 0.3)
    yield stage.renderer(), pinhole, poses[0]
    stage.close()


def test_a_still_camera_sees_the_same_picture_again(
    street: tuple[SceneRenderer, Pinhole, NDArray[np.float64]],
) -> None:
    """Nothing moves and no dither: equal light 50 ms later, and pictures within one step."""
    renderer, pinhole, pose = street
    for weather in ("ClearNoon", "FoggyNoon", "ClearNight"):
        first = renderer.draw(pinhole, pose, Instances())
        light = renderer.radiance_cd_m2(first, PRESETS[weather], stamp_ns=0)
        second = renderer.draw(pinhole, pose, Instances())
        later = renderer.radiance_cd_m2(second, PRESETS[weather], stamp_ns=50_000_000)
        np.testing.assert_array_equal(light, later)


def test_a_slow_pan_does_not_shimmer(street: tuple[SceneRenderer, Pinhole, NDArray[np.float64]]) -> None:
    """Pictures 0.3 px of pan apart, warped back by the exact rotation, differ by few grey levels."""
    renderer, pinhole, pose = street
    step_rad = 0.3 / pinhole.fx_px
    base, residuals = None, []
    K = np.array([[pinhole.fx_px, 0, pinhole.cx_px], [0, pinhole.fy_px, pinhole.cy_px], [0, 0, 1.0]])
    for k in range(4):
        c, s = np.cos(k * step_rad), np.sin(k * step_rad)
        turned = pose.copy()
        turned[:3, :3] = pose[:3, :3] @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        rgb = renderer.shade(renderer.draw(pinhole, turned, Instances()), PRESETS["ClearNoon"], seed=1)
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
        if base is None:
            base = grey
            continue
        H = K @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) @ np.linalg.inv(K)
        # Where each pixel of the first picture lies in the turned one.
        back = cv2.warpPerspective(
            grey,
            H,
            grey.shape[::-1],
            flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT,
        )
        residuals.append(np.abs(back - base)[10:-100, 10:-10])
    stacked = np.stack(residuals)
    assert np.median(stacked) <= 2.0
    assert np.percentile(stacked, 90) <= 12.0
    assert np.percentile(stacked, 99) <= 40.0
