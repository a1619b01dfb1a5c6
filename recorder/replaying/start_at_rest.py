"""Finds stretches that begin in motion, a false start for SLAM systems, and the nearest instant at rest."""

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.timeline.timeline import Timeline

REST_MPS = 0.05
"""A car that is slower stands [m/s]."""


def motion_at_start(at_s: Array, speed_mps: Array, start_s: float) -> str:
    """Line on a stretch that begins in motion; empty: it begins at rest.

    Args:
        at_s: Times of the drive [s], shape (N,), ascending.
        speed_mps: Speeds then [m/s], shape (N,).
        start_s: Beginning of the stretch [s].
    """
    first = float(np.interp(start_s, at_s, speed_mps))
    if first < REST_MPS:
        return ""
    rest_s = at_s[speed_mps < REST_MPS]
    line = f"begins at {first:.1f} m/s, a false start for systems that assume rest"
    if not len(rest_s):
        return f"{line}; the car stands nowhere in it"
    nearest_s = rest_s[np.argmin(np.abs(rest_s - start_s))]
    return f"{line}; the nearest instant at rest is --start {nearest_s:g}"


def motion_at_start_of(timeline: Timeline, start_s: float) -> str:
    """The same line for a stretch of a drive."""
    at_ns = np.arange(0, timeline.end_ns, STEP_NS)
    speed_mps = np.linalg.norm(timeline.ego_motion(at_ns).velocity_world_mps, axis=1)
    return motion_at_start(at_ns / 1e9, speed_mps, start_s)
