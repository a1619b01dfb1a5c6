"""Falling rain: drops with places in the world, the same for every camera and every moment.

Each size of drops is a lattice of cells that falls as a whole with its terminal velocity and drifts
with the wind; a hash of the cell says where in it its drops are. So any picture can be made on its
own, both cameras see the same drops, and they go on falling in the next picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.render.lights import Lights
from carlaloc_env.render.projection import View
from carlaloc_env.weather import WeatherParameters

Array = NDArray[np.float64]
U32 = NDArray[np.uint32]

CELL_M = 1.0
SIZES_MM = ((1.6, 0.5, 3.0), (2.1, 0.55, 4.0), (2.7, 0.7, 5.5), (3.5, 1.0, 7.5))
"""Diameter [mm], width of its class [mm] and distance up to which single drops are drawn [m].

Smaller and farther ones are thinner than half a pixel: they are the air's extinction.
"""
NEAR_M = 0.35
"""Distance below which no drop is drawn [m]: the lens is wiped there."""
_AROUND_M = 0.4
"""Margin round the view for streaks that reach into it [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Streaks:
    """What N drops draw during an exposure, relative to the moving eye, world axes."""

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
        return Streaks(
            end_m=self.end_m[which], begin_m=self.begin_m[which], diameter_m=self.diameter_m[which]
        )

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
    view: View,
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
    key = np.uint32(rng.stream(seed, "render/rain").integers(1 << 32))
    ends, falls, sizes = [], [], []
    for index, (diameter, width, reach) in enumerate(SIZES_MM):
        density = drops_per_m3(weather.rain_mmph, diameter, width) * CELL_M**3
        velocity = np.array([*wind[:2], -terminal_mps(diameter)])
        drift = velocity * (stamp_ns * 1e-9)
        places = _lattice(view, drift, density, reach, key ^ np.uint32(0x9E3779B9 * (index + 1) & 0xFFFFFFFF))
        ends.append(places)
        falls.append(np.broadcast_to(velocity, places.shape))
        sizes.append(np.full(len(places), diameter * 1e-3))
    end = np.concatenate(ends)
    return Streaks(
        end_m=end,
        begin_m=end - (np.concatenate(falls) - velocity_mps) * exposure_time_s,
        diameter_m=np.concatenate(sizes),
    )


def _lattice(view: View, drift_m: Array, density: float, reach_m: float, key: np.uint32) -> Array:
    """Drops of one size inside a view [m from the eye], shape (N, 3)."""
    planes = view.planes()
    normals = np.concatenate([planes[:, :3], view.R_camera_world[2:], -view.R_camera_world[2:]])
    offsets = np.array([_AROUND_M] * 4 + [-NEAR_M, reach_m])
    sx, sy, ox, oy = view.clip_scale
    corners = np.array(
        [[(i - ox) / sx, (j - oy) / sy, 1.0] for i in (-1, 1) for j in (-1, 1)] + [[0.0, 0.0, 0.0]]
    )
    corners = np.sum((corners * reach_m)[:, :, None] * view.R_camera_world[None], axis=1)
    home = view.position_m - drift_m
    low = np.floor((home + corners.min(axis=0) - _AROUND_M) / CELL_M).astype(np.int64)
    high = np.floor((home + corners.max(axis=0) + _AROUND_M) / CELL_M).astype(np.int64)
    axes = [np.arange(a, b + 1) for a, b in zip(low, high, strict=True)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    middle = (cells + 0.5) * CELL_M - home
    gap = np.sum(middle[:, None, :] * normals[None], axis=2) + offsets
    cells = cells[(gap > -0.87 * CELL_M).all(axis=1)]
    most = math.ceil(density)
    if most == 0 or not len(cells):
        return np.zeros((0, 3))
    h = _mixed(
        _mixed(_mixed(cells[:, 0].astype(np.uint32) ^ key) ^ cells[:, 1].astype(np.uint32))
        ^ cells[:, 2].astype(np.uint32)
    )
    lot = _mixed(h[:, None] + np.arange(most, dtype=np.uint32) * np.uint32(0x9E3779B9)).reshape(-1)
    there = lot < np.uint32(min(density / most, 1.0) * (2**32 - 1))
    lot, cell = lot[there], np.repeat(cells, most, axis=0)[there]
    within = []
    for _ in range(3):
        lot = _mixed(lot + np.uint32(0x85EBCA6B))
        within.append(lot * 2.0**-32)
    places = (cell + np.stack(within, axis=-1)) * CELL_M - home
    gap = np.sum(places[:, None, :] * normals[None], axis=2) + offsets
    return np.asarray(places[(gap > 0.0).all(axis=1)])


def _mixed(x: U32) -> U32:
    x = x ^ (x >> np.uint32(16))
    x = x * np.uint32(0x7FEB352D)
    x = x ^ (x >> np.uint32(15))
    x = x * np.uint32(0x846CA68B)
    return np.asarray(x ^ (x >> np.uint32(16)), dtype=np.uint32)


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
    shine = np.tile(0.94 * sky_cd_m2, (len(streaks), 1))
    reach = np.sqrt(np.sum((lights.position_m - eye_m) ** 2, axis=1)) < lights.range_m + 6.0
    to_eye = -streaks.end_m / np.sqrt(np.sum(streaks.end_m**2, axis=1))[:, None]
    for k in np.flatnonzero(reach)[:16]:
        way = streaks.end_m + (eye_m - lights.position_m[k])
        r2 = np.maximum(np.sum(way**2, axis=1), 0.25)
        way = way / np.sqrt(r2)[:, None]
        turn = np.sum(way * to_eye, axis=1)
        lobe = (1.0 - 0.85**2) / (1.0 + 0.85**2 - 1.7 * turn) ** 1.5
        phase = (0.75 * lobe + 0.25) / (4.0 * math.pi)
        fade = np.maximum(1.0 - (r2 / lights.range_m[k] ** 2) ** 2, 0.0) ** 2
        cosine = np.sum(way * lights.axis[k], axis=1)
        if lights.beam[k]:
            up = np.cross(lights.axis[k], lights.left[k])
            gain = _low_beam(cosine, np.sum(way * lights.left[k], axis=1), np.sum(way * up, axis=1))
        else:
            low, high = lights.edge[k]
            x = np.clip((cosine - low) / (high - low), 0.0, 1.0)
            gain = (
                np.minimum(1.0 / (np.maximum(cosine, 0.0) ** 3 + 1e-3), lights.cap[k]) * x * x * (3 - 2 * x)
            )
        shine += (gain * phase * fade / r2)[:, None] * lights.colour_cd[k]
    return shine


def _low_beam(ahead: Array, left: Array, up: Array) -> Array:
    """Intensity [cd] as in ``shade.frag``."""
    x = np.maximum(ahead, 0.05)
    h, v = -57.29578 * left / x, 57.29578 * up / x
    below = 1.0 / (1.0 + np.exp(np.minimum(9.0 * (v + 0.57), 60.0)))
    wide = 8000.0 * np.exp(-0.5 * ((h / 9.0) ** 2 + ((v + 1.8) / 1.8) ** 2))
    floor = 4200.0 * np.exp(-0.5 * ((h / 20.0) ** 2 + ((v + 4.5) / 3.5) ** 2))
    narrow = 26000.0 * np.exp(-0.5 * (((h - 1.5) / 2.3) ** 2 + ((v + 1.0) / 0.9) ** 2))
    return np.where(ahead > 0.05, below * (wide + floor + narrow) + 180.0, 0.0)
