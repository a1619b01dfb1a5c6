"""Weights of the reward, and limits of an episode."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Real

from carlaloc_env.core.errors import ConfigError, unknown_name


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
        names = [item.name for item in fields(cls)]
        settings: dict[str, float] = dict(task or {})
        for name in settings:
            if name not in names:
                raise ConfigError(unknown_name("setting of the task", name, names))
        return cls(**settings)
