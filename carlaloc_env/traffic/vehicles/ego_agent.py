"""The ego as other road users see it, and the lanes it stands on and heads for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.ego_car import EGO_SIZE_M
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Presence, add_body
from carlaloc_env.traffic.tables.record_arrays import Flags, columns
from carlaloc_env.traffic.tables.vehicle_state import HELD, Fleet

CELL_M = 8.0
_OVERLAP_M = 0.3
_HEIGHT_M = 3.0
_HEAD_FOR_M = 1.5
_LOOK_AHEAD_S = 2.0
_FOUND = 48
_ALONG = 0.7
"""Cosine of the angle within which the ego drives along a lane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EgoView:
    """What other road users see of the ego."""

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

    def numbers(self) -> Array:
        """Centre [m], cosine and sine of the heading, speed [m/s], half length and half width [m], (8,)."""
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        half = (0.5 * self.length_m, 0.5 * self.width_m)
        return np.array([*self.position_m, c, s, self.speed_mps, *half], dtype=np.float64)


class Found:
    """Lanes that the ego touches."""

    lane: Index
    row: Index
    """Sample nearest to the ego's centre."""
    m: Array
    """How far ahead of or behind that centre it lies [m]."""


class Cells(NamedTuple):
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
    found: Found
    """Room for the lanes that were found."""


def build_cells(roads: Roads, driving: Flags) -> Cells:
    """Cells over all samples of some lanes, (N,) of them."""
    owner = np.repeat(np.arange(len(driving)), roads.lane.row_count)
    rows = np.flatnonzero(driving[owner])
    xy = roads.row.position_m[rows, :2]
    corner = np.floor(xy.min(axis=0) / CELL_M) * CELL_M
    place = ((xy - corner) / CELL_M).astype(np.int64)
    size = place.max(axis=0) + 1
    cell = place[:, 1] * size[0] + place[:, 0]
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(size[0] * size[1] + 1))
    return Cells(
        corner_m=corner,
        size=size,
        first=first.astype(np.int64),
        row=rows[order].astype(np.int64),
        lane=owner[rows[order]],
        found=columns(Found, _FOUND),
    )


@compiled
def place_ego(there: Presence, cells: Cells, roads: Roads, fleet: Fleet, ego: Array) -> None:
    """Put the ego on every lane that its box touches, and hold the junction lanes it drives along.

    Its body is the last row of the fleet; to whatever lies straight ahead of it within two seconds it
    has the first right.
    """
    me = len(fleet.speed_mps) - 1
    fleet.speed_mps[me] = ego[5]
    fleet.held_lane[me, :] = -1
    _touch(there, cells, roads, fleet, me, ego)
    reach = max(_LOOK_AHEAD_S * ego[5], 0.5)
    steps = int(reach) + 1
    for k in range(steps):
        ahead = ego[6] + reach * k / steps
        _head_for(cells, roads, fleet, me, ego, ego[0] + ahead * ego[3], ego[1] + ahead * ego[4], ahead)


@compiled
def _cell_range(cells: Cells, x: float, y: float) -> tuple[int, int, int, int]:
    i = int(np.floor((x - cells.corner_m[0]) / CELL_M))
    j = int(np.floor((y - cells.corner_m[1]) / CELL_M))
    return (
        max(i - 1, 0),
        min(i + 2, int(cells.size[0])),
        max(j - 1, 0),
        min(j + 2, int(cells.size[1])),
    )


@compiled
def _touch(there: Presence, cells: Cells, roads: Roads, fleet: Fleet, me: int, ego: Array) -> None:
    west, east, south, north = _cell_range(cells, ego[0], ego[1])
    lanes, rows, best = cells.found.lane, cells.found.row, cells.found.m
    found = 0
    for j in range(south, north):
        for i in range(west, east):
            cell = j * cells.size[0] + i
            for k in range(cells.first[cell], cells.first[cell + 1]):
                row, lane = cells.row[k], cells.lane[k]
                if abs(roads.row.position_m[row, 2] - ego[2]) > _HEIGHT_M:
                    continue
                c, s = roads.row.tangent[row, 0], roads.row.tangent[row, 1]
                dx, dy = ego[0] - roads.row.position_m[row, 0], ego[1] - roads.row.position_m[row, 1]
                along, across = dx * c + dy * s, dy * c - dx * s
                cos, sin = abs(c * ego[3] + s * ego[4]), abs(c * ego[4] - s * ego[3])
                if abs(along) > ego[6] * cos + ego[7] * sin:
                    continue
                if abs(across) > 0.5 * roads.row.width_m[row] + ego[6] * sin + ego[7] * cos - _OVERLAP_M:
                    continue
                known = 0
                while known < found and lanes[known] != lane:
                    known += 1
                if known == found:
                    if found == _FOUND:
                        continue
                    found += 1
                    best[known] = np.inf
                if abs(along) < best[known]:
                    lanes[known], best[known], rows[known] = lane, abs(along), row
    for k in range(found):
        lane, row = lanes[k], rows[k]
        c, s = roads.row.tangent[row, 0], roads.row.tangent[row, 1]
        along = (ego[0] - roads.row.position_m[row, 0]) * c + (ego[1] - roads.row.position_m[row, 1]) * s
        station = (row - roads.lane.row_first[lane]) * roads.lane.row_step_m[lane] + along
        turn = c * ego[3] + s * ego[4]
        half = ego[6] * abs(turn) + ego[7] * abs(c * ego[4] - s * ego[3])
        add_body(there, lane, station, half, max(0.0, ego[5] * turn), me)
        if turn > _ALONG and roads.lane.junction[lane] >= 0:
            _hold(fleet, me, lane, station + half)


@compiled
def _head_for(
    cells: Cells, roads: Roads, fleet: Fleet, me: int, ego: Array, x: float, y: float, ahead_m: float
) -> None:
    i = int(np.floor((x - cells.corner_m[0]) / CELL_M))
    j = int(np.floor((y - cells.corner_m[1]) / CELL_M))
    if i < 0 or j < 0 or i >= cells.size[0] or j >= cells.size[1]:
        return
    cell = j * cells.size[0] + i
    for k in range(cells.first[cell], cells.first[cell + 1]):
        row, lane = cells.row[k], cells.lane[k]
        if roads.lane.junction[lane] < 0 or abs(roads.row.position_m[row, 2] - ego[2]) > _HEIGHT_M:
            continue
        c, s = roads.row.tangent[row, 0], roads.row.tangent[row, 1]
        dx, dy = x - roads.row.position_m[row, 0], y - roads.row.position_m[row, 1]
        along, across = dx * c + dy * s, dy * c - dx * s
        if (
            abs(along) < roads.lane.row_step_m[lane]
            and abs(across) < _HEAD_FOR_M
            and c * ego[3] + s * ego[4] > _ALONG
        ):
            station = (row - roads.lane.row_first[lane]) * roads.lane.row_step_m[lane] + along
            _hold(fleet, me, lane, station - (ahead_m - ego[6]))


@compiled
def _hold(fleet: Fleet, me: int, lane: int, front_m: float) -> None:
    for k in range(HELD):
        if fleet.held_lane[me, k] == lane:
            return
        if fleet.held_lane[me, k] < 0:
            fleet.held_lane[me, k] = lane
            fleet.held_front_m[me, k] = front_m
            fleet.held_ticket[me, k] = 0
            return
