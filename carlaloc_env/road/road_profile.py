"""The profile of a town's roads: a function of place and map alone, in two parts.

Waves of 10 to 50 m are relief: they lie in the town's meshes, so that every sensor sees them. Shorter
ones, down to what a tyre's footprint levels out, are roughness: a few millimetres that only the
wheels feel. Together they are one isotropic surface of the classes of ISO 8608.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.road.road_events import (
    EventTable,
    event_height,
    event_table,
    no_events,
)
from carlaloc_env.road.rough_surface import (
    STANDARD_WAVINESS,
    RoughSurface,
    WaveTable,
    wave_height,
)

LONGEST_WAVE_M, SPLIT_WAVE_M, SHORTEST_WAVE_M = 50.0, 10.0, 0.25
"""Wavelengths at which relief begins, roughness takes over, and roughness ends [m]."""
FOOTPRINT_M = 0.15
"""Length and width of the patch on which a tyre stands, over which it levels out the road [m]."""


class LevelTable(NamedTuple):
    """Roughness of roads by place, for compiled functions."""

    level: Array
    """Level at each point, east then north, shape (I, J)."""
    low_m: tuple[float, float]
    """World x and y of the first point [m]."""
    cell_m: float
    """Distance of the points [m]."""


class RoughTable(NamedTuple):
    """A `Roughness` for compiled functions."""

    level: LevelTable
    """How rough roads are."""
    waves: WaveTable
    """Waves at a level of 1."""
    events: EventTable
    """Covers, repairs and joints."""


class LevelGrid:
    """Roughness of roads by place: heights over those of the unit surface, bilinear on a grid.

    Args:
        low_m: World x and y of the first point [m].
        cell_m: Distance of the points [m].
        level: Level at each point, east then north, shape (I, J).
    """

    def __init__(self, low_m: tuple[float, float], cell_m: float, level: Array) -> None:
        self._low, self._cell = low_m, cell_m
        self._level = np.ascontiguousarray(level, dtype=np.float64)

    @property
    def table(self) -> LevelTable:
        """The grid for compiled functions."""
        return LevelTable(self._level, (float(self._low[0]), float(self._low[1])), float(self._cell))

    @classmethod
    def uniform(cls, level: float) -> LevelGrid:
        """The same level everywhere."""
        return cls((0.0, 0.0), 1.0, np.full((2, 2), level))

    def levels(self, xy_m: Array) -> NDArray[np.float64]:
        """Level and its slopes [1/m] towards east and north at places (M, 2), shape (M, 3)."""
        level, (low_u, low_v) = self._level, self._low
        x, y = np.asarray(xy_m, dtype=np.float64)[:, :2].T
        (i, f, free_u) = _cell((x - low_u) / self._cell, len(level))
        (j, g, free_v) = _cell((y - low_v) / self._cell, level.shape[1])
        a, b, c, d = level[i, j], level[i, j + 1], level[i + 1, j], level[i + 1, j + 1]
        east = ((1 - g) * (c - a) + g * (d - b)) / self._cell * free_u
        north = ((1 - f) * (b - a) + f * (d - c)) / self._cell * free_v
        height = (1 - f) * ((1 - g) * a + g * b) + f * ((1 - g) * c + g * d)
        return np.stack([height, east, north], axis=1)


def _cell(along: Array, count: int) -> tuple[Index, Array, NDArray[np.bool_]]:
    """Cells at distances along a grid in cells, the parts before, and whether they lie on the grid."""
    end = count - 1.001
    # Lanes that are not finite are refused later, with their names.
    held = np.where(np.isnan(along), 0.0, np.clip(along, 0.0, end))
    cell = held.astype(np.intp)
    return cell, held - cell, (along > 0.0) & (along < end)


class Relief:
    """Waves of 10 to 50 m.

    Args:
        seed: Number from which they are drawn.
        level: How rough roads are.
    """

    def __init__(self, seed: int, level: LevelGrid) -> None:
        self._level = level
        self._surface = RoughSurface(
            seed,
            "road/relief",
            waves_cpm=(1.0 / LONGEST_WAVE_M, 1.0 / SPLIT_WAVE_M),
            spacing_m=2.5,
            size=512,
        )

    def heights(self, xy_m: Array) -> NDArray[np.float64]:
        """Height [m] and its slopes towards east and north at places (M, 2), shape (M, 3)."""
        unit, level = self._surface.heights(xy_m), self._level.levels(xy_m)
        result = unit * level[:, :1]
        result[:, 1:] += unit[:, :1] * level[:, 1:]
        return result


class Roughness:
    """Waves of 10 m down to a tyre's footprint, and events, as the tyre's patch on the road averages them.

    Args:
        seed: Number from which the waves are drawn.
        level: How rough roads are.
        events: Covers, repairs and joints, columns of `road_events`, shape (N, 7); None: none.
        waviness: How fast the waves' spectrum falls; at 10 m it meets the relief's.
    """

    def __init__(
        self,
        seed: int,
        level: LevelGrid,
        events: Array | None = None,
        *,
        waviness: float = STANDARD_WAVINESS,
    ) -> None:
        self._seed, self._level, self._events = seed, level, events
        surface = RoughSurface(
            seed,
            "road/roughness",
            waves_cpm=(1.0 / SPLIT_WAVE_M, 1.0 / SHORTEST_WAVE_M),
            spacing_m=0.1,
            size=1024,
            blur_m=FOOTPRINT_M / math.sqrt(12.0),
            waviness=waviness,
        )
        events_table = event_table(no_events() if events is None else events, FOOTPRINT_M)
        self.table = RoughTable(level.table, surface.table, events_table)
        """The same for compiled functions."""

    def of_waviness(self, waviness: float) -> Roughness:
        """The same roads with another spectrum of the waves."""
        return Roughness(self._seed, self._level, self._events, waviness=waviness)

    def height(self, x_m: float, y_m: float) -> float:
        """Height under a tyre at one place of the world [m]."""
        return rough_height(self.table, x_m, y_m)


def no_roughness() -> RoughTable:
    """Roads without roughness."""
    level = LevelTable(np.zeros((2, 2)), (0.0, 0.0), 1.0)
    waves = WaveTable(np.zeros((4, 4), np.float32), (1.0, 0.0))
    return RoughTable(level, waves, event_table(no_events(), FOOTPRINT_M))


@compiled
def level_at(table: LevelTable, x_m: float, y_m: float) -> float:
    """Level at one place; the border's level outside the grid."""
    level = table.level
    u, v = (x_m - table.low_m[0]) / table.cell_m, (y_m - table.low_m[1]) / table.cell_m
    u = min(max(u, 0.0), len(level) - 1.001) if u == u else 0.0
    v = min(max(v, 0.0), level.shape[1] - 1.001) if v == v else 0.0
    i, j = int(u), int(v)
    f, g = u - i, v - j
    a, b, c, d = level[i, j], level[i, j + 1], level[i + 1, j], level[i + 1, j + 1]
    return float((1 - f) * ((1 - g) * a + g * b) + f * ((1 - g) * c + g * d))


@compiled
def rough_height(table: RoughTable, x_m: float, y_m: float) -> float:
    """Height under a tyre at one place of the world [m]."""
    waves = level_at(table.level, x_m, y_m) * wave_height(table.waves, x_m, y_m)
    return float(waves + event_height(table.events, x_m, y_m))
