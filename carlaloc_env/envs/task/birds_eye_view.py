"""The bird's-eye view: roads, lanes, route, road users and lights from above, the car's heading upwards."""

from __future__ import annotations

import cv2
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.envs.task.road_users import STOREY_M, Ego, ego_of
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.traffic.signals import SignalState

SIZE_PX = 96
"""Rows and columns."""
PX_M = 0.5
"""Side of a pixel [m]."""
AHEAD_M = 36.0
"""How far the picture reaches ahead of `base_link` [m]; the rest of its 48 m lies behind."""
CHANNELS = ("road", "lanes", "route", "actors", "lights")
"""What each channel shows."""
VEHICLE, WALKER = 255, 128
"""Values of road users."""
LIGHTS = {SignalState.RED: 255, SignalState.YELLOW: 170, SignalState.GREEN: 85}
"""Values of stop lines by what their light shows."""
_SUBPIXEL_BITS = 4
"""Corners are given to a sixteenth of a pixel."""
_STRIP_ROWS = 8
"""Rows of the half-metre tables of lanes between the ends of one piece."""
_REACH_M = AHEAD_M * 1.42 + 8.0
"""Pieces whose middle is farther away cannot show [m]."""
_STOP_LINE_M = 3.5
"""Length of a stop line across the route [m]."""
_BOX = np.array([[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]], np.float32)
"""Corners of a box of length and width 1."""


def birds_eye_space() -> spaces.Box:
    """Space of the picture, (rows, columns, channels)."""
    return spaces.Box(0, 255, (SIZE_PX, SIZE_PX, len(CHANNELS)), np.uint8)


class BirdsEyeView:
    """Draws what lies round the car in one town."""

    def __init__(self, network: LaneNetwork) -> None:
        """Cut the driving lanes into pieces of four metres."""
        self._pieces = _pieces(network)

    def draw(self, world: TaskWorld) -> NDArray[np.uint8]:
        """The picture now, uint8, shape (96, 96, 5); channels are named in `CHANNELS`."""
        ego, out = ego_of(world.state), np.zeros((len(CHANNELS), SIZE_PX, SIZE_PX), np.uint8)
        corners, _ = _seen(ego, *self._pieces)
        _fill(out[0], corners, 255)
        # The left side of each piece, and its right side.
        _line(out[1], corners.reshape(-1, 2, 2), 1)
        self._route(world, ego, out[2])
        self._actors(world, ego, out[3])
        self._lights(world, ego, out[4])
        picture = np.empty((SIZE_PX, SIZE_PX, len(CHANNELS)), np.uint8)
        cv2.merge(list(out), picture)
        return picture

    def _route(self, world: TaskWorld, ego: Ego, out: NDArray[np.uint8]) -> None:
        route = world.route
        rows = np.arange(0, int(_REACH_M / route.step_m), 4) + route.row_at(world.route_s_m)
        rows = rows % len(route.position_m) if route.closed else rows[rows < len(route.position_m)]
        if len(rows) > 1:
            _line(out, _pixels(ego, route.position_m[None, rows]), round(2.0 / PX_M))

    def _actors(self, world: TaskWorld, ego: Ego, out: NDArray[np.uint8]) -> None:
        frame, catalog = world.actors(), world.timeline.catalog
        boxes_m, turn = np.empty((len(frame), 4, 2), np.float32), frame.heading_rad
        _put_boxes(frame.position_m, np.cos(turn), np.sin(turn), catalog.size_m, boxes_m)
        boxes, rows = _seen(ego, frame.position_m, boxes_m)
        on_foot = catalog.tag[rows] == Tag.PEDESTRIAN
        for which, value in ((on_foot, WALKER), (~on_foot, VEHICLE)):
            _fill(out, boxes[which], value)

    def _lights(self, world: TaskWorld, ego: Ego, out: NDArray[np.uint8]) -> None:
        lines, route, signals = world.stop_lines, world.route, world.signals()
        for s_m, head in zip(lines.s_m.tolist(), lines.heads, strict=True):
            row = route.row_at(s_m)
            if not _is_near(ego, *route.position_m[row].tolist()):
                continue
            shown = SignalState(int(signals[head].max()))
            heading = float(route.heading_rad[row])
            across = 0.5 * _STOP_LINE_M * np.array([-np.sin(heading), np.cos(heading)])
            middle = route.position_m[row, :2]
            ends = np.stack([middle - across, middle + across])[None]
            _line(out, _pixels(ego, ends), 2, LIGHTS.get(shown, 0))


@compiled
def _put_boxes(position_m: F32, cos: F32, sin: F32, size_m: F32, out: F32) -> None:
    """Write the corners (N, 4, 2) of road users by their positions, headings and sizes."""
    for n in range(len(cos)):
        for k in range(4):
            ahead, left = size_m[n, 0] * _BOX[k, 0], size_m[n, 1] * _BOX[k, 1]
            out[n, k, 0] = position_m[n, 0] + cos[n] * ahead - sin[n] * left
            out[n, k, 1] = position_m[n, 1] + sin[n] * ahead + cos[n] * left


@compiled
def _is_near(ego: Ego, x: float, y: float, z: float) -> bool:
    """Whether something whose middle is here can show."""
    east, north = abs(x - ego.x) < _REACH_M, abs(y - ego.y) < _REACH_M
    return east and north and abs(z - ego.z) < STOREY_M


@compiled
def _put_pixels(ego: Ego, points_m: Array | F32, out: NDArray[np.int32]) -> None:
    """Write columns and rows of world points (N, 2 or 3) in sixteenths of a pixel, (N, 2)."""
    for n in range(len(points_m)):
        dx, dy = points_m[n, 0] - ego.x, points_m[n, 1] - ego.y
        ahead, left = ego.cos * dx + ego.sin * dy, ego.cos * dy - ego.sin * dx
        # Pixel (0, 0) covers 0…1: its centre, which OpenCV counts from, lies at a half.
        out[n, 0] = int(np.rint((0.5 * SIZE_PX - left / PX_M - 0.5) * (1 << _SUBPIXEL_BITS)))
        out[n, 1] = int(np.rint(((AHEAD_M - ahead) / PX_M - 0.5) * (1 << _SUBPIXEL_BITS)))


def _pixels(ego: Ego, lines_m: Array) -> NDArray[np.int32]:
    """Columns and rows of a line of world points (1, N, 2 or 3) in sixteenths of a pixel, (1, N, 2)."""
    out = np.empty((*lines_m.shape[:2], 2), np.int32)
    _put_pixels(ego, lines_m[0], out[0])
    return out


@compiled
def _put_seen(
    ego: Ego, middles_m: Array | F32, corners_m: Array | F32, out: NDArray[np.int32], rows: Index
) -> int:
    """Write pixels and numbers of those polygons that lie in the picture, or within two pixels of it."""
    margin, size, seen = 2 << _SUBPIXEL_BITS, SIZE_PX << _SUBPIXEL_BITS, 0
    for n in range(len(middles_m)):
        if _is_near(ego, middles_m[n, 0], middles_m[n, 1], middles_m[n, 2]):
            at, touches = out[seen], True
            _put_pixels(ego, corners_m[n], at)
            for axis in range(2):
                low = min(at[0, axis], at[1, axis], at[2, axis], at[3, axis])
                high = max(at[0, axis], at[1, axis], at[2, axis], at[3, axis])
                touches &= high > -margin and low < size + margin
            if touches:
                rows[seen] = n
                seen += 1
    return seen


def _seen(ego: Ego, middles_m: Array | F32, corners_m: Array | F32) -> tuple[NDArray[np.int32], Index]:
    """Those of N polygons that show: their corners in sixteenths of a pixel (M, 4, 2), their numbers (M,).

    Args:
        ego: The car, which the picture is taken about.
        middles_m: Their middles, world [m], (N, 3).
        corners_m: Their corners, world [m], (N, 4, 2).
    """
    out, rows = np.empty((len(middles_m), 4, 2), np.int32), np.empty(len(middles_m), np.intp)
    seen = _put_seen(ego, middles_m, corners_m, out, rows)
    return out[:seen], rows[:seen]


def _fill(out: NDArray[np.uint8], polygons: NDArray[np.int32], value: int) -> None:
    """Fill polygons, shape (N, corners, 2); one by one, since `cv2.fillPoly` leaves out what two share."""
    for polygon in polygons:
        cv2.fillConvexPoly(out, polygon, value, cv2.LINE_8, _SUBPIXEL_BITS)


def _line(out: NDArray[np.uint8], lines: NDArray[np.int32], width_px: int, value: int = 255) -> None:
    """Draw lines, shape (N, points, 2)."""
    cv2.polylines(out, list(lines), False, value, width_px, shift=_SUBPIXEL_BITS)


def _pieces(network: LaneNetwork) -> tuple[Array, Array]:
    """Middles (N, 3) and corners (N, 4, 2) of pieces of lanes [m]: two on the left side, two on the right."""
    tables = network.tables
    begins, ends = [], []
    for lane in network.lanes:
        if lane.type == "driving":
            first = int(tables.first[lane.index])
            rows = np.arange(first, first + int(tables.count[lane.index]))
            cuts = np.append(rows[:-1:_STRIP_ROWS], rows[-1])
            begins.append(cuts[:-1])
            ends.append(cuts[1:])
    begin, end = np.concatenate(begins), np.concatenate(ends)
    left = np.stack([-tables.tangent[:, 1], tables.tangent[:, 0]], axis=1) * (0.5 * tables.width_m[:, None])
    at = tables.position_m[:, :2]
    on_left, on_right = at + left, at - left
    corners = np.stack([on_left[begin], on_left[end], on_right[end], on_right[begin]], 1)
    return 0.5 * (tables.position_m[begin] + tables.position_m[end]), corners
