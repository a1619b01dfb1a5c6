"""The living town: physics, traffic and signals advance together and fill the timelines of its cars.

Physics runs one tick ahead of `now`, because a car's spline needs the tick after the one asked
for; traffic runs one step ahead, because actors are interpolated between steps.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_NS, STEP_TICKS, stamp_ns
from carlaloc_env.core.ego import DEFAULT_RIDE, Controls
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.driving.driven_car import DrivenCar
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.map.routing.route import Route
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoCar, EgoState, EgoTick, settle_cars
from carlaloc_env.physics.params import ride_by_name
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.road.rough_surface import STANDARD_WAVINESS
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.actor_quantisation import on_grid
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.timeline.driven_cars import DrivenCars
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.timeline.vehicle_track import CarTrack
from carlaloc_env.town.town import Town, without_movables
from carlaloc_env.traffic.standing_traffic import kept_tables
from carlaloc_env.traffic.stop_lines import StopLines
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.world import TrafficWorld

_PARKED = Controls(brake=1.0)
"""Controls of a standing car."""


class DriveListener(Protocol):
    """Listener to every tick of a drive, e.g. the writer of an episode; cars are numbered from 0."""

    def on_start(self, catalog: ActorCatalog) -> None:
        """A drive begins with this traffic."""

    def on_tick(self, tick: int, state: EgoTick, controls: Controls, car: int = 0) -> None:
        """A car's state at a tick, and the controls that led there."""

    def on_step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        """Traffic and signals of a 50 ms step."""

    def on_contact(self, tick: int, contact: Contact, car: int = 0) -> None:
        """A car touched something."""


def ids_of_cars(traffic: int, cars: int) -> list[int]:
    """Instance ids of cars with physics of their own, beside so many actors of the traffic."""
    return [EGO_INSTANCE + 1 + traffic + car for car in range(cars)]


class DrivingWorld:
    """One town with cars that are driven, other road users and signals, advanced by 200 Hz ticks.

    Attributes of one car are those of the first.
    """

    def __init__(
        self,
        town: Town,
        traffic: TrafficConfig,
        *,
        friction: float = 1.0,
        ride: str = DEFAULT_RIDE,
        cars: int = 1,
    ) -> None:
        chosen, roughness = ride_by_name(ride), town.roughness
        if roughness is not None and chosen.waviness != STANDARD_WAVINESS:
            roughness = roughness.of_waviness(chosen.waviness)
        if town.route is None:
            raise ConfigError(f"town '{town.name}' has no route; add [route] points to its town.toml")
        self.town = town if traffic.parked_cars else without_movables(town)
        self.traffic_config = traffic
        self._tables = kept_tables(town)
        self._physics = PhysicsWorld(
            self.town.outline.collision_vertices_m,
            self.town.outline.collision_triangles,
            friction=friction,
            roughness=roughness,
        )
        bodies = [EgoCar(self._physics, chosen.vehicle) for _ in range(cars)]
        self.cars = tuple(DrivenCar(self.town, body, town.route) for body in bodies)
        """All cars that are driven."""
        self.listener: DriveListener | None = None
        """Called at every tick and step."""

    def reset(
        self,
        seed: int | None = None,
        listener: DriveListener | None = None,
        *,
        route: Route | None = None,
        routes: Sequence[Route] = (),
        traffic: TrafficConfig | None = None,
    ) -> None:
        """Stand the cars at the starts of their routes, let traffic run in, and begin time at 0.

        Args:
            seed: New seed of the traffic; the last one when left out.
            listener: Called at every tick and step from now on.
            route: Route of the first car from now on; the last one when left out.
            routes: Routes of all cars from now on.
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
        for car, given in zip(self.cars, routes or (route,), strict=False):
            car.route = given if given is not None else car.route
        self.listener = listener
        self._place_cars()
        tables, egos = self._tables, len(self.cars)
        self._traffic = TrafficWorld(self.town.network, self.traffic_config, tables, egos=egos)
        # Before the listener is called: traffic that does not fit is refused here.
        first = self._traffic.reset(*self._seen_cars())
        if listener is not None:
            listener.on_start(self._traffic.catalog)
        self._begin_timelines()
        self._tick = 0
        self._step = 0
        for number, car in enumerate(self.cars):
            self._record(number, car, _PARKED)
        self._add_step(first)
        self._add_step(self._traffic.step(*self._seen_cars()))
        self.tick(*(_PARKED for _ in self.cars))
        for car in self.cars:
            car.start_route()

    def _place_cars(self) -> None:
        config = self.traffic_config
        for car in self.cars:
            car.body.remove()
        for car, actor_id in zip(
            self.cars, ids_of_cars(config.vehicles + config.walkers, len(self.cars)), strict=True
        ):
            car.body.actor_id, car.gone = actor_id, False
            start = car.route.at(0.0)
            car.body.place(start.position_m[0], float(start.heading_rad[0]))
        settle_cars(self._physics, [car.body for car in self.cars])
        for car in self.cars:
            car.forget()

    def _begin_timelines(self) -> None:
        catalog = self._traffic.catalog
        self._driven: DrivenCars | None = None
        if len(self.cars) > 1:
            ids = [int(car.body.actor_id or 0) for car in self.cars]
            self._driven = DrivenCars(ids, [(EgoTrack(), CarTrack()) for _ in self.cars], int(Tag.CAR))
        for number, car in enumerate(self.cars):
            car.begin(Timeline(catalog, cars=self._driven, own=number))

    @property
    def route(self) -> Route:
        """Route of the car."""
        return self.cars[0].route

    @route.setter
    def route(self, route: Route) -> None:
        self.cars[0].route = route

    @property
    def timeline(self) -> Timeline:
        """The car, all others and the lights over time."""
        return self.cars[0].timeline

    @property
    def state(self) -> EgoState:
        """State of the car after the last tick."""
        return self.cars[0].state

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
        """Distance of the car along its route [m]; keeps growing on a closed route."""
        return self.cars[0].route_s_m

    @property
    def route_offset_m(self) -> float:
        """Offset of the car to the left of its route [m]."""
        return self.cars[0].route_offset_m

    def tick(self, *controls: Controls) -> list[Contact]:
        """Advance by 5 ms under the given controls, one for each car, and return the contacts of the first.

        Those of the others are in `DrivenCar.contacts`; controls of cars that have left are ignored.

        Raises:
            ActionError: a control is not finite or out of range; nothing has moved then.
        """
        if self._tick % STEP_TICKS == 1:
            # The step after the last has just become known.
            last = self._tick // STEP_TICKS * STEP_NS
            frames = self.timeline.traffic_at(last), self.timeline.traffic_at(last + STEP_NS)
            self._physics.set_actors(frames[0], self._traffic.catalog, frames[1], ticks=1)
        pairs = list(zip(self.cars, controls, strict=True))
        for _, given in pairs[1:]:
            given.checked()
        for car, given in pairs:
            if not car.gone:
                car.body.push(given)
        self._physics.step()
        self._tick += 1
        for number, (car, given) in enumerate(pairs):
            if car.gone:
                continue
            car.read()
            self._record(number, car, given)
            car.contacts = self._physics.contacts(car.body.body)
            if self.listener is not None:
                for contact in car.contacts:
                    self.listener.on_contact(self._tick, contact, number)
        if (self._tick - 1) % STEP_TICKS == 0 and self._tick > 1:
            self._add_step(self._traffic.step(*self._seen_cars()))
            for car in self.cars:
                if not car.gone:
                    car.follow_route()
        return self.cars[0].contacts

    def leave(self, number: int) -> None:
        """Take a car out of the drive: others neither see nor touch it from now on."""
        car = self.cars[number]
        car.gone, car.contacts = True, []
        car.body.remove()
        if self._driven is not None:
            self._driven.leave(number)

    @property
    def stop_lines(self) -> StopLines:
        """Stop lines of the car's route at which lights must be obeyed."""
        return self.cars[0].stop_lines

    def signals(self) -> NDArray[np.uint8]:
        """State of every signal head of the town now (`SignalState`), shape (S,)."""
        return self.cars[0].signals()

    def actors(self) -> ActorFrame:
        """All other road users at the last whole step."""
        return self.cars[0].actors()

    def driver_view(self) -> DriverView:
        """The view of the car's driver now."""
        return self.cars[0].driver_view()

    def forget_before(self, time_ns: int) -> None:
        """Drop the past of all timelines, for runs that keep no record."""
        for car in self.cars:
            car.timeline.forget_before(time_ns)

    def set_friction(self, factor: float) -> None:
        """Grip of the road, 1 = dry."""
        self._physics.set_friction(factor)

    def close(self) -> None:
        """End the physics."""
        self._physics.close()

    def _add_step(self, frame: ActorFrame) -> None:
        frame, signals = on_grid(frame), self._traffic.signals(self._step * STEP_NS)
        for car in self.cars:
            car.timeline.append_step(frame, signals)
        if self.listener is not None:
            self.listener.on_step(self._step, frame, signals)
        self._step += 1

    def _record(self, number: int, car: DrivenCar, controls: Controls) -> None:
        state = car.record(controls)
        if self.listener is not None:
            self.listener.on_tick(self._tick, state, controls, number)

    def _seen_cars(self) -> list[EgoView]:
        return [car.as_seen() for car in self.cars]
