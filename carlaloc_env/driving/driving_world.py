"""The living town: physics, traffic and signals advance together and fill a Timeline.

Physics runs one tick ahead of `now`, because the ego's spline needs the tick after the one asked
for; traffic runs one step ahead, because actors are interpolated between steps.
"""

from collections import deque
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_NS, STEP_TICKS, TICK_S, stamp_ns
from carlaloc_env.core.ego import DEFAULT_RIDE, EGO_REAR_M, EGO_SIZE_M, Controls
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.driving.road_ahead import RoadAhead
from carlaloc_env.map.routing.route import Route
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoCar, EgoState, EgoTick
from carlaloc_env.physics.params import ride_by_name
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.road.rough_surface import STANDARD_WAVINESS
from carlaloc_env.timeline.actor_quantisation import on_grid
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town, without_movables
from carlaloc_env.traffic.standing_traffic import kept_tables
from carlaloc_env.traffic.stop_lines import StopLines
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.world import TrafficWorld

_PARKED = Controls(brake=1.0)
"""Controls of a standing car."""


class DriveListener(Protocol):
    """Listener to every tick of a drive, e.g. the writer of an episode."""

    def on_start(self, catalog: ActorCatalog) -> None:
        """A drive begins with these actors."""

    def on_tick(self, tick: int, state: EgoTick, controls: Controls) -> None:
        """The ego's state at a tick, and the controls that led there."""

    def on_step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        """Actors and signals of a 50 ms step."""

    def on_contact(self, tick: int, contact: Contact) -> None:
        """The ego touched something."""


class DrivingWorld:
    """One town with the ego, other road users and signals, advanced by 200 Hz ticks."""

    def __init__(
        self, town: Town, traffic: TrafficConfig, *, friction: float = 1.0, ride: str = DEFAULT_RIDE
    ) -> None:
        chosen, roughness = ride_by_name(ride), town.roughness
        if roughness is not None and chosen.waviness != STANDARD_WAVINESS:
            roughness = roughness.of_waviness(chosen.waviness)
        if town.route is None:
            raise ConfigError(f"town '{town.name}' has no route; add [route] points to its town.toml")
        self.town = town if traffic.parked_cars else without_movables(town)
        self.route: Route = town.route
        self.traffic_config = traffic
        self._tables = kept_tables(town)
        self._physics = PhysicsWorld(
            self.town.outline.collision_vertices_m,
            self.town.outline.collision_triangles,
            friction=friction,
            roughness=roughness,
        )
        self._ego = EgoCar(self._physics, chosen.vehicle)
        self.listener: DriveListener | None = None
        """Called at every tick and step."""
        self._state: EgoState | None = None

    def reset(
        self,
        seed: int | None = None,
        listener: DriveListener | None = None,
        *,
        route: Route | None = None,
        traffic: TrafficConfig | None = None,
    ) -> None:
        """Stand the ego at the start of the route, let traffic run in, and begin time at 0.

        Args:
            seed: New seed of the traffic; the last one when left out.
            listener: Called at every tick and step from now on.
            route: Route of the ego from now on; the last one when left out.
            traffic: Traffic from now on, with cars parked as before; the last one when left out.

        Raises:
            ConfigError: cars would be parked that are not there, or the other way round.
        """
        if traffic is not None:
            if traffic.parked_cars != self.traffic_config.parked_cars:
                raise ConfigError("parked cars are part of the town; make a new world for them")
            self.traffic_config = traffic
        if seed is not None:
            self.traffic_config = replace(self.traffic_config, seed=seed)
        self.route = route if route is not None else self.route
        self.listener = listener
        start = self.route.at(0.0)
        self._ego.reset(start.position_m[0], float(start.heading_rad[0]))
        self._traffic = TrafficWorld(self.town.network, self.traffic_config, self._tables)
        self.timeline = Timeline(self._traffic.catalog)
        self._state = None
        # Before the listener is called: traffic that does not fit is refused here.
        first = self._traffic.reset(self._ego_view())
        if listener is not None:
            listener.on_start(self._traffic.catalog)
        self._road = RoadAhead(self.town.network, self.route)
        self._tick = 0
        self._step = 0
        self._speeds: deque[float] = deque([self.state.speed_mps], maxlen=STEP_TICKS + 1)
        self._follow(_PARKED)
        self._add_step(first)
        self._add_step(self._traffic.step(self._ego_view()))
        self.tick(_PARKED)
        self._road.start(self.state.position_m)

    @property
    def state(self) -> EgoState:
        """State of the ego after the last tick."""
        if self._state is None:
            self._state = self._ego.state()
        return self._state

    @property
    def now_ns(self) -> int:
        """Present time [ns]: everything up to it is known for certain."""
        return stamp_ns(self._tick - 1)

    @property
    def tick_count(self) -> int:
        """Ticks since the drive began."""
        return self._tick - 1

    @property
    def route_s_m(self) -> float:
        """Distance of the ego along its route [m]; keeps growing on a closed route."""
        return self._road.progress_m

    @property
    def route_offset_m(self) -> float:
        """Offset of the ego to the left of its route [m]."""
        return self._road.offset_m

    def tick(self, controls: Controls) -> list[Contact]:
        """Advance by 5 ms under the given controls and return the ego's contacts.

        Raises:
            ActionError: a control is not finite or out of range; nothing has moved then.
        """
        if self._tick % STEP_TICKS == 1:
            # The step after the last has just become known.
            last = self._tick // STEP_TICKS * STEP_NS
            frames = self.timeline.actors_at(last), self.timeline.actors_at(last + STEP_NS)
            self._physics.set_actors(frames[0], self.timeline.catalog, frames[1], ticks=1)
        self._ego.tick(controls)
        self._tick += 1
        self._state = None
        self._speeds.append(self._ego.speed_mps)
        self._follow(controls)
        contacts = self._physics.contacts()
        if self.listener is not None:
            for contact in contacts:
                self.listener.on_contact(self._tick, contact)
        if (self._tick - 1) % STEP_TICKS == 0 and self._tick > 1:
            self._add_step(self._traffic.step(self._ego_view()))
            self._road.follow(self.state.position_m)
        return contacts

    @property
    def stop_lines(self) -> StopLines:
        """Stop lines of the route at which lights must be obeyed."""
        return self._road.stop_lines

    def signals(self) -> NDArray[np.uint8]:
        """State of every signal head of the town now (`SignalState`), shape (S,)."""
        return self.timeline.signals_at(self.now_ns)

    def actors(self) -> ActorFrame:
        """All other road users at the last whole step."""
        return self.timeline.actors_at(self.now_ns // STEP_NS * STEP_NS)

    def driver_view(self) -> DriverView:
        """The driver's view now."""
        tick = self._tick - 1
        return self._road.view(
            tick=tick,
            state=self.state,
            acceleration_mps2=(self._speeds[-1] - self._speeds[0]) / (max(len(self._speeds) - 1, 1) * TICK_S),
            actors=self.timeline.actors_at(tick // STEP_TICKS * STEP_NS),
            catalog=self.timeline.catalog,
            signals=self.timeline.signals_at(stamp_ns(tick)),
        )

    def forget_before(self, time_ns: int) -> None:
        """Drop the past of the Timeline, for runs that keep no record."""
        self.timeline.forget_before(time_ns)

    def set_friction(self, factor: float) -> None:
        """Grip of the road, 1 = dry."""
        self._physics.set_friction(factor)

    def close(self) -> None:
        """End the physics."""
        self._physics.close()

    def _add_step(self, frame: ActorFrame) -> None:
        frame, signals = on_grid(frame), self._traffic.signals(self._step * STEP_NS)
        self.timeline.append_step(frame, signals)
        if self.listener is not None:
            self.listener.on_step(self._step, frame, signals)
        self._step += 1

    def _follow(self, controls: Controls) -> None:
        state = self._ego.follow(self.timeline.ego, self.timeline.car, controls)
        if self.listener is not None:
            self.listener.on_tick(self._tick, state, controls)

    def _ego_view(self) -> EgoView:
        return ego_view(self.state.position_m, self.state.heading_rad, self.state.speed_mps)


def ego_view(position_m: NDArray[np.float64], heading_rad: float, speed_mps: float) -> EgoView:
    """The ego as other road users see it.

    Args:
        position_m: Position of `base_link` [m], world (3,).
        heading_rad: Direction of the car [rad].
        speed_mps: Forward speed [m/s].
    """
    x, y, z = (float(value) for value in position_m)
    ahead = EGO_REAR_M + 0.5 * EGO_SIZE_M[0]
    north, east = sin_cos(heading_rad)
    return EgoView(
        position_m=(x + ahead * east, y + ahead * north, z),
        heading_rad=heading_rad,
        speed_mps=speed_mps,
    )
