"""Boxes of a nuScenes sample: where road users were at any time, and the points that lie in their boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.samples import ObjectList
from carlaloc_env.scene.semantic_tags import Tag
from recorder.writers.base import Piece
from recorder.writers.formats.ego_path import Steps

if TYPE_CHECKING:
    from recorder.writers.formats.town_ground import TownGround

OBJECTS = "objects"
"""Place of pieces that hold all road users at one instant."""
RANGE_M = 120.0
"""Distance up to which boxes are written [m]."""
SLACK_M = 0.05
"""Boxes reach this much beyond their road user on each side [m]: two and a half sigmas of a LiDAR's noise."""
PARKED_ID = 1 << 30
"""Numbers of parked cars begin here; instance ids of road users are below."""
_ROW = np.dtype(
    [
        ("id", "<u4"), ("tag", "u1"), ("centre", "<f8", 3), ("rpy", "<f8", 3), ("size", "<f8", 3),
        ("speed", "<f8"), ("visible", "<f8"),
    ]
)  # fmt: skip


def objects_piece(sample: ObjectList) -> Piece:
    """Road users as a piece."""
    rows = np.empty(len(sample.id), _ROW)
    rows["id"], rows["tag"], rows["centre"] = sample.id, sample.tag, sample.position_m
    rows["rpy"] = np.stack([sample.roll_rad, -sample.pitch_rad, sample.heading_rad], axis=-1)
    rows["size"], rows["visible"] = sample.size_m, sample.visible
    rows["speed"] = np.sqrt(np.sum(sample.velocity_mps**2, axis=1))
    return Piece(sample.stamp_ns, OBJECTS, "", rows.tobytes())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boxes:
    """Boxes at one instant; those of parked cars come last."""

    id: NDArray[np.int64]
    """Numbers that stay in a drive, shape (N,)."""
    tag: NDArray[np.uint8]
    """Semantic `Tag`, shape (N,)."""
    centre_m: Array
    """Middles in the world [m], shape (N, 3)."""
    quat_xyzw: Array
    """Map boxes to world, shape (N, 4)."""
    size_m: Array
    """Length, width, height, `SLACK_M` included [m], shape (N, 3)."""
    speed_mps: Array
    """Speeds [m/s], shape (N,)."""
    visible: Array
    """Shares that are not hidden, 0–1, NaN where unknown, shape (N,)."""

    def near(self, eye_m: Array) -> Boxes:
        """Those within `RANGE_M` of a place [m]."""
        away = self.centre_m - eye_m
        kept = np.sqrt(np.sum(away * away, axis=1)) < RANGE_M
        return Boxes(**{name: getattr(self, name)[kept] for name in self.__slots__})


class ActorTracks(Steps):
    """Road users over the last steps, moving straight from step to step as pictures and rays show them."""

    def __init__(self) -> None:
        super().__init__(_ROW)

    def _at(self, row: NDArray[np.intp], stamp_ns: NDArray[np.int64]) -> tuple[Array, Array]:
        """Middles [m] (N, 3) and attitudes (N, 3) [rad] of road users by row at times [ns]."""
        times = np.array(self._stamps_ns)
        after = np.minimum(np.searchsorted(times, stamp_ns, side="left"), len(times) - 1)
        before = np.maximum(after - 1, 0)
        span = np.maximum(times[after] - times[before], 1)
        share = np.clip((stamp_ns - times[before]) / span, 0.0, 1.0)[:, None]
        share = np.where((after == before)[:, None], 0.0, share)
        centre, rpy = (np.stack([frame[name] for frame in self._steps]) for name in ("centre", "rpy"))
        turn = transforms.wrap_angle(rpy[after, row] - rpy[before, row])
        step = centre[after, row] - centre[before, row]
        return centre[before, row] + share * step, rpy[before, row] + share * turn

    def boxes(self, stamp_ns: int, ground: TownGround) -> Boxes:
        """All boxes at a time [ns]."""
        past = [k for k, at in enumerate(self._stamps_ns) if at <= stamp_ns or k == 0]
        frame = self._steps[past[-1]] if past else np.empty(0, _ROW)
        count, parked = len(frame), len(ground.parked_heading_rad)
        still = np.zeros((parked, 3))
        still[:, 2] = ground.parked_heading_rad
        centre, rpy = np.zeros((0, 3)), np.zeros((0, 3))
        if count:
            centre, rpy = self._at(np.arange(count), np.full(count, stamp_ns))
        return Boxes(
            id=np.concatenate([frame["id"].astype(np.int64), PARKED_ID + np.arange(parked)]),
            tag=np.concatenate([frame["tag"], np.full(parked, Tag.CAR, np.uint8)]),
            centre_m=np.concatenate([centre, ground.parked_centre_m]),
            quat_xyzw=transforms.rpy_to_quat(*np.concatenate([rpy, still]).T),
            size_m=np.concatenate([frame["size"], ground.parked_size_m]) + 2 * SLACK_M,
            speed_mps=np.concatenate([frame["speed"], np.zeros(parked)]),
            visible=np.concatenate([frame["visible"], np.full(parked, np.nan)]),
        )

    def brought_to(
        self, stamp_ns: int, world_m: Array, seen_ns: NDArray[np.int64], instance: NDArray[np.uint32]
    ) -> Array:
        """Points (N, 3) of road users, seen at times (N,) [ns], where they would be at one time [ns]."""
        ids = self._steps[0]["id"] if self._steps else np.zeros(0, np.uint32)
        order = np.argsort(ids)
        place = np.minimum(np.searchsorted(ids[order], instance), max(len(ids) - 1, 0))
        moved: Array = world_m.copy()
        if not len(ids):
            return moved
        rows = np.flatnonzero(ids[order][place] == instance)
        row = order[place[rows]]
        centre, rpy = self._at(row, seen_ns[rows])
        centre_then, rpy_then = self._at(row, np.full(len(rows), stamp_ns))
        turn = rpy_then[:, 2] - rpy[:, 2]
        c, s = elementary.cos(turn), elementary.sin(turn)
        away = world_m[rows] - centre
        moved[rows, 0] = centre_then[:, 0] + c * away[:, 0] - s * away[:, 1]
        moved[rows, 1] = centre_then[:, 1] + s * away[:, 0] + c * away[:, 1]
        moved[rows, 2] = centre_then[:, 2] + away[:, 2]
        return moved


def points_in(boxes: Boxes, points_m: Array, eye_m: Array) -> tuple[NDArray[np.int64], Array]:
    """Number of points in each box, and the share of rays towards it that nothing has stopped before it.

    Args:
        boxes: N boxes.
        points_m: Points in the world [m], shape (M, 3).
        eye_m: Where they were seen from [m], shape (3,).
    """
    count = len(boxes.id)
    if not (count and len(points_m)):
        return np.zeros(count, np.int64), np.zeros(count)
    away = points_m - eye_m
    range_m = np.maximum(np.sqrt(np.sum(away * away, axis=1)), 1e-9)
    towards = boxes.centre_m - eye_m
    distance = np.maximum(np.sqrt(np.sum(towards * towards, axis=1)), 1e-9)
    reach = 0.5 * np.sqrt(np.sum(boxes.size_m**2, axis=1)) / distance
    # A cone around each box: chords between directions; near boxes take all rays.
    chord = np.where(reach < 0.9, 1.1 * reach, 2.0)
    tree = point_tree(away / range_m[:, None])
    rays = tree.query_ball_point(towards / distance[:, None], chord)
    box = np.repeat(np.arange(count), [len(row) for row in rays])
    ray = np.fromiter((k for row in rays for k in row), np.int64, len(box))
    inverse = transforms.quat_conjugate(boxes.quat_xyzw)[box]
    half = 0.5 * boxes.size_m[box]
    start = transforms.quat_rotate(inverse, -towards[box])
    course = transforms.quat_rotate(inverse, away[ray])
    inside = (np.abs(start + course) <= half).all(axis=1)
    # Where a ray enters and leaves the box, as shares of its way to its point (slabs).
    steady = np.where(np.abs(course) < 1e-9, 1e-9, course)
    ends = np.stack([(-half - start) / steady, (half - start) / steady])
    enters, leaves = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    stopped = ~inside & (enters < leaves) & (enters > 1.0)
    hits, hidden = (np.bincount(box[kind], minlength=count) for kind in (inside, stopped))
    return hits, hits / np.maximum(hits + hidden, 1)
