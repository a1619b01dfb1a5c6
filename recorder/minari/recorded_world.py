"""A recorded drive, step by step, as views of agents and the referee see a living world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS, STEP_TICKS
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.core.transforms import quat_to_matrix
from carlaloc_env.driving.road_ahead import RoadAhead
from carlaloc_env.map.routing.route import Route
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.town.town import Town, without_movables
from carlaloc_env.traffic.stop_lines import StopLines
from carlaloc_env.traffic.traffic_config import TrafficConfig
from recorder.episode.episode import Episode


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedCar:
    """The ego's recorded state after a tick, named as in `EgoState`."""

    position_m: Array
    """Position of `base_link` in the world [m], shape (3,)."""
    omega_body_radps: Array
    """Body rate [rad/s], shape (3,)."""
    speed_mps: float
    """Forward speed of `base_link` [m/s]."""
    heading_rad: float
    """Direction of the body's x axis, anticlockwise from east [rad]."""
    road_wheel_rad: float
    """Mean angle of the front wheels, left positive [rad]."""


class RecordedWorld:
    """A drive on the route of its town, at the start and then at each step of 50 ms.

    Args:
        episode: The drive.
        town: Where it was.

    Raises:
        EpisodeError: the town has no route, or the drive is shorter than a step.
    """

    def __init__(self, episode: Episode, town: Town) -> None:
        if town.route is None:
            raise EpisodeError(f"{episode.path}: {town.name} has no route to follow")
        traffic = from_mapping(TrafficConfig, episode.header.traffic, f"{episode.path}: traffic")
        self.town = town if traffic.parked_cars else without_movables(town)
        self.route: Route = town.route
        self.timeline = episode.timeline()
        self.step_count = min(len(episode.ego) - 2, (len(episode.steps) - 2) * STEP_TICKS) // STEP_TICKS
        """Steps that can be taken; physics and traffic were recorded a tick and a step ahead."""
        if self.step_count < 1:
            raise EpisodeError(f"{episode.path} is shorter than a step of 50 ms")
        self._ego = episode.ego
        self._touches: dict[int, list[Contact]] = {}
        for event in episode.events:
            if event.kind == "collision":
                step = max(event.tick - 2, 0) // STEP_TICKS
                self._touches.setdefault(step, []).append(_contact(event.data))
        self._road = RoadAhead(town.network, self.route)
        self._step = 0
        self.state = self._car()
        self._road.start(self.state.position_m)

    def advance(self) -> list[Contact]:
        """Advance by a step, and return the contacts that began in it."""
        touched = self._touches.get(self._step, [])
        self._step += 1
        self.state = self._car()
        self._road.follow(self.state.position_m)
        return touched

    def driven_ticks(self) -> slice:
        """Rows of the episode's controls that the next step was driven with."""
        first = self._step * STEP_TICKS + 2
        return slice(first, first + STEP_TICKS)

    @property
    def now_ns(self) -> int:
        """Present time [ns]."""
        return self._step * STEP_NS

    @property
    def route_s_m(self) -> float:
        """How far along its route the ego is [m]; keeps growing on a closed route."""
        return self._road.progress_m

    @property
    def route_offset_m(self) -> float:
        """How far left of its route the ego is [m]."""
        return self._road.offset_m

    @property
    def stop_lines(self) -> StopLines:
        """Stop lines of the route at which lights must be obeyed."""
        return self._road.stop_lines

    def signals(self) -> NDArray[np.uint8]:
        """State of every signal head of the town now (`SignalState`), shape (S,)."""
        return self.timeline.signals_at(self.now_ns)

    def actors(self) -> ActorFrame:
        """All other road users now."""
        return self.timeline.actors_at(self.now_ns)

    def _car(self) -> RecordedCar:
        row = self._ego[self._step * STEP_TICKS + 1]
        R = quat_to_matrix(row["quat_xyzw"])
        return RecordedCar(
            position_m=np.array(row["position_m"]),
            omega_body_radps=np.array(row["omega_body_radps"]),
            speed_mps=float(row["speed_mps"]),
            heading_rad=float(np.arctan2(R[1, 0], R[0, 0])),
            road_wheel_rad=float(row["road_wheel_rad"]),
        )


def _contact(data: dict[str, object]) -> Contact:
    """The beginning of a touch; where it was is not recorded."""
    what = str(data["with"])
    return Contact(
        actor_id=None if what == "static" else int(what),
        impulse_ns=float(str(data["impulse_ns"])),
        position_m=(float("nan"),) * 3,
    )
