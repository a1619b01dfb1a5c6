"""Rate of range of LiDAR points, as frequency-modulated LiDARs measure it by the Doppler shift."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.timeline.timeline import Timeline


def range_rates(
    directions: F32,
    points_m: Array,
    instance: NDArray[np.uint32],
    stamps_ns: NDArray[np.int64],
    sensor_mps: Array,
    timeline: Timeline,
) -> Array:
    """Rate of the range of N points at their own times [m/s], positive = moving away, shape (N,).

    It is d·(v_point − v_sensor) with the unit direction d. Between 50 ms steps road users move straight and
    turn evenly about the vertical, as rays meet them. The car's own body has 0.

    Args:
        directions: Unit directions of the rays, world, shape (N, 3).
        points_m: What they meet, world [m], shape (N, 3).
        instance: Instance id of that, shape (N,).
        stamps_ns: Time of each ray [ns], shape (N,).
        sensor_mps: Velocity of the sensor then, world axes [m/s], shape (N, 3).
        timeline: Where everything is.
    """
    velocity_mps, ids = -sensor_mps, timeline.catalog.id
    order = np.argsort(ids)
    place = np.searchsorted(ids, instance, sorter=order)
    rows = np.flatnonzero(place < len(ids))
    actors = order[place[rows]]
    rows, actors = rows[ids[actors] == instance[rows]], actors[ids[actors] == instance[rows]]
    if len(rows):
        now_ns = stamps_ns[rows]
        begin_ns = np.maximum(now_ns - 1, 0) // STEP_NS * STEP_NS
        poses = (timeline.actor_poses(actors, at_ns) for at_ns in (now_ns, begin_ns, begin_ns + STEP_NS))
        (position, *_), (before, heading_before, *_), (after, heading_after, *_) = poses
        rate = wrap_angle(heading_after - heading_before)
        arm = points_m[rows] - position
        turning = np.stack([-rate * arm[:, 1], rate * arm[:, 0], np.zeros(len(rows))], axis=-1)
        velocity_mps[rows] += (after - before + turning) / (1e-9 * STEP_NS)
    rates = np.sum(directions.astype(np.float64) * velocity_mps, axis=1)
    rates[instance == EGO_INSTANCE] = 0.0
    return np.asarray(rates)
