"""A route: one smooth line over lanes, sampled every half metre."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.routing.projection import Line, project_on

_BEHIND_M, _AHEAD_M = 20.0, 40.0


class RoutePose(NamedTuple):
    """Poses along a route, world frame, each field (M, …)."""

    position_m: NDArray[np.float64]
    heading_rad: Array
    pitch_rad: Array
    """Nose up positive."""
    curvature_radpm: Array
    speed_limit_mps: Array
    lane: Index


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Route:
    """Equally spaced samples of a route; the line between them is a cubic."""

    position_m: NDArray[np.float64]
    """(K, 3); a closed route does not repeat its first point."""
    heading_rad: Array
    """In (−π, π], (K,)."""
    slope: Array
    """Rise per metre, (K,)."""
    curvature_radpm: Array
    """Left positive, (K,)."""
    speed_limit_mps: Array
    """(K,)."""
    lane: Index
    """Lane that each sample lies on, (K,)."""
    lane_station_m: Array
    """Its station there, (K,)."""
    length_m: float
    closed: bool
    fitted: NDArray[np.bool_] | None = None
    """Where the line was fitted to the car already, (K,); None for nowhere."""

    @property
    def step_m(self) -> float:
        """Distance between samples."""
        return self.length_m / (len(self.position_m) if self.closed else len(self.position_m) - 1)

    def at(self, s_m: ArrayLike) -> RoutePose:
        """Poses at distances from the start [m], (M,); closed routes go round, open ones end."""
        row, after, f = self._locate(np.atleast_1d(np.asarray(s_m, dtype=np.float64)))
        g, h = 1.0 - f, self.step_m
        w = f * f * (3.0 - 2.0 * f)
        m0, m1 = h * f * g * g, h * f * f * g
        tangents = self._tangents
        position = (
            self.position_m[row] * (1.0 - w)[:, None]
            + self.position_m[after] * w[:, None]
            + tangents(row) * m0[:, None]
            - tangents(after) * m1[:, None]
        )
        heading = self.heading_rad[row] + f * wrap_angle(self.heading_rad[after] - self.heading_rad[row])
        return RoutePose(
            position,
            wrap_angle(heading),
            elementary.arctan(self.slope[row] * g + self.slope[after] * f),
            self.curvature_radpm[row] * g + self.curvature_radpm[after] * f,
            self.speed_limit_mps[row],
            self.lane[row],
        )

    def row_at(self, s_m: float) -> int:
        """Number of the last sample at or before a distance from the start [m]."""
        row = int(s_m / self.step_m)
        number = len(self.position_m)
        return row % number if self.closed else min(max(row, 0), number - 1)

    def project(self, position_m: ArrayLike, near_s_m: float | None = None) -> tuple[float, float]:
        """Distance from the start and offset to the left [m] of a point (2|3,).

        Args:
            position_m: The point; a height is ignored.
            near_s_m: Where the answer was a moment ago: only 20 m back to 40 m on are searched, so that
                a route that crosses itself stays on its own branch.
        """
        x, y = (float(value) for value in np.asarray(position_m, dtype=np.float64)[:2])
        low, count = self._window(near_s_m)
        line = Line(self.position_m, self.heading_rad, self.curvature_radpm, self.step_m, self.closed)
        s, offset = project_on(line, x, y, low, count, self.length_m)
        return float(s), float(offset)

    def starting_at(self, position_m: ArrayLike) -> Route:
        """The same closed route, begun at its sample nearest to a point (2,).

        Raises:
            MapError: The route is open.
        """
        if not self.closed:
            raise MapError("only a loop can start anywhere; set loop = true or move the first route point")
        apart = self.position_m[:, :2] - np.asarray(position_m, dtype=np.float64)[:2]
        first = int(np.argmin(np.sum(apart**2, axis=1)))
        return self.taking(np.roll(np.arange(len(self.position_m)), -first), self.length_m)

    def cut_start(self, length_m: float) -> Route:
        """The last `length_m` metres of an open route, to the nearest sample."""
        first = max(len(self.position_m) - 1 - round(length_m / self.step_m), 0)
        return self.starting_with(first)

    def starting_with(self, row: int) -> Route:
        """The rest of an open route from one of its samples on."""
        return self.taking(np.arange(row, len(self.position_m)), self.length_m - row * self.step_m)

    def taking(self, rows: Index, length_m: float) -> Route:
        """A route of some of the samples, in their new order, and its length [m]."""
        samples = {name: getattr(self, name) for name in _SAMPLES}
        taken = {name: value[rows] for name, value in samples.items() if value is not None}
        return replace(self, length_m=length_m, **taken)

    def is_fitted(self, s_m: ArrayLike) -> NDArray[np.bool_]:
        """Whether the line leaves the lane's middle there for the car to fit round a tight turn, (M,)."""
        row, _, _ = self._locate(np.atleast_1d(np.asarray(s_m, dtype=np.float64)))
        return np.zeros(len(row), dtype=bool) if self.fitted is None else self.fitted[row]

    def _tangents(self, rows: Index) -> NDArray[np.float64]:
        heading = self.heading_rad[rows]
        return np.stack([elementary.cos(heading), elementary.sin(heading), self.slope[rows]], axis=-1)

    def _locate(self, s_m: Array) -> tuple[Index, Index, Array]:
        number = len(self.position_m)
        if self.closed:
            at = np.mod(s_m, self.length_m) / self.step_m
            row = np.minimum(at.astype(np.int64), number - 1)
            return row, (row + 1) % number, at - row
        at = np.clip(s_m / self.step_m, 0.0, number - 1.0)
        row = np.minimum(at.astype(np.int64), number - 2)
        return row, row + 1, at - row

    def _window(self, near_s_m: float | None) -> tuple[int, int]:
        """First sample to look at, and how many; those of a closed route go round."""
        number = len(self.position_m)
        if near_s_m is None or (self.closed and self.length_m < _BEHIND_M + _AHEAD_M):
            return 0, number
        low = int((near_s_m - _BEHIND_M) / self.step_m)
        high = int((near_s_m + _AHEAD_M) / self.step_m) + 1
        if self.closed:
            return low, high - low
        low = min(max(low, 0), number - 1)
        return low, min(max(high, low + 1), number) - low


_SAMPLES = tuple(field.name for field in fields(Route) if field.name not in ("length_m", "closed"))
"""Fields of a route that have a row for each sample."""
