"""What a visual SLAM system finds in the pictures: OpenCV's ORB, as ORB-SLAM sets it up."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

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

Choice = Callable[[NDArray[Any]], list[cv2.KeyPoint]]
"""Chooses the keypoints of a grey picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What ORB made of some pictures of one weather, for one way to choose 1200 keypoints."""

    keypoints: float
    """Mean per picture."""
    occupied: float
    """Share of the cells of an 8×5 grid that hold a keypoint, a mean."""
    matches: float
    """Mutual nearest stereo matches within 1 px of a true disparity, in the same row within 1 px, a mean."""
    right_share: float
    """Share of all mutual nearest matches that are right."""
    depth_m: float
    """Median depth of all right matches [m]."""
    error_px: float
    """Deviation of all disparities from the true ones, of matches within 3 px and off outlines [px]."""


def stereo_poses(town: Town, share: float) -> tuple[Pinhole, list[NDArray[np.float64]], NDArray[np.float64]]:
    """Intrinsics, poses of both cameras and of the car at a share of the route."""
    assert town.route is not None
    at = town.route.at(np.array([share * town.route.length_m]))
    heading = float(at.heading_rad[0])
    T = transform(at.position_m[0], [0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)])
    T[:3, 3] -= 1.4 * T[:3, 0]
    cameras = [c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig)]
    return cameras[0].pinhole, [T @ camera.mount.T_base_sensor for camera in cameras], T


def found(name: str, images: int) -> dict[tuple[str, str], Found]:
    """Figures by weather and choice over pictures spread along a town's route, empty of traffic."""
    town = load_town(name)
    stage = SensorStage(town, seed=1, weather=PRESETS["ClearNoon"])
    renderer = stage.renderer()
    rows: dict[tuple[str, str], list[Matched]] = {}
    states = np.ones(int(town.lenses.signal.max(initial=-1)) + 1, np.uint8)
    for k in range(images):
        pinhole, poses, T_world_base = stereo_poses(town, (k + 0.4) / images)
        snapshot = Snapshot(stamp_ns=0, T_world_base=T_world_base, signals=states)
        seen = instances_at(stage.library, town.lenses, snapshot)
        drawn = [renderer.draw(pinhole, pose, seen) for pose in poses]
        disparity = disparity_px(drawn[0].depth_m(), pinhole, poses)
        for weather in WEATHERS:
            pair = [renderer.shade(g, PRESETS[weather], stamp_ns=k * 10**9, seed=1) for g in drawn]
            grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in pair]
            for choice, choose in CHOICES.items():
                rows.setdefault((weather, choice), []).append(matched(grey, disparity, choose))
    stage.close()
    return {key: summary(row, pinhole.fx_px * 0.4) for key, row in rows.items()}


def disparity_px(
    depth_m: NDArray[np.float32], pinhole: Pinhole, poses: list[NDArray[np.float64]]
) -> NDArray[np.float32]:
    """True disparity of every pixel of the left picture, 0 in the sky."""
    baseline = float(np.linalg.norm(poses[1][:3, 3] - poses[0][:3, 3]))
    true = np.where(depth_m > 0, pinhole.fx_px * baseline / np.maximum(depth_m, 1e-3), 0.0)
    return np.asarray(true, dtype=np.float32)


class Matched(NamedTuple):
    """Matches of one pair."""

    cells: int
    """Cells of the grid that hold a keypoint."""
    keypoints: int
    disparity_px: NDArray[np.float64]
    """Of each match, shape (N,)."""
    error_px: NDArray[np.float64]
    """Its deviation from the true one, shape (N,); NaN on outlines, where either side may be meant."""
    right: NDArray[np.bool_]


def matched(grey: Sequence[NDArray[Any]], disparity: NDArray[np.float32], choose: Choice) -> Matched:
    """Match the chosen keypoints of a pair and judge them.

    A corner on an outline is found on either side of it, up to the radius of FAST's circle, 3 px of
    its octave; what it shows moves with what is nearest there. True is thus the disparity of its own
    pixel or of the nearest surface within that circle.
    """
    left, right = ((points := choose(picture)) and ORB.compute(picture, points) for picture in grey)
    if not left or not right:
        nothing = np.zeros(0)
        return Matched(0, len(left[0]) if left else 0, nothing, nothing, nothing > 0)
    a, b, octave = _stereo_matches(left, right)
    columns, rows = np.rint(a).astype(int).T
    nearest = np.stack([cv2.dilate(disparity, _disc(3.0 * 1.2**k)) for k in range(8)])
    measured = a[:, 0] - b[:, 0]
    own = measured - disparity[rows, columns]
    outline = measured - nearest[octave, rows, columns]
    error = np.where(np.abs(own) < np.abs(outline), own, outline)
    sky = nearest[octave, rows, columns] == 0.0
    ok = (np.abs(a[:, 1] - b[:, 1]) <= 1.0) & (np.abs(error) <= 1.0) & (measured > 0.0) & ~sky
    error = np.where(np.abs(own - outline) < 1.0, own, np.nan)
    return Matched(len(_cells(left[0], disparity.shape)), len(left[0]), measured, error, ok)


def _disc(radius: float) -> NDArray[np.uint8]:
    reach = np.arange(-round(radius), round(radius) + 1)
    return np.asarray(np.hypot(*np.meshgrid(reach, reach)) <= radius + 0.5, dtype=np.uint8)


def summary(rows: list[Matched], focal_baseline: float) -> Found:
    """Figures over all pairs of one weather and choice."""
    disparity, error, right = (
        np.concatenate([getattr(row, name) for row in rows]) for name in ("disparity_px", "error_px", "right")
    )
    return Found(
        keypoints=float(np.mean([row.keypoints for row in rows])),
        occupied=float(np.mean([row.cells for row in rows])) / (GRID[0] * GRID[1]),
        matches=float(right.sum()) / len(rows),
        right_share=float(right.mean()),
        depth_m=float(np.median(focal_baseline / disparity[right])),
        error_px=float(error[np.abs(error) <= 3.0].std()),
    )


def _stereo_matches(
    left: Any, right: Any
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Mutual nearest descriptors of a rectified pair and their octaves: rows within 2 px, shift 0–160 px."""
    a, b = (np.array([p.pt for p in side[0]]).reshape(-1, 2) for side in (left, right))
    octave = np.array([p.octave for p in left[0]], dtype=np.int64)
    bits = [np.unpackbits(side[1], axis=1).astype(np.float32) for side in (left, right)]
    # Hamming distance: ones of both less twice the common ones.
    far = bits[0].sum(axis=1)[:, None] + bits[1].sum(axis=1)[None] - 2.0 * (bits[0] @ bits[1].T)
    shift = a[:, None, 0] - b[None, :, 0]
    far[(np.abs(a[:, None, 1] - b[None, :, 1]) > 2.0) | (shift < 0.0) | (shift > 160.0)] = np.inf
    best, back = far.argmin(axis=1), far.argmin(axis=0)
    rows = np.arange(len(a))
    good = (back[best] == rows) & np.isfinite(far[rows, best])
    return a[good], b[best[good]], octave[good]


def strongest(grey: NDArray[Any]) -> list[cv2.KeyPoint]:
    """OpenCV's own choice: the 1200 strongest of the picture."""
    return list(ORB.detect(grey))


def spread(grey: NDArray[Any]) -> list[cv2.KeyPoint]:
    """The strongest keypoints of every cell, 1200 at most, FAST threshold 7 (ORB-SLAM's lower one)."""
    detector = cv2.ORB_create(nfeatures=30000, nlevels=8, scaleFactor=1.2, fastThreshold=7)  # type: ignore[attr-defined]
    cells: dict[tuple[int, int], list[cv2.KeyPoint]] = {}
    for point in sorted(detector.detect(grey), key=lambda p: -p.response):
        (cell,) = _cells([point], grey.shape)
        cells.setdefault(cell, []).append(point)
    most = 1200 // (GRID[0] * GRID[1])
    return [point for points in cells.values() if len(points) >= 3 for point in points[:most]]


ORB = cv2.ORB_create(nfeatures=1200, nlevels=8, scaleFactor=1.2)  # type: ignore[attr-defined]
CHOICES: dict[str, Choice] = {"strongest": strongest, "spread": spread}


def _cells(points: Sequence[cv2.KeyPoint], shape: tuple[int, ...]) -> set[tuple[int, int]]:
    height, width = shape[:2]
    return {(int(p.pt[0] * GRID[0] / width), int(p.pt[1] * GRID[1] / height)) for p in points}


def read(town: str, figures: dict[tuple[str, str], Found]) -> None:
    """Print what was found; how many keypoints a street bears is for reading, not a bar."""
    for key, of in figures.items():
        numbers = (f"{name} {getattr(of, name):.3g}" for name in Found.__slots__)
        print(town, *key, *numbers)  # noqa: T201


def judge(figures: dict[tuple[str, str], Found]) -> None:
    """What weather must do to a SLAM system: fog hides what is far, night blurs and grains."""
    for choice in CHOICES:
        clear, night = figures["ClearNoon", choice], figures["RainyNight", choice]
        assert night.matches < clear.matches
        assert night.error_px > clear.error_px
    # Keypoints from every cell lie near by in any weather: half of them on the road.
    assert figures["FoggyNoon", "strongest"].depth_m <= 0.5 * figures["ClearNoon", "strongest"].depth_m


@pytest.mark.timeout(900)
def test_orb_in_town03() -> None:
    figures = found("Town03", 12)
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
