"""A car of a living town: its body, its route and its timeline, as its driver, sensors and referee see it."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from carlaloc_env.core.clock import STEP_TICKS, TICK_S, stamp_ns
from carlaloc_env.core.ego import EGO_CENTRE_M, Controls
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.driving.on_route import OnRoute
from carlaloc_env.driving.road_ahead import RoadAhead
from carlaloc_env.map.routing.route import Route
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoCar, EgoState, EgoTick
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.vehicles.ego_agent import EgoView

if TYPE_CHECKING:
    from carlaloc_env.core.array_types import Array

GONE = EgoView(position_m=(1e6, 1e6, 0.0), heading_rad=0.0, speed_mps=0.0)
"""A car that has left the drive, as other road users see it."""


class DrivenCar(OnRoute):
    """One of the cars in a `DrivingWorld`, which moves it.

    Args:
        town: Where it drives.
        body: Its physics.
        route: Where it shall go.
    """

    def __init__(self, town: Town, body: EgoCar, route: Route) -> None:
        self.town, self.body, self.route = town, body, route
        self.gone = False
        """Whether it has left the drive."""
        self.contacts: list[Contact] = []
        """What it touched in the last tick."""
        self._state: EgoState | None = None
        self._tick = 0

    def begin(self, timeline: Timeline) -> None:
        """Begin a drive where the body stands now."""
        self.timeline = timeline
        self._road = RoadAhead(self.town.network, self.route)
        self._speeds: deque[float] = deque([self.state.speed_mps], maxlen=STEP_TICKS + 1)

    def forget(self) -> None:
        """Begin time at 0, at a new place of the body."""
        self._tick, self.gone, self._state, self.contacts = 0, False, None, []

    def start_route(self) -> None:
        """Find the place on the route where it begins."""
        self._road.start(self.state.position_m)

    def record(self, controls: Controls) -> EgoTick:
        """Append the state now, and the controls that led to it, to the timeline."""
        return self.body.follow(self.timeline.ego, self.timeline.car, controls)

    def read(self) -> None:
        """Take over what a tick of the world has done to the body."""
        self.body.read()
        self._tick += 1
        self._state = None
        self._speeds.append(self.body.speed_mps)

    def follow_route(self) -> None:
        """Take note of where on its route it is."""
        self._road.follow(self.state.position_m)

    @property
    def state(self) -> EgoState:
        """State after the last tick."""
        if self._state is None:
            self._state = self.body.state()
        return self._state

    @property
    def now_ns(self) -> int:
        """Present time [ns]."""
        return stamp_ns(self._tick - 1)

    def driver_view(self) -> DriverView:
        """The driver's view now."""
        return self._road.view(
            tick=self._tick - 1,
            state=self.state,
            acceleration_mps2=(self._speeds[-1] - self._speeds[0]) / (max(len(self._speeds) - 1, 1) * TICK_S),
            actors=self.actors(),
            catalog=self.timeline.catalog,
            signals=self.signals(),
        )

    def as_seen(self) -> EgoView:
        """The car as other road users see it."""
        return (
            GONE
            if self.gone
            else ego_view(self.state.position_m, self.state.heading_rad, self.state.speed_mps)
        )


def ego_view(position_m: Array, heading_rad: float, speed_mps: float) -> EgoView:
    """A car as other road users see it.

    Args:
        position_m: Position of `base_link` [m], world (3,).
        heading_rad: Direction of the car [rad].
        speed_mps: Forward speed [m/s].
    """
    x, y, z = (float(value) for value in position_m)
    north, east = sin_cos(heading_rad)
    return EgoView(
        position_m=(x + EGO_CENTRE_M * east, y + EGO_CENTRE_M * north, z),
        heading_rad=heading_rad,
        speed_mps=speed_mps,
    )
