"""Referee: the reward and costs of a step, and the end of an episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.ego import EGO_CENTRE_M, EGO_FRONT_M, EGO_SIZE_M
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.traffic.signals import SignalState

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
            contacts: Contacts of the car in them.
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
        x = state.position_m[0] + EGO_CENTRE_M * np.cos(state.heading_rad)
        y = state.position_m[1] + EGO_CENTRE_M * np.sin(state.heading_rad)
        # In space: below a bridge, its lanes are far.
        nearest = world.town.network.nearest([(x, y, state.position_m[2])])
        half = 0.5 * float(world.town.network.width_m(nearest.lane, nearest.station_m)[0])
        return float(nearest.distance_m[0]) < half + 0.5 * EGO_SIZE_M[1]
