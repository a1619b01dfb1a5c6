"""What a visual SLAM system finds in pictures of a town: OpenCV's ORB, as ORB-SLAM sets it up."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import transform
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.snapshot import Snapshot
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.weather.presets import PRESETS

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
    reach_m: float
    """Depth that 95 % of them stay below [m]."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Features:
    """What ORB makes of a town's route, empty of traffic."""

    figures: dict[tuple[str, str], Found]
    """By weather and choice."""
    fog_reach_m: float
    """Depth that 95 % of the corners stay below which fog leaves of ClearNoon by Koschmieder's law [m]."""


def found(name: str, images: int) -> Features:
    """Figures over pictures spread along a town's route."""
    town = load_town(name)
    stage = SensorStage(town, seed=1, weather=PRESETS["ClearNoon"])
    renderer = stage.renderer()
    rows: dict[tuple[str, str], list[Matched]] = {}
    left_m: list[NDArray[np.float64]] = []
    fog_per_m = PRESETS["FoggyNoon"].extinction_per_m
    states = np.ones(int(town.outline.lenses.signal.max(initial=-1)) + 1, np.uint8)
    for k in range(images):
        pinhole, poses, T_world_base = stereo_poses(town, (k + 0.4) / images)
        snapshot = Snapshot(stamp_ns=0, T_world_base=T_world_base, signals=states)
        seen = instances_at(stage.library, town.outline.lenses, snapshot)
        drawn = [renderer.draw(pinhole, pose, seen) for pose in poses]
        disparity = disparity_px(drawn[0].depth_m(), pinhole, poses)
        for weather in WEATHERS:
            pair = [renderer.shade(g, PRESETS[weather], stamp_ns=k * 10**9, seed=1) for g in drawn]
            grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in pair]
            for choice, choose in CHOICES.items():
                rows.setdefault((weather, choice), []).append(matched(grey, disparity, choose))
            if weather == "ClearNoon":
                left_m.append(left_by_fog_m(grey[0], disparity, pinhole.fx_px * 0.4, fog_per_m))
    stage.close()
    figures = {key: summary(row, pinhole.fx_px * 0.4) for key, row in rows.items()}
    return Features(figures=figures, fog_reach_m=float(np.percentile(np.concatenate(left_m), 95)))


def left_by_fog_m(
    grey: NDArray[Any], disparity: NDArray[np.float32], focal_baseline: float, extinction_per_m: float
) -> NDArray[np.float64]:
    """Depths [m] of the corners of a clear picture that FAST still finds behind fog, shape (N,).

    After Koschmieder (1924) contrast falls by exp(-extinction · depth); FAST's score is the contrast up
    to which a corner is one, and ORB takes those from `FAST_THRESHOLD` on.
    """
    corners = FAST_CORNERS.detect(grey)
    columns, rows = np.rint([corner.pt for corner in corners]).astype(int).T
    octave = np.array([corner.octave for corner in corners])
    nearest = _nearest(disparity)[octave, rows, columns]
    depth_m = focal_baseline / nearest[nearest > 0.0].astype(np.float64)
    score = np.array([corner.response for corner in corners])[nearest > 0.0]
    return depth_m[score * np.exp(-extinction_per_m * depth_m) >= FAST_THRESHOLD]


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
    nearest = _nearest(disparity)
    measured = a[:, 0] - b[:, 0]
    own = measured - disparity[rows, columns]
    outline = measured - nearest[octave, rows, columns]
    error = np.where(np.abs(own) < np.abs(outline), own, outline)
    sky = nearest[octave, rows, columns] == 0.0
    ok = (np.abs(a[:, 1] - b[:, 1]) <= 1.0) & (np.abs(error) <= 1.0) & (measured > 0.0) & ~sky
    error = np.where(np.abs(own - outline) < 1.0, own, np.nan)
    return Matched(len(_cells(left[0], disparity.shape)), len(left[0]), measured, error, ok)


def _nearest(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Disparity of the nearest surface within the circle of each octave, shape (8, H, W)."""
    return np.stack([cv2.dilate(disparity, _disc(3.0 * 1.2**k)) for k in range(8)])


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
        reach_m=float(np.percentile(focal_baseline / disparity[right], 95)),
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


FAST_THRESHOLD = 20
"""Contrast from which OpenCV's ORB takes a corner [grey levels]."""
ORB = cv2.ORB_create(nfeatures=1200, nlevels=8, scaleFactor=1.2)  # type: ignore[attr-defined]
FAST_CORNERS = cv2.ORB_create(  # type: ignore[attr-defined]
    nfeatures=100_000, nlevels=8, scaleFactor=1.2, scoreType=cv2.ORB_FAST_SCORE, fastThreshold=FAST_THRESHOLD
)
"""All corners, with their contrast as the response."""
CHOICES: dict[str, Choice] = {"strongest": strongest, "spread": spread}


def _cells(points: Sequence[cv2.KeyPoint], shape: tuple[int, ...]) -> set[tuple[int, int]]:
    height, width = shape[:2]
    return {(int(p.pt[0] * GRID[0] / width), int(p.pt[1] * GRID[1] / height)) for p in points}
