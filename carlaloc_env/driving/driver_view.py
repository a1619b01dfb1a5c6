"""View of a driver at one tick: the knowledge of the world that an input device may use."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.map.routing.route import Route


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriverView:
    """View from the driver's seat; a human's device ignores most of it."""

    tick: int
    """Ticks since the drive began."""
    position_m: NDArray[np.float64]
    """Position of `base_link` in the world [m], shape (3,)."""
    heading_rad: float
    """Direction of the car, anticlockwise from east [rad]."""
    speed_mps: float
    """Forward speed [m/s]."""
    acceleration_mps2: float
    """Forward acceleration [m/s²]."""
    route: Route
    """Where to go."""
    route_s_m: float
    """How far along the route `base_link` is [m]; keeps growing on a closed route."""
    offset_m: float
    """How far left of the route `base_link` is [m]."""
    speed_limit_mps: float
    """Speed limit here [m/s]."""
    stop_line_distance_m: float | None = None
    """From the front bumper to the next stop line with a light [m], None when none is in sight."""
    signal_state: int = 0
    """`SignalState` of that light."""
    leader_gap_m: float | None = None
    """From the front bumper to the rear of the vehicle ahead [m], None without one."""
    leader_speed_mps: float = 0.0
    """Speed of that vehicle along the route [m/s]."""
