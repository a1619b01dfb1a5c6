"""A recorded drive, step by step, as views of agents and the referee see a living world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS, STEP_TICKS
from carlaloc_env.core.errors import ConfigError, EpisodeError, MapError
from carlaloc_env.core.transforms import quat_to_matrix
from carlaloc_env.driving.on_route import OnRoute
from carlaloc_env.driving.road_ahead import RoadAhead
from carlaloc_env.envs.task.episode_start import route_again
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.town.town import Town, without_movables
from recorder.episode.episode import Episode
from recorder.episode.traffic_level import TrafficLevel


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


class RecordedWorld(OnRoute):
    """A drive on its route, at a step of 50 ms and then at each one after it.

    Args:
        episode: The drive.
        town: Where it was.
        level: Traffic that is seen of it.

    Raises:
        EpisodeError: its route is not known, or the drive is shorter than a step.
    """

    def __init__(self, episode: Episode, town: Town, level: TrafficLevel) -> None:
        self.town = town if level.parked_cars else without_movables(town)
        try:
            self.route = route_again(episode.header.route, town)
        except (ConfigError, MapError) as error:
            raise EpisodeError(f"{episode.path}: {error}") from error
        self.timeline = level.select(episode.timeline())
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
        self.start()

    def start(self, step: int = 0) -> None:
        """Begin at a step; the way before it has been driven."""
        self._road = RoadAhead(self.town.network, self.route)
        self._step = 0
        self.state = self._car()
        self._road.start(self.state.position_m)
        for _ in range(step):
            self.advance()

    @property
    def is_over(self) -> bool:
        """Whether all steps have been taken."""
        return self._step >= self.step_count

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
