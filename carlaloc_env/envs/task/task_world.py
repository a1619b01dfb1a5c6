"""World of the task as views and the referee ask it, the same of a living and of a recorded one."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.routing.route import Route
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.stop_lines import StopLines


class CarState(Protocol):
    """State of the ego after a tick."""

    @property
    def position_m(self) -> Array:
        """Position of `base_link` in the world [m], shape (3,)."""

    @property
    def omega_body_radps(self) -> Array:
        """Body rate [rad/s], shape (3,)."""

    @property
    def speed_mps(self) -> float:
        """Forward speed of `base_link` [m/s], negative backwards."""

    @property
    def heading_rad(self) -> float:
        """Direction of the body's x axis, anticlockwise from east [rad]."""

    @property
    def road_wheel_rad(self) -> float:
        """Mean angle of the front wheels, left positive [rad]."""


class TaskWorld(Protocol):
    """A drive at its present step of 50 ms, which a `DrivingWorld` makes and an episode remembers."""

    @property
    def town(self) -> Town:
        """The town of the drive."""

    @property
    def route(self) -> Route:
        """The route that the ego shall follow."""

    @property
    def timeline(self) -> Timeline:
        """Ego, others and lights over time, for sensors."""

    @property
    def state(self) -> CarState:
        """The ego, one tick ahead of `now_ns`."""

    @property
    def now_ns(self) -> int:
        """Present time [ns]."""

    @property
    def route_s_m(self) -> float:
        """Distance of the ego along its route [m]; keeps growing on a closed route."""

    @property
    def route_offset_m(self) -> float:
        """Offset of the ego to the left of its route [m]."""

    @property
    def stop_lines(self) -> StopLines:
        """Stop lines of the route at which lights must be obeyed."""

    def signals(self) -> NDArray[np.uint8]:
        """State of every signal head of the town now (`SignalState`), shape (S,)."""

    def actors(self) -> ActorFrame:
        """All other road users at the last whole step."""
