"""Those who walk, and the vehicles as they see them."""

from __future__ import annotations

from typing import Annotated

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.traffic.tables.record_arrays import Flags

STEP_S = STEP_NS / 1e9
RADIUS_M = 0.3
"""Half the width of a walker [m]."""


class Walking:
    """State of all walkers, W rows."""

    way: Index
    """Footway."""
    station_m: Array
    """Station on it [m]."""
    sense: Index
    """1 towards its end, −1 towards its start."""
    side_m: Array
    """How far right of the middle it likes to walk [m]."""
    position_m: Annotated[Array, 3]
    """World [m]."""
    velocity_mps: Annotated[Array, 2]
    """World [m/s]."""
    direction: Annotated[Array, 2]
    """Cosine and sine of where it looks."""
    pace_mps: Array
    """Speed it likes to walk at [m/s]."""
    travelled_m: Array
    """Distance walked [m]."""
    waited_s: Array
    """How long it has waited at the kerb or for somebody in the way [s]."""
    crossing: Flags
    """Whether it has set out over the road."""
    draws: Index
    """Decisions taken."""


class Boxes:
    """Vehicles as walkers see them, and the ego in the last row."""

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
