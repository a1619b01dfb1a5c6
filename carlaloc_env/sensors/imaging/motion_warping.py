"""Kernels: where a pixel comes from between two pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.sensors.imaging.motion_field import source_of

SAME_DEPTH = np.float32(0.10)
"""Depths that differ by less, as a ratio, are of the same surface."""
MISS_PX = np.float32(0.75)
"""A place that misses its pixel by more shows something else [px]."""
BOTH, FIRST, SECOND, NOWHERE = 0, 1, 2, 3
"""Which of two pictures show what a pixel sees in between."""
_ONE = np.float32(1)


@compiled
def sources(forward: Any, backward: Any, u: Any, v: Any, s: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Where a pixel at time s came from in both pictures, from guesses, and which of them shows it.

    Where they show different surfaces the nearer one hides the other. A guess that leads nowhere is
    followed by that of a surface which moves all over as it does at the pixel itself.
    """
    rest = _ONE - s
    ax, ay, a_depth, a_miss = source_of(forward, u, v, s, ax, ay)
    if a_miss >= MISS_PX:
        ax, ay, a_depth, a_miss = source_of(forward, u, v, s, u, v)
    bx, by, b_depth, b_miss = source_of(backward, u, v, rest, bx, by)
    if b_miss >= MISS_PX:
        bx, by, b_depth, b_miss = source_of(backward, u, v, rest, u, v)
    kind = BOTH
    if a_miss >= MISS_PX or b_miss >= MISS_PX:
        kind = FIRST if a_miss < MISS_PX else SECOND if b_miss < MISS_PX else NOWHERE
        if a_miss >= MISS_PX and is_within(forward, ax, ay):
            ax, ay = u, v
        if b_miss >= MISS_PX and is_within(backward, bx, by):
            bx, by = u, v
    elif abs(a_depth - b_depth) > SAME_DEPTH * min(a_depth, b_depth):
        kind = FIRST if a_depth < b_depth else SECOND
    return ax, ay, bx, by, kind


@compiled
def is_within(field: Any, x: Any, y: Any) -> bool:
    """Whether a place lies in the picture."""
    inside: bool = x >= 0 and y >= 0 and x <= field.shape[1] - 1 and y <= field.shape[0] - 1
    return inside
