"""Falling rain: drops with places in the world, the same for every camera and every moment.

Each size of drops is a lattice of cells that falls as a whole with its terminal velocity and drifts
with the wind; a hash of the cell places the drops in it. So any picture can be made alone, both
cameras see the same drops, and they continue to fall in the next picture.

Drops of rain in the cells of a lattice, and the light that lamps give them, compiled by numba.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.core.transforms import cross
from carlaloc_env.render.lighting.light_sources import LAMP_LEAST_M, Lights, batwing_gain, range_window
from carlaloc_env.render.lighting.light_table import low_beam
from carlaloc_env.render.views import CameraView
from carlaloc_env.weather.parameters import WeatherParameters

_FORWARD = 0.85
"""g of the Henyey–Greenstein lobe into which drops scatter three quarters of a lamp's light."""

_batwing = inlined(batwing_gain)
_window = inlined(range_window)


@inlined
def mixed(x: np.uint32) -> np.uint32:
    """Hash of a number."""
    x = np.uint32(x ^ (x >> np.uint32(16)))
    x = np.uint32(x * np.uint32(0x7FEB352D))
    x = np.uint32(x ^ (x >> np.uint32(15)))
    x = np.uint32(x * np.uint32(0x846CA68B))
    return np.uint32(x ^ (x >> np.uint32(16)))


@inlined
def _least(x: float, y: float, z: float, planes: Array) -> float:
    """Signed distance [m] of a place to the nearest of planes, shape (K, 4): positive inside all of them."""
    least = math.inf
    for k in range(len(planes)):
        distance = x * planes[k, 0] + y * planes[k, 1] + z * planes[k, 2] + planes[k, 3]
        least = min(least, distance)
    return least


@compiled
def drops_in_cells(
    places: Array,
    low: NDArray[np.int64],
    high: NDArray[np.int64],
    home: Array,
    planes: Array,
    key: np.uint32,
    most: int,
    below: np.uint32,
) -> int:
    """Write the drops of cells of edge 1 that lie inside planes.

    Args:
        places: Room for places from the eye, shape (N, 3).
        low: First cell, shape (3,).
        high: Last cell, shape (3,).
        home: The eye in the lattice, shape (3,).
        planes: Normals and offsets, shape (K, 4).
        key: Of the lattice's hash.
        most: Most drops of a cell.
        below: Hash below which a drop is there.

    Returns:
        Number of drops.
    """
    count = 0
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            for k in range(low[2], high[2] + 1):
                # Half of a cell's diagonal is 0.87.
                if _least(i + 0.5 - home[0], j + 0.5 - home[1], k + 0.5 - home[2], planes) <= -0.87:
                    continue
                cell = mixed(mixed(mixed(key ^ np.uint32(i)) ^ np.uint32(j)) ^ np.uint32(k))
                for drop in range(most):
                    lot = mixed(np.uint32(cell + np.uint32(np.uint32(drop) * np.uint32(0x9E3779B9))))
                    if lot >= below:
                        continue
                    lot = mixed(np.uint32(lot + np.uint32(0x85EBCA6B)))
                    x = i + lot * 2.0**-32 - home[0]
                    lot = mixed(np.uint32(lot + np.uint32(0x85EBCA6B)))
                    y = j + lot * 2.0**-32 - home[1]
                    lot = mixed(np.uint32(lot + np.uint32(0x85EBCA6B)))
                    z = k + lot * 2.0**-32 - home[2]
                    if _least(x, y, z, planes) > 0.0:
                        places[count, 0], places[count, 1], places[count, 2] = x, y, z
                        count += 1
    return count


@compiled
def light_drops(
    shine: Array,
    drops: Array,
    lamps: Array,
    axes: Array,
    lefts: Array,
    ups: Array,
    colours: Array,
    edges: Array,
    caps: Array,
    ranges: Array,
    beams: NDArray[np.bool_],
) -> None:
    """Add what lamps give to drops, see `lit`.

    Args:
        shine: Luminance of the drops [cd/m²], shape (N, 3).
        drops: Places from the eye [m], shape (N, 3).
        lamps: Places from the eye [m], shape (K, 3).
        axes: Middles of the beams, shape (K, 3).
        lefts: Left of headlamps, shape (K, 3).
        ups: Above headlamps, shape (K, 3).
        colours: Intensities [cd], shape (K, 3).
        edges: Cosines between which a beam ends, shape (K, 2).
        caps: Most gain, shape (K,).
        ranges: Where the light has faded to nothing [m], shape (K,).
        beams: Whether it is a low beam, shape (K,).
    """
    for n in range(len(drops)):
        x, y, z = drops[n, 0], drops[n, 1], drops[n, 2]
        away = max(math.sqrt(x * x + y * y + z * z), 1e-9)
        for k in range(len(lamps)):
            u, v, w = x - lamps[k, 0], y - lamps[k, 1], z - lamps[k, 2]
            r2 = max(u * u + v * v + w * w, LAMP_LEAST_M * LAMP_LEAST_M)
            per_r = 1.0 / math.sqrt(r2)
            u, v, w = u * per_r, v * per_r, w * per_r
            ahead = u * axes[k, 0] + v * axes[k, 1] + w * axes[k, 2]
            if beams[k]:
                left = u * lefts[k, 0] + v * lefts[k, 1] + w * lefts[k, 2]
                gain = low_beam(ahead, left, u * ups[k, 0] + v * ups[k, 1] + w * ups[k, 2])
            else:
                gain = _batwing(ahead, edges[k, 0], edges[k, 1], caps[k])
            spread = 1.0 + _FORWARD**2 + 2.0 * _FORWARD * (u * x + v * y + w * z) / away
            lobe = (1.0 - _FORWARD**2) / (spread * math.sqrt(spread))
            phase = (0.75 * lobe + 0.25) / (4.0 * math.pi)
            given = gain * _window(r2 / (ranges[k] * ranges[k])) * phase / r2
            for channel in range(3):
                shine[n, channel] += given * colours[k, channel]


CELL_M = 1.0
"""Edge of the cells of the lattices of drops [m]."""
SIZES_MM = ((1.6, 0.5, 2.2), (2.1, 0.55, 3.2), (2.7, 0.7, 4.5), (3.5, 1.0, 6.5))
"""Diameter [mm], width of its class [mm] and distance up to which single drops are drawn [m].

Smaller and farther ones are thinner than half a pixel: they are the air's extinction.
"""
NEAR_M = 0.35
"""Distance below which no drop is drawn [m]: the lens is wiped there."""
MOST_LAMPS = 6
"""Lamps that light the drops before a camera, the nearest ones."""
_AROUND_M = 0.4
"""Margin round the view for streaks that reach into it [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Streaks:
    """Streaks of N drops during an exposure, relative to the moving eye, world axes."""

    end_m: Array
    """Where the drops are at the end of the exposure [m], shape (N, 3)."""
    begin_m: Array
    """Where they were at its beginning, seen from where the eye was then [m], shape (N, 3)."""
    diameter_m: Array
    """Shape (N,)."""

    def __len__(self) -> int:
        return len(self.end_m)

    def take(self, which: NDArray[np.intp]) -> Streaks:
        """Some of the streaks."""
        return Streaks(**{name: getattr(self, name)[which] for name in self.__slots__})

    @property
    def opacity(self) -> Array:
        """Share of the exposure during which a drop covers a point of its streak, shape (N,)."""
        length = np.sqrt(np.sum((self.end_m - self.begin_m) ** 2, axis=1))
        return np.asarray(np.minimum(self.diameter_m / np.maximum(length, 1e-6), 1.0))


def terminal_mps(diameter_mm: float) -> float:
    """Speed of a falling drop [m/s] (Atlas, Srivastava and Sekhon 1973)."""
    return 9.65 - 10.3 * math.exp(-0.6 * diameter_mm)


def drops_per_m3(rain_mmph: float, diameter_mm: float, width_mm: float) -> float:
    """Number of drops of a class in a cubic metre (Marshall and Palmer 1948)."""
    if rain_mmph <= 0.0:
        return 0.0
    slope = 4.1 * rain_mmph**-0.21
    return 8000.0 * math.exp(-slope * diameter_mm) * width_mm


def rain_streaks(
    view: CameraView,
    weather: WeatherParameters,
    *,
    stamp_ns: int,
    seed: int,
    velocity_mps: Array,
    exposure_time_s: float,
) -> Streaks:
    """All drops near a camera that show as streaks.

    Args:
        view: Camera at the end of the exposure.
        weather: Rain and wind.
        stamp_ns: End of the exposure [ns].
        seed: Seed of the rain.
        velocity_mps: Velocity of the camera in the world, shape (3,).
        exposure_time_s: Exposure time [s].
    """
    wind = weather.wind_mps
    key = int(clock.stream(seed, "render/rain").integers(1 << 32))
    ends, falls, sizes = [], [], []
    for index, (diameter, width, reach) in enumerate(SIZES_MM):
        density = drops_per_m3(weather.rain_mmph, diameter, width) * CELL_M**3
        velocity = np.array([*wind[:2], -terminal_mps(diameter)])
        drift = velocity * (stamp_ns * 1e-9)
        places = _lattice(view, drift, density, reach, key ^ (0x9E3779B9 * (index + 1) & 0xFFFFFFFF))
        ends.append(places)
        falls.append(np.broadcast_to(velocity, places.shape))
        sizes.append(np.full(len(places), diameter * 1e-3))
    end = np.concatenate(ends)
    return Streaks(
        end_m=end,
        begin_m=end - (np.concatenate(falls) - velocity_mps) * exposure_time_s,
        diameter_m=np.concatenate(sizes),
    )


def _lattice(view: CameraView, drift_m: Array, density: float, range_m: float, key: int) -> Array:
    """Drops of one size inside a view [m from the eye], shape (N, 3)."""
    ahead = view.R_camera_world[2:]
    normals = np.concatenate([view.planes()[:, :3], ahead, -ahead])
    planes = np.column_stack([normals, [_AROUND_M] * 4 + [-NEAR_M, range_m]])
    sx, sy, ox, oy = view.clip_scale
    far = [[(i - ox) / sx, (j - oy) / sy, 1.0] for i in (-1, 1) for j in (-1, 1)]
    corners = np.array([*far, [0.0, 0.0, 0.0]])
    corners = np.sum((corners * range_m)[:, :, None] * view.R_camera_world[None], axis=1)
    home = view.position_m - drift_m
    low = np.floor((home + corners.min(axis=0) - _AROUND_M) / CELL_M).astype(np.int64)
    high = np.floor((home + corners.max(axis=0) + _AROUND_M) / CELL_M).astype(np.int64)
    most = math.ceil(density)
    places = np.empty((int(np.prod(high - low + 1)) * most, 3))
    below = np.uint32(min(density / max(most, 1), 1.0) * (2**32 - 1))
    count = drops_in_cells(places, low, high, home, planes, np.uint32(key), most, below)
    return places[:count]


def lit(streaks: Streaks, eye_m: Array, sky_cd_m2: Array, lights: Lights) -> Array:
    """Luminance of drops [cd/m²], shape (N, 3).

    A drop shows nearly the whole sky upside down (0.94 of it: Garg and Nayar 2006), and scatters lamps
    mostly ahead: three quarters by a Henyey–Greenstein lobe of g = 0.85, the rest evenly.

    Args:
        streaks: Drops.
        eye_m: Where one looks from [m].
        sky_cd_m2: Mean luminance of what is above, shape (3,).
        lights: Lamps; those out of reach are left out.
    """
    reach = np.sqrt(np.sum((lights.position_m - eye_m) ** 2, axis=1)) < lights.range_m + 6.0
    near = lights.take(np.flatnonzero(reach)[:MOST_LAMPS])
    shine = np.tile(0.94 * sky_cd_m2, (len(streaks), 1))
    light_drops(
        shine,
        streaks.end_m,
        near.position_m - eye_m,
        near.axis,
        near.left,
        cross(near.axis, near.left),
        near.colour_cd,
        near.edge,
        near.cap,
        near.range_m,
        near.beam,
    )
    return shine
