"""Events of falling snow: a flake that passes before a pixel makes it brighter or darker, and then as it was.

The memory of pixels stays as it was, too: a flake's events take each other back. Raindrops, which are lenses
and show what lies behind them, fire none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import F32, I32, U32, Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.sensors.event_camera.pixels import Thresholds
from carlaloc_env.sensors.event_camera.read_out import by_time
from carlaloc_env.sensors.imaging.frame import Optics
from carlaloc_env.sensors.imaging.frame_motion import FrameGeometry

NEAR_M = 0.35
"""Depth from which flakes are seen [m]; the lens is wiped."""
ROOM = 1 << 16
"""Events that there is room for at first."""


class Flakes(NamedTuple):
    """Flakes before a camera over a span of time."""

    begin_m: Array
    """Where they were at its beginning, in world axes about where the eye was then [m], shape (N, 3)."""
    end_m: Array
    """The same at its end, shape (N, 3)."""
    diameter_m: Array
    """Shape (N,)."""
    light_cd_m2: Array
    """Their luminance, linear BT.709, shape (N, 3)."""


def flake_events(
    flakes: Flakes,
    ends: tuple[FrameGeometry, FrameGeometry],
    log_intensity: F32,
    thresholds: Thresholds,
    optics: Optics,
    *,
    dark_cd_m2: float,
    start_ns: int,
    span_us: int,
    refractory_us: int,
) -> NDArray[np.void]:
    """`EVENT` rows of flakes, by time.

    Args:
        flakes: Those between the two pictures.
        ends: Geometry of both pictures.
        log_intensity: Of the second, shape (H, W).
        thresholds: Contrast thresholds.
        optics: Intrinsics and lens.
        dark_cd_m2: Luminance whose photocurrent equals the dark current [cd/m²].
        start_ns: Time of the first picture [ns].
        span_us: Time between them [µs].
        refractory_us: Shortest time between two events of a pixel [µs].
    """
    places = [
        # Written out without BLAS, so that places have the same bits on every machine.
        np.sum(at_m[:, :, None] * geometry.poses.T_world_camera[None, :3, :3], axis=1)
        for at_m, geometry in zip((flakes.begin_m, flakes.end_m), ends, strict=True)
    ]
    before = np.flatnonzero((places[0][:, 2] > NEAR_M) & (places[1][:, 2] > NEAR_M))
    begin, end = (_seen(place[before], optics) for place in places)
    weights = np.array([0.2126, 0.7152, 0.0722])
    shine = np.sum(flakes.light_cd_m2[before] * weights, axis=1) + dark_cd_m2
    size_px = optics.pinhole.fx_px * flakes.diameter_m[before]
    lit, rise = elementary.exp(log_intensity), elementary.exp(thresholds.on)
    pixels = lit, ends[1].depth_m, rise, elementary.exp(thresholds.off), thresholds.on, thresholds.off
    room = ROOM
    while True:
        t_us, code = np.empty(room, np.int32), np.empty(room, np.uint32)
        count = _pass(begin, end, size_px, shine, *pixels, span_us, refractory_us, t_us, code)
        if count <= room:
            return by_time([t_us[:count]], [code[:count]], start_ns, span_us)
        room = count


def _seen(place_m: Array, optics: Optics) -> Array:
    """Column, row [px] and depth [m] of places in the optical frame, shape (N, 3)."""
    depth_m, c = place_m[:, 2], optics.pinhole
    x, y = optics.lens.distort(place_m[:, 0] / depth_m, place_m[:, 1] / depth_m)
    return np.stack([c.fx_px * x + c.cx_px, c.fy_px * y + c.cy_px, depth_m], axis=1)


@compiled
def _pass(
    begins: Array,
    ends: Array,
    sizes: Array,
    shines: Array,
    lit: F32,
    depth_m: F32,
    up: F32,
    down: F32,
    on: F32,
    off: F32,
    span_us: int,
    refractory_us: int,
    t_us: I32,
    code: U32,
) -> int:
    """Events of all flakes along their paths; the number of them, those without room included."""
    height, width = lit.shape
    count = 0
    for n in range(len(begins)):
        u0, v0, z0 = begins[n, 0], begins[n, 1], begins[n, 2]
        du, dv, z1 = ends[n, 0] - u0, ends[n, 1] - v0, ends[n, 2]
        length = np.sqrt(du * du + dv * dv)
        if length < 0.1:
            continue
        reach = 0.5 * max(sizes[n] / min(z0, z1), 1.0)
        for y in range(
            max(int(np.ceil(min(v0, v0 + dv) - reach)), 0),
            min(int(max(v0, v0 + dv) + reach), height - 1) + 1,
        ):
            low, high = _columns(u0, v0, du, dv, length, reach, y)
            for x in range(max(int(np.ceil(low)), 0), min(int(high), width - 1) + 1):
                along = ((x - u0) * du + (y - v0) * dv) / length
                aside = abs((x - u0) * dv - (y - v0) * du) / length
                share = min(max(along / length, 0.0), 1.0)
                z = 1.0 / ((1.0 - share) / z0 + share / z1)
                wide = sizes[n] / z
                if aside > 0.5 * max(wide, 1.0) or 0.0 < depth_m[y, x] < z:
                    continue
                half = 0.5 * np.sqrt(max(max(wide, 1.0) ** 2 - 4.0 * aside * aside, 0.25))
                enters = _time(along - half, length, z0, z1) * span_us
                leaves = _time(along + half, length, z0, z1) * span_us
                hidden = min(0.25 * np.pi * wide * wide, 1.0)
                ratio = (1.0 - hidden) + hidden * shines[n] / lit[y, x]
                brighter = ratio > 1.0
                step, back = (on[y, x], off[y, x]) if brighter else (off[y, x], on[y, x])
                factor = up[y, x] if brighter else down[y, x]
                ratio = ratio if brighter else 1.0 / ratio
                most = 1 + int((leaves - enters) / max(refractory_us, 1))
                fired = 0
                while fired < most and ratio >= factor:
                    ratio /= factor
                    fired += 1
                taken = int(fired * step / back + 0.5)
                leaves = max(leaves, enters + fired * refractory_us)
                for k in range(fired + taken):
                    first = k < fired
                    t = enters + k * refractory_us if first else leaves + (k - fired) * refractory_us
                    # What lies beyond the span belongs to the next one, or to the last.
                    if t <= 0.0 or t > span_us:
                        continue
                    if count < len(t_us):
                        t_us[count] = min(int(np.ceil(t)), span_us)
                        code[count] = y << 17 | x << 1 | (brighter == first)
                    count += 1
    return count


@compiled
def _columns(
    u0: float, v0: float, du: float, dv: float, length: float, reach: float, y: int
) -> tuple[float, float]:
    """First and last column of a row that a path's band crosses [px]."""
    low, high = min(u0, u0 + du) - reach, max(u0, u0 + du) + reach
    if abs(dv) > 0.02 * length:
        middle, wide = u0 + (y - v0) * du / dv, reach * length / abs(dv)
        low, high = max(low, middle - wide), min(high, middle + wide)
    return low, high


@compiled
def _time(along: float, length: float, z0: float, z1: float) -> float:
    """Share of the span after which something that moves evenly in space is there on its path."""
    share = along / length
    return share * z0 / max(z1 - share * (z1 - z0), 1e-6)
