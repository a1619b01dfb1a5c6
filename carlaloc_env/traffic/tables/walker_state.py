"""State of walkers, and the vehicles as walkers see them: records of compiled functions."""

from typing import Annotated

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.traffic.tables.record_arrays import Flags

RADIUS_M = 0.3
"""Half the width of a walker [m]."""


class WalkerState:
    """State of all walkers, W rows."""

    path: Index
    """Number of the path."""
    station_m: Array
    """Station on it [m]."""
    path_direction: Index
    """1 towards its end, −1 towards its start."""
    side_m: Array
    """Distance from the path's middle at which it likes to walk, on the `own_side` of the path [m]."""
    position_m: Annotated[Array, 3]
    """Position of the feet, world [m], (W, 3)."""
    velocity_mps: Annotated[Array, 2]
    """Velocity, world [m/s], (W, 2)."""
    direction: Annotated[Array, 2]
    """Cosine and sine of its heading."""
    pace_mps: Array
    """Speed it likes to walk at [m/s]."""
    travelled_m: Array
    """Distance walked [m]."""
    waited_s: Array
    """Time for which it has waited, at the kerb or for another in its path [s]."""
    crossing: Flags
    """Whether it has set out over the road."""
    draws: Index
    """Number of decisions taken."""


class VehicleBoxes:
    """Boxes of N vehicles as walkers see them, then of the egos, (N + C,)."""

    position_m: Annotated[Array, 2]
    """Centre [m]."""
    direction: Annotated[Array, 2]
    """Cosine and sine of the heading."""
    half_m: Annotated[Array, 2]
    """Half length and half width [m]."""
    speed_mps: Array
    """Speed [m/s]."""
    height_m: Array
    """Height above the sea [m]."""
    is_ego: Flags
    """Whether it is driven from elsewhere."""
