"""The referee: what a step earns and costs, and whether the episode ends.

Weights of the reward and limits of an episode.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from numbers import Real

import numpy as np

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.physics.actor_pool import Contact
from carlaloc_env.traffic.signals import SignalState


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskConfig:
    """Weights of the reward, and limits of an episode."""

    progress_per_m: float = 1.0
    """Reward for a metre gained along the route."""
    lane_offset_per_m_s: float = 0.5
    """Cost of a second at a metre from the middle of the route's lane."""
    jerk_per_mps3_s: float = 0.01
    """Cost of a second of 1 m/s³ of longitudinal jerk."""
    speeding_per_mps_s: float = 1.5
    """Cost of a second at 1 m/s above the limit: more than the metres that it gains."""
    red_light: float = 100.0
    """Cost of passing a stop line at red: the metres of 12 s at 30 km/h, since waiting loses metres."""
    collision: float = 50.0
    """Cost of a collision."""
    off_road: float = 20.0
    """Cost of leaving the road or the route."""
    goal: float = 10.0
    """Reward for the end of the route."""
    collision_impulse_ns: float = 1500.0
    """Impulse of a touch from which it is a collision [N s]: 0.8 m/s of the ego's 1850 kg."""
    jerk_max_mps3: float = 50.0
    """Greater jerk costs no more than this one [m/s³]."""
    off_route_m: float = 12.0
    """Distance from the route at which it counts as left [m]."""
    standing_limit_s: float = 90.0
    """Time of standing still after which an episode is truncated [s]."""
    time_limit_s: float = 600.0
    """Time after which an episode is truncated [s]."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not isinstance(value, Real) or not math.isfinite(value) or value < 0.0:
                raise ConfigError(f"task: {item.name} is {value!r}; give a finite number of 0 or more")
            object.__setattr__(self, item.name, float(value))

    @classmethod
    def of(cls, task: TaskConfig | Mapping[str, float] | None) -> TaskConfig:
        """Configuration as users may give it: itself, a mapping of the values that differ, or None.

        Raises:
            ConfigError: a name is unknown, or a value no number of 0 or more.
        """
        if isinstance(task, TaskConfig):
            return task
        known = [item.name for item in fields(cls)]
        settings: dict[str, float] = dict(task or {})
        for name in settings:
            if name not in known:
                raise ConfigError(unknown_name("setting of the task", name, known))
        return cls(**settings)


STEP_S = STEP_NS * 1e-9
"""Time that one step takes [s]."""
STANDING_MPS = 0.1
"""Slower cars stand [m/s]."""
_IN_LANE_M = 1.2
"""So near the middle of its route, the car is on the road without a look at the map [m]."""
_ARRIVED_M = 2.0
"""Distance from the end of the route at which it is reached [m]: a car that stops 1 m short has arrived."""

TERMS = ("progress", "lane_offset", "jerk", "speeding", "red_light", "collision", "off_road", "goal")
"""Names of the terms whose sum is the reward."""
COSTS = ("red_light", "collision", "off_road")
"""Terms that count as violations in `info["cost"]`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict of the referee on one step."""

    terms: dict[str, float] = field(default_factory=lambda: dict.fromkeys(TERMS, 0.0))
    """Reward by term."""
    cost: float = 0.0
    """Number of violations: collisions, red lights, leaving the road."""
    ended_by: str | None = None
    """`goal`, `collision`, `off_road`, `off_route`: what terminates the episode."""
    truncated_by: str | None = None
    """`time` or `standing`: what truncates it."""

    @property
    def reward(self) -> float:
        """Sum of all terms."""
        return sum(self.terms.values())

    def then(self, after: Verdict) -> Verdict:
        """Verdict of this stretch and the one after it."""
        terms = {name: value + after.terms[name] for name, value in self.terms.items()}
        cost, ended_by, truncated_by = self.cost + after.cost, after.ended_by, after.truncated_by
        return Verdict(terms=terms, cost=cost, ended_by=ended_by, truncated_by=truncated_by)


class Referee:
    """Judges the steps of one episode."""

    def __init__(self, world: TaskWorld, config: TaskConfig) -> None:
        """Begin an episode in a world that has just been reset."""
        self._world = world
        self._config = config
        self._route_s_m = world.route_s_m
        self._lines_m = world.stop_lines.s_m.tolist()
        self._acceleration_mps2 = 0.0
        self._speed_mps = world.state.speed_mps
        self.standing_s = 0.0
        """For how long the car has been standing [s]."""

    def judge(self, contacts: Sequence[Contact]) -> Verdict:
        """Judge the 50 ms that have just been driven.

        Args:
            contacts: What the car touched in them.
        """
        world, config = self._world, self._config
        before_m, self._route_s_m = self._route_s_m, world.route_s_m
        speed = world.state.speed_mps
        acceleration = (speed - self._speed_mps) / STEP_S
        jerk = min(abs(acceleration - self._acceleration_mps2) / STEP_S, config.jerk_max_mps3)
        self._speed_mps, self._acceleration_mps2 = speed, acceleration
        self.standing_s = self.standing_s + STEP_S if abs(speed) < STANDING_MPS else 0.0
        limit = float(world.route.speed_limit_mps[world.route.row_at(self._route_s_m)])
        collided = any(contact.impulse_ns > config.collision_impulse_ns for contact in contacts)
        reds = self._reds_passed(before_m, self._route_s_m)
        off_route = abs(world.route_offset_m) > config.off_route_m
        off_road = off_route or not self._on_road()
        arrived = not world.route.closed and self._route_s_m >= world.route.length_m - _ARRIVED_M
        arrived |= world.route.closed and self._route_s_m >= world.route.length_m
        terms = {
            "progress": config.progress_per_m * (self._route_s_m - before_m),
            "lane_offset": -config.lane_offset_per_m_s * abs(world.route_offset_m) * STEP_S,
            "jerk": -config.jerk_per_mps3_s * jerk * STEP_S,
            "speeding": -config.speeding_per_mps_s * max(speed - limit, 0.0) * STEP_S,
            "red_light": -config.red_light * reds,
            "collision": -config.collision * collided,
            "off_road": -config.off_road * off_road,
            "goal": config.goal * arrived,
        }
        ended = (
            "collision" if collided
            else "off_route" if off_route
            else "off_road" if off_road
            else "goal" if arrived
            else None
        )  # fmt: skip
        over = "time" if world.now_ns * 1e-9 >= config.time_limit_s else None
        if self.standing_s > config.standing_limit_s:
            over = "standing"
        cost = float(reds + collided + off_road)
        return Verdict(terms=terms, cost=cost, ended_by=ended, truncated_by=None if ended else over)

    def _reds_passed(self, before_m: float, after_m: float) -> int:
        """Stop lines that the front bumper passed while their light was red."""
        length = self._world.route.length_m
        front, back = after_m + EGO_FRONT_M, before_m + EGO_FRONT_M
        lap_m = math.floor(back / length) * length if self._world.route.closed else 0.0
        passed = [k for k, line_m in enumerate(self._lines_m) if back < line_m + lap_m <= front]
        shown, heads = self._world.signals(), self._world.stop_lines.heads
        return sum(int(shown[heads[k]].max()) == SignalState.RED for k in passed)

    def _on_road(self) -> bool:
        """Whether any of the car is still on a driving lane."""
        world = self._world
        if abs(world.route_offset_m) < _IN_LANE_M:
            return True
        state = world.state
        ahead = EGO_REAR_M + 0.5 * EGO_SIZE_M[0]
        x = state.position_m[0] + ahead * np.cos(state.heading_rad)
        y = state.position_m[1] + ahead * np.sin(state.heading_rad)
        # In space: below a bridge, its lanes are far.
        nearest = world.town.network.nearest([(x, y, state.position_m[2])])
        half = 0.5 * float(world.town.network.width_m(nearest.lane, nearest.station_m)[0])
        return float(nearest.distance_m[0]) < half + 0.5 * EGO_SIZE_M[1]
