"""Lights of a night, street lamps among them, and laws of their intensity over angle and distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.parallel_arrays import ParallelArrays

LAMP_CD = 260.0
"""Intensity of a street lamp straight down [cd]: 3 klm in a full cut-off beam, an old dim street."""
LAMP_COLOUR = np.array([1.28, 0.97, 0.50])
"""Linear colour of unit luminance, about 3000 K."""
LAMP_LEAST_M = 0.5
"""Light of a lamp grows no more nearer to it than this [m]."""
LAMP_RANGE_M = 30.0
"""Where a street lamp gives less than 0.1 lx [m]."""
MOST_LIGHTS = 256
"""Lights of a picture, the nearest ones."""
MOST_BEAMS = 9
"""Cars whose low beams are followed, the nearest ones."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lights(ParallelArrays):
    """Lamps in the world, parallel arrays of N."""

    position_m: Array
    """Shape (N, 3)."""
    axis: Array
    """Unit direction of the middle of the beam, shape (N, 3)."""
    left: Array
    """Unit direction to the left of a headlamp, shape (N, 3)."""
    colour_cd: Array
    """Intensity along the axis, linear BT.709, shape (N, 3); of a headlamp a factor of its beam."""
    cap: Array
    """Most that the beam gains on its axis towards its edge (batwing), shape (N,)."""
    edge: Array
    """Cosines to the axis between which the beam ends, shape (N, 2)."""
    range_m: Array
    """Distance at which the light has faded to nothing [m], shape (N,)."""
    glow_cd: Array
    """Intensity that lights the air round it [cd], shape (N,)."""
    beam: NDArray[np.bool_]
    """Whether it is a pair of low beams, shape (N,)."""

    def __len__(self) -> int:
        return len(self.position_m)


def street_lamps(lamps_m: Array) -> Lights:
    """Full cut-off luminaires that look straight down, at places in the world (K, 3) [m]."""
    count = len(lamps_m)
    return Lights(
        position_m=lamps_m,
        axis=np.tile([0.0, 0.0, -1.0], (count, 1)),
        left=np.tile([0.0, 1.0, 0.0], (count, 1)),
        colour_cd=np.tile(LAMP_CD * LAMP_COLOUR, (count, 1)),
        cap=np.full(count, 3.5),
        edge=np.tile([0.17, 0.47], (count, 1)),
        range_m=np.full(count, LAMP_RANGE_M),
        glow_cd=np.full(count, LAMP_CD),
        beam=np.zeros(count, bool),
    )


def batwing_gain(ahead: Any, begin: Any, full: Any, cap: Any) -> Any:
    """Intensity of a lamp that is no low beam, as a factor of its `colour_cd`; numbers or arrays.

    A full cut-off luminaire lights the road evenly. The shaders have the same formula in `shade.frag`.

    Args:
        ahead: Cosine of the direction to the axis.
        begin: Cosine at which the light begins.
        full: Cosine from which on there is all of it.
        cap: Most that it gains.
    """
    t = np.minimum(np.maximum((ahead - begin) / (full - begin), 0.0), 1.0)
    above = np.maximum(ahead, 0.0)
    return np.minimum(1.0 / (above * above * above + 1e-3), cap) * t * t * (3.0 - 2.0 * t)


def range_window(ratio2: Any) -> Any:
    """Factor that fades a light out at its range, by the squared ratio of distance and range."""
    left = np.maximum(1.0 - ratio2 * ratio2, 0.0)
    return left * left


def nearest(lights: Lights, eye_m: Array) -> Lights:
    """The lights that matter most to an eye, the nearest first; of low beams the nearest few."""
    gap = np.sqrt(np.sum((lights.position_m - eye_m) ** 2, axis=1)) - lights.range_m
    order = np.argsort(gap, kind="stable")
    extra = lights.beam[order] & (np.cumsum(lights.beam[order]) > MOST_BEAMS)
    return lights.take(order[~extra][:MOST_LIGHTS])


NO_LIGHTS = street_lamps(np.zeros((0, 3)))
"""None at all."""
