"""Road spray: water that wheels throw up from a wet road, as LiDAR rays meet it."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.raycast import Cylinders, candidates, into_actor_frame
from carlaloc_env.sensors.actor_boxes import boxes_at
from carlaloc_env.timeline.timeline import Timeline

_HEIGHT_M = 1.8
"""Height of a plume of spray [m]."""
_LIFETIME_S = 0.5
"""How long spray hangs in the air [s]."""


def spray_density_per_m(wetness: float, speed_mps: Array) -> Array:
    """Extinction of the spray behind wheels [1/m]: grows with the square of the speed above 5 m/s.

    Ours, at the level of Walz et al., "A benchmark for spray from nearby cutting vehicles" (ITSC 2021):
    about half of the rays that cross the plume of a car at 25 m/s on a soaked road return from it.
    """
    push = np.clip((speed_mps - 5.0) / 20.0, 0.0, 1.5)
    result: Array = 0.25 * wetness * push * push
    return result


def spray_ranges(
    origins_m: Array,
    directions: Array | NDArray[np.float32],
    limit_m: NDArray[np.float32],
    stamp_ns: int,
    timeline: Timeline,
    *,
    wetness: float,
    uniform: Array,
) -> Array:
    """Range at which spray behind moving vehicles catches rays [m], inf where it does not, shape (N,).

    A plume is a box behind the vehicle, as long as it drives in half a second; within it rays are
    caught like light in fog, after an exponentially distributed distance.

    Args:
        origins_m: Where rays start [m], world, shape (N, 3).
        directions: Unit directions, world, shape (N, 3).
        limit_m: Length of each ray [m], shape (N,).
        stamp_ns: Time at which the plumes stand [ns].
        timeline: Where everything is.
        wetness: How wet the ground is, 0–1.
        uniform: Numbers of (0, 1], shape (N,).
    """
    caught = np.full(len(origins_m), np.inf)
    boxes = boxes_at(timeline, stamp_ns)
    if len(boxes) == 0 or wetness <= 0:
        return caught
    speed = np.sqrt(np.sum(boxes.velocity_mps * boxes.velocity_mps, axis=-1))
    density = spray_density_per_m(wetness, speed)
    wet = np.flatnonzero(density > 1e-3)
    if len(wet) == 0:
        return caught
    boxes, density = boxes.take(wet), density[wet]
    length = np.minimum(_LIFETIME_S * speed[wet], 14.0)
    half_width, half_height = 0.5 * boxes.size_m[:, 1] + 0.3, np.full(len(wet), 0.5 * _HEIGHT_M)
    half = np.stack([0.5 * length, half_width, half_height], axis=-1)
    back, up = -0.5 * boxes.size_m[:, 0] - half[:, 0], half[:, 2] - 0.5 * boxes.size_m[:, 2]
    local = np.stack([back, np.zeros(len(wet)), up], axis=-1)
    centre = boxes.to_world(np.arange(len(wet)), local)
    around = Cylinders(
        centre_m=centre, radius_m=np.hypot(half[:, 0], half[:, 1]), half_height_m=half[:, 2] + 0.5
    )
    rays, plume = candidates(origins_m, directions, limit_m, around)
    angles = boxes.heading_rad[plume], boxes.pitch_rad[plume], boxes.roll_rad[plume]
    inside = into_actor_frame(origins_m[rays] - centre[plume], directions[rays], *angles).astype(np.float64)
    start, along = inside[:, :3], inside[:, 3:]
    along = np.where(np.abs(along) < 1e-9, 1e-9, along)
    a, b = (-half[plume] - start) / along, (half[plume] - start) / along
    enter = np.maximum(np.minimum(a, b).max(axis=-1), 0.0)
    leave = np.minimum(np.maximum(a, b).min(axis=-1), limit_m[rays])
    distance = -elementary.log(uniform[rays]) / density[plume]
    hit = np.flatnonzero((leave > enter) & (distance < leave - enter))
    np.minimum.at(caught, rays[hit], enter[hit] + distance[hit])
    return caught
