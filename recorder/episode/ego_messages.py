"""Messages of an episode: the state of the ego after each tick, and events of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
"""Names of the numbers beside them, in the order of `EgoRow`."""
VIOLATIONS = ("red_light", "off_road", "wrong_way", "speeding", "off_route")
"""Kinds of violations; each is an event of an episode when it begins."""


def ego_record(car: int) -> RecordType:
    """Kind of messages with the states of a car, from 0; only their topic differs."""
    return replace(EGO, topic=f"/car{car + 1}/state") if car else EGO


class EgoRow(NamedTuple):
    """State of the ego after one tick, and what its driver did."""

    position_m: ArrayLike
    """Position of `base_link` in the world [m], shape (3,)."""
    quat_xyzw: ArrayLike
    """Attitude, maps body to world, shape (4,)."""
    velocity_world_mps: ArrayLike = (0.0, 0.0, 0.0)
    """Velocity in world axes [m/s], shape (3,)."""
    omega_body_radps: ArrayLike = (0.0, 0.0, 0.0)
    """Body rate [rad/s], shape (3,)."""
    road_wheel_rad: float = 0.0
    """Angle of the front wheels, left positive [rad]."""
    speed_mps: float = 0.0
    """Forward speed of `base_link` [m/s]."""
    wheel_spin_radps: ArrayLike = (0.0, 0.0, 0.0, 0.0)
    """Spin of the wheels: front left, front right, rear left, rear right [rad/s], shape (4,)."""
    controls: Controls = Controls()
    """Controls that the physics took."""
    raw: Controls | None = None
    """The device's axes before shaping; None: the same as `controls`."""

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


def pack_ego(first_tick: int, rows: Sequence[EgoRow]) -> NDArray[np.void]:
    """`EgoState` messages of consecutive ticks, shape (K,), together: a field costs as much as for one."""
    out = np.repeat(EGO.row(), len(rows))
    out["tick"] = np.arange(first_tick, first_tick + len(rows))
    *state, controls, raw = zip(*rows, strict=True)
    for name, column in zip(_STATE, state, strict=True):
        width = out[name].shape[1:]
        # From one flat sequence numbers come twice as fast as from nested ones.
        flat = np.fromiter(chain.from_iterable(column), np.float64) if width else np.array(column)
        out[name] = flat.reshape(len(rows), *width)
    raw = tuple(own if device is None else device for own, device in zip(controls, raw, strict=True))
    for name in CONTROLS:
        out[name] = [getattr(one, name) for one in controls]
        out[f"raw_{name}"] = out[name] if raw == controls else [getattr(one, name) for one in raw]
    return out


def _controls(row: np.void, prefix: str) -> Controls:
    return Controls(**{name: row[prefix + name].item() for name in CONTROLS})
