"""Directions of beams that rotating wedges or a nodding mirror bend, each at its own time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary, elementary_kernels
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.lidar_patterns import FanPattern

_BEGUN_S = 60.0
"""Wedges have turned at most so long when a drive begins [s]."""


def pattern_directions(config: LidarConfig, seed: int, lines: Index, time_s: Array) -> Array:
    """Unit directions of the beams of a pattern in the sensor frame, column by column, shape (C·L, 3).

    Args:
        config: A LiDAR with a pattern.
        seed: Draws the phases of all that turns; they continue from sweep to sweep.
        lines: The L lines of a column in the order of firing, 0 = the first of `elevations_deg`.
        time_s: Time of each of C columns since the drive began [s]; its lines share the state of the optics.
    """
    pattern, directions = config.pattern, np.empty((len(time_s) * len(lines), 3))
    assert pattern is not None
    line_rad = np.radians(np.array(config.elevations_deg))[lines]
    if isinstance(pattern, FanPattern):
        phase = clock.stream(seed, f"{config.name}/optics").random(3)
        series = (pattern.elevation_deg, pattern.azimuth_deg, pattern.tall_deg, pattern.wide_deg)
        parts = tuple(np.radians(np.array(values)) for values in series)
        rates_hz = pattern.turns_hz, pattern.nods_hz
        _fan(line_rad / np.abs(line_rad).max(), time_s, rates_hz, phase, parts, directions)
        return directions
    begun_s = _BEGUN_S * clock.stream(seed, f"{config.name}/optics").random()
    phase = np.array(pattern.phase_deg) / 360.0 + begun_s * np.array(pattern.turns_hz)
    exits = np.array([face == "exit" for face in pattern.inclined])
    lean_rad = np.radians(np.array(pattern.wedge_deg))
    faces = np.stack([elementary.cos(lean_rad), elementary.sin(lean_rad)], axis=1)
    beams = np.stack([elementary.cos(line_rad), elementary.sin(line_rad)], axis=1)
    wedges = np.array(pattern.turns_hz), faces, exits, np.empty((3, len(beams)))
    _wedges(beams, time_s, wedges, phase, pattern.index, directions)
    return directions


@inlined
def _turn_rad(turns: float) -> float:
    """Angle of some turns in 0 to 2π, however many they are [rad]."""
    return 2.0 * math.pi * (turns - math.floor(turns))


@inlined
def _small(x: float) -> tuple[float, float]:
    """Sine and cosine of an angle up to 0.2 rad, to 1e-11, by their series [rad]."""
    z = x * x
    return x * (1.0 - z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0))), 1.0 - 0.5 * z * (
        1.0 - z / 12.0 * (1.0 - z / 30.0 * (1.0 - z / 56.0))
    )


@compiled
def _fan(
    share: Array,
    time_s: Array,
    rates_hz: tuple[float, float],
    phase: Array,
    series: tuple[Array, Array, Array, Array],
    out: Array,
) -> None:
    """Directions of a `FanPattern`, whose phases of turn, nod and azimuth are given in turns."""
    elevation, azimuth, tall, wide = series
    for column in range(len(time_s)):
        turn = _turn_rad(rates_hz[0] * time_s[column] + phase[0])
        nod = _turn_rad(rates_hz[1] * time_s[column] + phase[1])
        nod_sine, nod_cosine = elementary_kernels.sin_cos(nod)
        # Multiples of the nod by the sums of angles.
        e, a = elevation[0], _turn_rad(phase[2]) - turn
        sine, cosine = 0.0, 1.0
        for k in range(max(len(elevation) - 1, len(azimuth))):
            sine, cosine = sine * nod_cosine + cosine * nod_sine, cosine * nod_cosine - sine * nod_sine
            if k + 1 < len(elevation):
                e += elevation[k + 1] * cosine
            if k < len(azimuth):
                a += azimuth[k] * sine
        sine, cosine = elementary_kernels.sin_cos(turn)
        for _ in range(3):
            sine, cosine = sine * nod_cosine + cosine * nod_sine, cosine * nod_cosine - sine * nod_sine
        above, left = 0.0, 0.0
        for j in range(7):
            above, left = above + tall[j] * cosine, left + wide[j] * sine
            sine, cosine = sine * nod_cosine - cosine * nod_sine, cosine * nod_cosine + sine * nod_sine
        middle_up, middle_flat = elementary_kernels.sin_cos(e)
        middle_sine, middle_cosine = elementary_kernels.sin_cos(a)
        for line in range(len(share)):
            sine, cosine = _small(share[line] * above)
            up, flat = middle_up * cosine + middle_flat * sine, middle_flat * cosine - middle_up * sine
            sine, cosine = _small(share[line] * left / middle_flat)
            i = column * len(share) + line
            out[i, 0] = flat * (middle_cosine * cosine - middle_sine * sine)
            out[i, 1] = flat * (middle_sine * cosine + middle_cosine * sine)
            out[i, 2] = up


@compiled
def _wedges(
    beams: Array,
    time_s: Array,
    wedges: tuple[Array, Array, NDArray[np.bool_], Array],
    phase: Array,
    index: float,
    out: Array,
) -> None:
    """Directions of a `WedgePattern`: Snell's law at both faces of every wedge; phases are in turns."""
    turns_hz, faces, exits, beam = wedges
    lines = len(beams)
    for column in range(len(time_s)):
        for line in range(lines):
            beam[0, line], beam[1, line], beam[2, line] = beams[line, 0], 0.0, beams[line, 1]
        for k in range(len(turns_hz)):
            sine, cosine = elementary_kernels.sin_cos(_turn_rad(turns_hz[k] * time_s[column] + phase[k]))
            for face in range(2):
                nx, ny, nz = 1.0, 0.0, 0.0
                if exits[k] == (face == 1):
                    nx, ny, nz = faces[k, 0], faces[k, 1] * cosine, faces[k, 1] * sine
                ratio = 1.0 / index if face == 0 else index
                for line in range(lines):
                    x, y, z = beam[0, line], beam[1, line], beam[2, line]
                    along = nx * x + ny * y + nz * z
                    # Past the angle of total reflection the beam grazes the face.
                    bent = math.sqrt(max(1.0 - ratio * ratio * (1.0 - along * along), 0.0)) - ratio * along
                    beam[0, line], beam[1, line] = ratio * x + bent * nx, ratio * y + bent * ny
                    beam[2, line] = ratio * z + bent * nz
        for line in range(lines):
            for axis in range(3):
                out[column * lines + line, axis] = beam[axis, line]
