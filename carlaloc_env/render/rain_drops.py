"""Falling rain and snow: drops and flakes with places in the world, the same for every camera and moment.

Each size of them is a lattice of cells that falls as a whole with its terminal velocity and drifts with the
wind; a hash of the cell places the drops in it. So any picture can be made alone, both cameras see the same
drops, and they continue to fall in the next picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import cross
from carlaloc_env.render.drop_kernels import drops_in_cells, light_drops
from carlaloc_env.render.lighting.light_sources import Lights
from carlaloc_env.render.views import CameraView
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.snowfall import ALBEDO, fall_mps, flakes_per_m3

CELL_M = 1.0
"""Edge of the cells of the lattices of drops [m]."""
SIZES_MM = ((1.6, 0.5, 2.2), (2.1, 0.55, 3.2), (2.7, 0.7, 4.5), (3.5, 1.0, 6.5))
"""Diameter [mm], width of its class [mm] and distance up to which single drops are drawn [m].

Smaller and farther ones are thinner than half a pixel: they are the air's extinction.
"""
FLAKES_MM = ((1.5, 1.0, 3.0), (2.5, 1.0, 5.0), (3.5, 1.0, 7.0), (5.0, 2.0, 10.0), (8.0, 4.0, 15.0))
"""The same of flakes."""
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
    flakes: bool = False
    """Whether they are flakes of snow."""

    def __len__(self) -> int:
        return len(self.end_m)

    def take(self, which: NDArray[np.intp]) -> Streaks:
        """Some of the streaks."""
        end, begin, diameter = self.end_m[which], self.begin_m[which], self.diameter_m[which]
        return Streaks(end_m=end, begin_m=begin, diameter_m=diameter, flakes=self.flakes)

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


def streaks_before(
    view: CameraView,
    weather: WeatherParameters,
    *,
    stamp_ns: int,
    seed: int,
    velocity_mps: Array,
    exposure_time_s: float,
) -> Streaks:
    """All drops or flakes near a camera that show as streaks.

    Args:
        view: Camera at the end of the exposure.
        weather: Rain or snow, and wind.
        stamp_ns: End of the exposure [ns].
        seed: Seed of the drops.
        velocity_mps: Velocity of the camera in the world, shape (3,).
        exposure_time_s: Exposure time [s].
    """
    wind = weather.wind_mps
    flakes = weather.snowfall > 0.0
    key = int(clock.stream(seed, "render/snow" if flakes else "render/rain").integers(1 << 32))
    ends, falls, sizes = [], [], []
    for index, (diameter, width, reach) in enumerate(FLAKES_MM if flakes else SIZES_MM):
        if flakes:
            density, speed = flakes_per_m3(weather.snowfall, diameter, width), fall_mps(diameter)
        else:
            density, speed = drops_per_m3(weather.rain_mmph, diameter, width), terminal_mps(diameter)
        density *= CELL_M**3
        velocity = np.array([*wind[:2], -speed])
        drift = velocity * (stamp_ns * 1e-9)
        places = _lattice(view, drift, density, reach, key ^ (0x9E3779B9 * (index + 1) & 0xFFFFFFFF))
        ends.append(places)
        falls.append(np.broadcast_to(velocity, places.shape))
        sizes.append(np.full(len(places), diameter * 1e-3))
    end, size = np.concatenate(ends), np.concatenate(sizes)
    begin = end - (np.concatenate(falls) - velocity_mps) * exposure_time_s
    return Streaks(end_m=end, begin_m=begin, diameter_m=size, flakes=flakes)


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
    """Luminance of drops or flakes [cd/m²], shape (N, 3).

    A drop shows nearly the whole sky upside down (0.94 of it: Garg and Nayar 2006), and scatters lamps
    mostly ahead: three quarters by a Henyey–Greenstein lobe of g = 0.85, the rest evenly. A flake is a white
    diffuse ball, which throws lamps' light back.

    Args:
        streaks: Drops.
        eye_m: Where one looks from [m].
        sky_cd_m2: Mean luminance of what is above a drop, or all round a flake, shape (3,).
        lights: Lamps; those out of reach are left out.
    """
    reach = np.sqrt(np.sum((lights.position_m - eye_m) ** 2, axis=1)) < lights.range_m + 6.0
    near = lights.take(np.flatnonzero(reach)[:MOST_LAMPS])
    shine = np.tile((ALBEDO if streaks.flakes else 0.94) * sky_cd_m2, (len(streaks), 1))
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
        ALBEDO if streaks.flakes else 0.0,
    )
    return shine
