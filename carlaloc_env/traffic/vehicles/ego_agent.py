"""Egos as other road users see them, and the lanes they stand on and head for."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_geometry import centre_at
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy, add_body
from carlaloc_env.traffic.tables.record_arrays import Flags, columns
from carlaloc_env.traffic.tables.vehicle_state import HELD, Drivers, Fleet
from carlaloc_env.traffic.vehicles.poses import place_ahead

CELL_M = 8.0
"""Side of a cell [m]; no lane is so wide that its vehicles reach beyond the next one."""
_OVERLAP_M = 0.3
"""The ego is on a lane when its box reaches so far over the lane's edge [m]."""
_HEIGHT_M = 3.0
"""Lanes farther above or below are on another level [m]."""
_RESERVE_SIDE_M = 1.5
"""The ego heads for junction lanes whose middle is this close to its line ahead [m]."""
_LOOK_AHEAD_S = 2.0
"""Time ahead for which junction lanes are kept free for the ego [s]."""
_ALONG = 0.7
"""Cosine of the angle within which the ego drives along a lane."""


class EgoBox(NamedTuple):
    """Box of the ego on the ground plane, world frame."""

    x_m: float
    """Centre, east [m]."""
    y_m: float
    """Centre, north [m]."""
    z_m: float
    """Height of the ground below the centre [m]."""
    cos: float
    """Cosine of the heading."""
    sin: float
    """Sine of the heading."""
    speed_mps: float
    """Forward speed [m/s]."""
    half_length_m: float
    """Half the length [m]."""
    half_width_m: float
    """Half the width [m]."""


class EgoBoxes:
    """Boxes of C egos, columns named as in `EgoBox`."""

    x_m: Array
    y_m: Array
    z_m: Array
    cos: Array
    sin: Array
    speed_mps: Array
    half_length_m: Array
    half_width_m: Array


@compiled
def box_of(boxes: EgoBoxes, c: int) -> EgoBox:
    """The box of one ego."""
    return EgoBox(
        boxes.x_m[c], boxes.y_m[c], boxes.z_m[c], boxes.cos[c], boxes.sin[c], boxes.speed_mps[c],
        boxes.half_length_m[c], boxes.half_width_m[c],
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class EgoView:
    """The ego as other road users see it."""

    position_m: tuple[float, float, float]
    """Centre of the ego's box on the ground [m], world."""
    heading_rad: float
    """Heading [rad]."""
    speed_mps: float
    """Forward speed [m/s]."""
    length_m: float = EGO_SIZE_M[0]
    """Length of the ego [m]."""
    width_m: float = EGO_SIZE_M[1]
    """Width of the ego [m]."""

    def box(self) -> EgoBox:
        """The ego's box as compiled functions read it."""
        x, y, z = self.position_m
        sine, cosine = sin_cos(self.heading_rad)
        return EgoBox(
            x_m=float(x),
            y_m=float(y),
            z_m=float(z),
            cos=cosine,
            sin=sine,
            speed_mps=float(self.speed_mps),
            half_length_m=0.5 * float(self.length_m),
            half_width_m=0.5 * float(self.width_m),
        )


class TouchedLanes:
    """Lanes that the ego touches."""

    lane: Index
    row: Index
    """Sample nearest to the ego's centre."""
    distance_m: Array
    """How far ahead of or behind that centre it lies [m]."""


class LaneCells(NamedTuple):
    """Samples of the driving lanes sorted into square cells."""

    corner_m: Array
    """South-west corner of the first cell [m], (2,)."""
    size: Index
    """Cells from west to east and from south to north, (2,)."""
    first: Index
    """Rows of `row` for each cell, (cells + 1,)."""
    row: Index
    """Samples, (R,)."""
    lane: Index
    """Lane of each of them, (R,)."""
    touched: TouchedLanes
    """Room for the lanes that the ego touches, one row a lane."""


def build_cells(roads: Roads, driving: Flags) -> LaneCells:
    """Cells over all samples of some lanes, (N,) of them."""
    owner = np.repeat(np.arange(len(driving)), roads.lane.row_count)
    rows = np.flatnonzero(driving[owner])
    xy = roads.row.position_m[rows, :2]
    corner = np.floor(xy.min(axis=0) / CELL_M) * CELL_M
    cell_xy = ((xy - corner) / CELL_M).astype(np.int64)
    size = cell_xy.max(axis=0) + 1
    cell = cell_xy[:, 1] * size[0] + cell_xy[:, 0]
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(size[0] * size[1] + 1))
    return LaneCells(
        corner_m=corner,
        size=size,
        first=first.astype(np.int64),
        row=rows[order].astype(np.int64),
        lane=owner[rows[order]],
        touched=columns(TouchedLanes, len(driving)),
    )


@compiled
def add_ego(occupancy: Occupancy, cells: LaneCells, roads: Roads, fleet: Fleet, me: int, ego: EgoBox) -> None:
    """Add an ego to every lane that its box touches, and hold the junction lanes it drives along.

    Its body is row `me` of the fleet; it has the right of way on what lies straight
    ahead of it within two seconds.
    """
    fleet.speed_mps[me] = ego.speed_mps
    fleet.held_lane[me, :] = -1
    _occupy_lanes(occupancy, cells, roads, fleet, me, ego)
    range_m = max(_LOOK_AHEAD_S * ego.speed_mps, 0.5)
    steps = int(range_m) + 1
    for k in range(steps):
        ahead = ego.half_length_m + range_m * k / steps
        x, y = ego.x_m + ahead * ego.cos, ego.y_m + ahead * ego.sin
        _reserve_ahead(cells, roads, fleet, me, ego, x, y, ahead)


@compiled
def _cell_range(cells: LaneCells, x: float, y: float) -> tuple[int, int, int, int]:
    """Cells around a point (x, y) [m]: first and end column, first and end row."""
    i = int(np.floor((x - cells.corner_m[0]) / CELL_M))
    j = int(np.floor((y - cells.corner_m[1]) / CELL_M))
    return max(i - 1, 0), min(i + 2, int(cells.size[0])), max(j - 1, 0), min(j + 2, int(cells.size[1]))


@compiled
def _occupy_lanes(
    occupancy: Occupancy, cells: LaneCells, roads: Roads, fleet: Fleet, me: int, ego: EgoBox
) -> None:
    """Add the ego's body to each lane that its box touches; hold junction lanes that it drives along."""
    west, east, south, north = _cell_range(cells, ego.x_m, ego.y_m)
    lanes, rows, best = cells.touched.lane, cells.touched.row, cells.touched.distance_m
    count = 0
    for j in range(south, north):
        for i in range(west, east):
            cell = j * cells.size[0] + i
            for k in range(cells.first[cell], cells.first[cell + 1]):
                row, lane = cells.row[k], cells.lane[k]
                if abs(roads.row.position_m[row, 2] - ego.z_m) > _HEIGHT_M:
                    continue
                c, s = roads.row.tangent[row, 0], roads.row.tangent[row, 1]
                dx, dy = ego.x_m - roads.row.position_m[row, 0], ego.y_m - roads.row.position_m[row, 1]
                along, across = dx * c + dy * s, dy * c - dx * s
                cos, sin = abs(c * ego.cos + s * ego.sin), abs(c * ego.sin - s * ego.cos)
                if abs(along) > ego.half_length_m * cos + ego.half_width_m * sin:
                    continue
                side = 0.5 * roads.row.width_m[row] + ego.half_length_m * sin + ego.half_width_m * cos
                if abs(across) > side - _OVERLAP_M:
                    continue
                slot = 0
                while slot < count and lanes[slot] != lane:
                    slot += 1
                if slot == count:
                    count += 1
                    best[slot] = np.inf
                if abs(along) < best[slot]:
                    lanes[slot], best[slot], rows[slot] = lane, abs(along), row
    for k in range(count):
        lane, row = lanes[k], rows[k]
        c, s = roads.row.tangent[row, 0], roads.row.tangent[row, 1]
        along = (ego.x_m - roads.row.position_m[row, 0]) * c + (ego.y_m - roads.row.position_m[row, 1]) * s
        station = (row - roads.lane.row_first[lane]) * roads.lane.row_step_m[lane] + along
        turn = c * ego.cos + s * ego.sin
        half = ego.half_length_m * abs(turn) + ego.half_width_m * abs(c * ego.sin - s * ego.cos)
        add_body(occupancy, lane, station, half, max(0.0, ego.speed_mps * turn), me)
        if turn > _ALONG and roads.lane.junction[lane] >= 0:
            _hold(fleet, me, lane, station + half)


@compiled
def _reserve_ahead(
    cells: LaneCells, roads: Roads, fleet: Fleet, me: int, ego: EgoBox, x: float, y: float, ahead_m: float
) -> None:
    """Hold the junction lanes that the ego heads for at a point (x, y), `ahead_m` before its centre [m]."""
    i = int(np.floor((x - cells.corner_m[0]) / CELL_M))
    j = int(np.floor((y - cells.corner_m[1]) / CELL_M))
    if i < 0 or j < 0 or i >= cells.size[0] or j >= cells.size[1]:
        return
    cell = j * cells.size[0] + i
    for k in range(cells.first[cell], cells.first[cell + 1]):
        row, lane = cells.row[k], cells.lane[k]
        if roads.lane.junction[lane] < 0 or abs(roads.row.position_m[row, 2] - ego.z_m) > _HEIGHT_M:
            continue
        c, s = roads.row.tangent[row, 0], roads.row.tangent[row, 1]
        dx, dy = x - roads.row.position_m[row, 0], y - roads.row.position_m[row, 1]
        along, across = dx * c + dy * s, dy * c - dx * s
        if (
            abs(along) < roads.lane.row_step_m[lane]
            and abs(across) < _RESERVE_SIDE_M
            and c * ego.cos + s * ego.sin > _ALONG
        ):
            station = (row - roads.lane.row_first[lane]) * roads.lane.row_step_m[lane] + along
            _hold(fleet, me, lane, station - (ahead_m - ego.half_length_m))


@compiled
def _hold(fleet: Fleet, me: int, lane: int, front_m: float) -> None:
    """Let the ego hold a junction lane with its front at a station [m]; at most HELD lanes."""
    for k in range(HELD):
        if fleet.held_lane[me, k] == lane:
            return
        if fleet.held_lane[me, k] < 0:
            fleet.held_lane[me, k] = lane
            fleet.held_front_m[me, k] = front_m
            fleet.held_ticket[me, k] = 0
            return


_PASSING_M = 0.2
"""Room that a vehicle needs beside the standing ego [m]."""
_PASSING_STEP_M = 0.5
"""Spacing of the places at which its box is compared with the ego's [m]."""


@compiled
def passes_ego(roads: Roads, drivers: Drivers, fleet: Fleet, ego: EgoBox, v: int, reach_m: float) -> bool:
    """Whether vehicle v would not touch the standing ego on the next `reach_m` [m] of its lanes."""
    half, width = 0.5 * drivers.length_m[v], 0.5 * drivers.width_m[v] + _PASSING_M
    axle = 0.5 * drivers.wheelbase_m[v]
    for k in range(int(reach_m / _PASSING_STEP_M) + 2):
        lane, station = place_ahead(roads, fleet, v, k * _PASSING_STEP_M + axle)
        x, y, _, _ = centre_at(roads, lane, station)
        lane, station = place_ahead(roads, fleet, v, k * _PASSING_STEP_M - axle)
        rear_x, rear_y, _, _ = centre_at(roads, lane, station)
        apart = max(np.sqrt((x - rear_x) ** 2 + (y - rear_y) ** 2), 0.1)
        c, s = (x - rear_x) / apart, (y - rear_y) / apart
        dx, dy = 0.5 * (x + rear_x) - ego.x_m, 0.5 * (y + rear_y) - ego.y_m
        cos, sin = abs(c * ego.cos + s * ego.sin), abs(s * ego.cos - c * ego.sin)
        # Boxes are apart where one of their four axes separates them.
        if (
            abs(dx * c + dy * s) < half + ego.half_length_m * cos + ego.half_width_m * sin
            and abs(dy * c - dx * s) < width + ego.half_length_m * sin + ego.half_width_m * cos
            and abs(dx * ego.cos + dy * ego.sin) < ego.half_length_m + half * cos + width * sin
            and abs(dy * ego.cos - dx * ego.sin) < ego.half_width_m + half * sin + width * cos
        ):
            return False
    return True
