"""Messages of an episode: the state of the ego after each tick, and events of the drive."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core.clock import stamp_ns
from carlaloc_env.core.ego import Controls
from recorder.episode.record_types import RecordType

EGO = RecordType(
    topic="/ego/state",
    name="carlaloc_msgs/msg/EgoState",
    definition="""\
# State of the ego's base_link after one 200 Hz tick; world is ENU, body is FLU.
int64 tick
float64[3] position_m
float64[4] quat_xyzw
float64[3] velocity_world_mps
float64[3] omega_body_radps
# Controls that the physics took in this tick.
float64 steer
float64 throttle
float64 brake
# The device's axes before shaping.
float64 raw_steer
float64 raw_throttle
float64 raw_brake
float64 road_wheel_rad
float64 speed_mps
# Front left, front right, rear left, rear right.
float64[4] wheel_spin_radps
bool reverse
bool handbrake
bool raw_reverse
bool raw_handbrake
""",
)
"""State of the ego after every tick."""
EVENT = RecordType(
    topic="/events",
    name="carlaloc_msgs/msg/Event",
    definition="""\
int64 tick
string kind
string json
""",
)
"""What happened."""
CONTROLS = ("steer", "throttle", "brake", "reverse", "handbrake")
"""Names of the controls; in `EGO` the device's own begin with ``raw_``."""
_STATE = ("position_m", "quat_xyzw", "velocity_world_mps", "omega_body_radps", "road_wheel_rad", "speed_mps",
          "wheel_spin_radps")  # fmt: skip
"""Names of the numbers beside them."""
VIOLATIONS = ("red_light", "off_road", "wrong_way", "speeding", "off_route")
"""Kinds of violations; each is an event of an episode when it begins."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EgoRow:
    """State of the ego after one tick, and what its driver did."""

    position_m: ArrayLike
    """Position of `base_link` in the world [m], shape (3,)."""
    quat_xyzw: ArrayLike
    """Attitude, maps body to world, shape (4,)."""
    velocity_world_mps: ArrayLike = (0.0, 0.0, 0.0)
    """Velocity in world axes [m/s], shape (3,)."""
    omega_body_radps: ArrayLike = (0.0, 0.0, 0.0)
    """Body rate [rad/s], shape (3,)."""
    controls: Controls = dataclasses.field(default_factory=Controls)
    """Controls that the physics took."""
    raw: Controls | None = None
    """The device's axes before shaping; None: the same as `controls`."""
    road_wheel_rad: float = 0.0
    """Angle of the front wheels, left positive [rad]."""
    speed_mps: float = 0.0
    """Forward speed of `base_link` [m/s]."""
    wheel_spin_radps: ArrayLike = (0.0, 0.0, 0.0, 0.0)
    """Spin of the wheels: front left, front right, rear left, rear right [rad/s], shape (4,)."""

    @classmethod
    def of(cls, row: np.void) -> EgoRow:
        """The row that `pack_ego` made a message of."""
        return cls(
            controls=_controls(row, ""), raw=_controls(row, "raw_"), **{name: row[name] for name in _STATE}
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Event:
    """Event of the drive, such as a collision."""

    tick: int
    """Tick at which it happened."""
    kind: str
    """What happened, e.g. ``collision``."""
    data: dict[str, object]
    """Details, JSON values."""

    @property
    def stamp_ns(self) -> int:
        """Time of the event since the drive began [ns]."""
        return stamp_ns(self.tick)


def pack_ego(tick: int, row: EgoRow) -> bytes:
    """Bytes of an `EgoState` message."""
    raw = row.raw if row.raw is not None else row.controls
    out = EGO.row()
    out["tick"] = tick
    for name in _STATE:
        out[name] = getattr(row, name)
    for name in CONTROLS:
        out[name], out[f"raw_{name}"] = getattr(row.controls, name), getattr(raw, name)
    return out.tobytes()


def _controls(row: np.void, prefix: str) -> Controls:
    return Controls(**{name: row[prefix + name].item() for name in CONTROLS})
