"""What a visual SLAM system finds in the pictures: OpenCV's ORB, as ORB-SLAM sets it up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import RenderError
from carlaloc_env.core.transforms import transform
from carlaloc_env.render.gl.context import create_context
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera.config import CameraConfig
from carlaloc_env.timeline.snapshot import Snapshot
from carlaloc_env.town.build import load_town
from carlaloc_env.town.sources import known_towns
from carlaloc_env.town.town import Town
from carlaloc_env.weather.parameters import PRESETS

try:
    create_context().release()
except RenderError as no_opengl:
    pytest.skip(str(no_opengl), allow_module_level=True)

WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
GRID = (8, 5)


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Medians over some pictures of one weather."""

    keypoints: float
    strongest_occupy: float
    """Share of the cells of an 8×5 grid that hold one of the strongest 1200 keypoints; a mean."""
    occupied: float
    """The same for 1200 keypoints taken evenly from all cells, as SLAM systems do."""
    matches: float
    """Mutual nearest stereo matches within 1 px of the true disparity, in the same row within 1 px."""
    right_share: float
    """Share of the mutual nearest matches that are right."""
    depth_m: float
    """Median depth of right matches [m]."""
    error_px: float
    """Deviation of the disparities from the true ones, of matches within 3 px [px]; a mean."""


def stereo_poses(town: Town, share: float) -> tuple[Pinhole, list[NDArray[np.float64]], NDArray[np.float64]]:
    """Intrinsics, poses of both cameras and of the car at a share of the route."""
    assert town.route is not None
    at = town.route.at(np.array([share * town.route.length_m]))
    heading = float(at.heading_rad[0])
    T = transform(at.position_m[0], [0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)])
    T[:3, 3] -= 1.4 * T[:3, 0]
    cameras = [c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig)]
    return cameras[0].pinhole, [T @ camera.mount.T_base_sensor for camera in cameras], T


def found(name: str, images: int) -> dict[str, Found]:
    """Figures of every weather over pictures spread along a town's route, empty of traffic."""
    town = load_town(name)
    stage = SensorStage(town, seed=1, weather=PRESETS["ClearNoon"])
    renderer = stage.renderer()
    rows: dict[str, list[tuple[float, ...]]] = {weather: [] for weather in WEATHERS}
    states = np.ones(int(town.lenses.signal.max(initial=-1)) + 1, np.uint8)
    for k in range(images):
        pinhole, poses, T_world_base = stereo_poses(town, (k + 0.4) / images)
        snapshot = Snapshot(stamp_ns=0, T_world_base=T_world_base, signals=states)
        seen = instances_at(stage.library, town.lenses, snapshot)
        drawn = [renderer.draw(pinhole, pose, seen) for pose in poses]
        disparity = disparity_px(drawn[0].depth_m(), pinhole, poses)
        for weather in WEATHERS:
            pair = [renderer.shade(g, PRESETS[weather], stamp_ns=k * 10**9, seed=1) for g in drawn]
            rows[weather].append(orb(pair, disparity, pinhole.fx_px * 0.4))
    stage.close()
    figures = {}
    for weather, row in rows.items():
        numbers = np.array(row)
        of = dict(zip(Found.__slots__, np.nanmedian(numbers, axis=0), strict=True))
        for name in ("strongest_occupy", "error_px"):
            of[name] = np.nanmean(numbers[:, Found.__slots__.index(name)])
        figures[weather] = Found(**{name: float(value) for name, value in of.items()})
    return figures


def disparity_px(
    depth_m: NDArray[np.float32], pinhole: Pinhole, poses: list[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """True disparity of every pixel of the left picture; NaN in the sky."""
    baseline = float(np.linalg.norm(poses[1][:3, 3] - poses[0][:3, 3]))
    return np.where(depth_m > 0, pinhole.fx_px * baseline / np.maximum(depth_m, 1e-3), np.nan)


def orb(
    pair: list[NDArray[np.uint8]], disparity: NDArray[np.float64], focal_baseline: float
) -> tuple[float, ...]:
    """Row of `Found` of one stereo pair."""
    detector = cv2.ORB_create(nfeatures=1200, nlevels=8, scaleFactor=1.2)  # type: ignore[attr-defined]
    grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in pair]
    left, right = (detector.detectAndCompute(picture, None) for picture in grey)
    occupied = [
        len(_cells(points, disparity.shape)) / (GRID[0] * GRID[1]) for points in (left[0], spread(grey[0]))
    ]
    a, b = _stereo_matches(left, right)
    true = disparity[np.rint(a[:, 1]).astype(int), np.rint(a[:, 0]).astype(int)]
    right_ones = (np.abs(a[:, 1] - b[:, 1]) <= 1.0) & (np.abs(a[:, 0] - b[:, 0] - true) <= 1.0)
    depth = focal_baseline / true[right_ones]
    error = a[:, 0] - b[:, 0] - true
    error = error[np.abs(error) <= 3.0]
    return (
        float(len(left[0])),
        *occupied,
        float(right_ones.sum()),
        float(right_ones.mean()),
        float(np.median(depth)) if len(depth) else np.nan,
        float(error.std()) if len(error) > 20 else np.nan,
    )


def _stereo_matches(left: Any, right: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mutual nearest descriptors of a rectified pair: rows within 2 px, disparity from 0 to 160 px."""
    a, b = (np.array([p.pt for p in side[0]]).reshape(-1, 2) for side in (left, right))
    if not len(a) or not len(b):
        return a[:0], b[:0]
    bits = [np.unpackbits(side[1], axis=1).astype(np.float32) for side in (left, right)]
    # Hamming distance: ones of both less twice the common ones.
    far = bits[0].sum(axis=1)[:, None] + bits[1].sum(axis=1)[None] - 2.0 * (bits[0] @ bits[1].T)
    shift = a[:, None, 0] - b[None, :, 0]
    far[(np.abs(a[:, None, 1] - b[None, :, 1]) > 2.0) | (shift < 0.0) | (shift > 160.0)] = np.inf
    best, back = far.argmin(axis=1), far.argmin(axis=0)
    rows = np.arange(len(a))
    good = (back[best] == rows) & np.isfinite(far[rows, best])
    return a[good], b[best[good]]


def spread(grey: NDArray[np.uint8]) -> list[cv2.KeyPoint]:
    """The strongest keypoints of every cell, 1200 at most, FAST threshold 7 (ORB-SLAM's lower one)."""
    detector = cv2.ORB_create(nfeatures=30000, nlevels=8, scaleFactor=1.2, fastThreshold=7)  # type: ignore[attr-defined]
    cells: dict[tuple[int, int], list[cv2.KeyPoint]] = {}
    for point in sorted(detector.detect(grey), key=lambda p: -p.response):
        (cell,) = _cells([point], grey.shape)
        cells.setdefault(cell, []).append(point)
    most = 1200 // (GRID[0] * GRID[1])
    return [point for points in cells.values() if len(points) >= 3 for point in points[:most]]


def _cells(points: Sequence[cv2.KeyPoint], shape: tuple[int, ...]) -> set[tuple[int, int]]:
    height, width = shape[:2]
    return {(int(p.pt[0] * GRID[0] / width), int(p.pt[1] * GRID[1] / height)) for p in points}


def read(town: str, figures: dict[str, Found]) -> None:
    """Print what was found; how many keypoints a street bears is for reading, not a bar."""
    for weather, of in figures.items():
        numbers = (f"{name} {getattr(of, name):.3g}" for name in Found.__slots__)
        print(town, weather, *numbers)  # noqa: T201


def judge(figures: dict[str, Found]) -> None:
    """What weather must do to a SLAM system: fog hides what is far, night blurs and grains."""
    clear, fog, night = (figures[weather] for weather in WEATHERS)
    assert fog.depth_m <= 0.5 * clear.depth_m
    assert night.matches < clear.matches
    assert night.error_px > clear.error_px


def test_orb_in_town03() -> None:
    figures = found("Town03", 4)
    read("Town03", figures)
    judge(figures)


@pytest.mark.soak
@pytest.mark.parametrize("town", known_towns())
def test_orb_in_every_town(town: str) -> None:
    figures = found(town, 50)
    read(town, figures)
    judge(figures)


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


def test_weathers_shaded_together_are_what_each_is_alone(
    street: tuple[SceneRenderer, Pinhole, NDArray[np.float64]],
) -> None:
    """Two nights share their lists of lamps with what the driver may still be at work on."""
    renderer, pinhole, pose = street
    weathers = [PRESETS[name] for name in ("RainyNight", "ClearNoon", "ClearNight", "HardRainNoon")]
    drawn = renderer.draw(pinhole, pose, Instances())
    together = renderer.shade_all(drawn, weathers, stamp_ns=50_000_000, seed=2)
    for weather, picture in zip(weathers, together, strict=True):
        alone = renderer.shade(drawn, weather, stamp_ns=50_000_000, seed=2)
        np.testing.assert_array_equal(picture, alone)
    assert len({picture.tobytes() for picture in together}) == len(weathers)


def test_a_slow_pan_does_not_shimmer(
    street: tuple[SceneRenderer, Pinhole, NDArray[np.float64]],
) -> None:
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
