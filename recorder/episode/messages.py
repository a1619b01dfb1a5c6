"""The messages of an episode: ROS 2 definitions and the byte layout that numpy reads in one go."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.clock import stamp_ns
from carlaloc_env.core.controls import Controls

EGO_TOPIC, EVENTS_TOPIC = "/ego/state", "/events"
EGO_TYPE, EVENT_TYPE = "carlaloc_msgs/msg/EgoState", "carlaloc_msgs/msg/Event"

EGO_DEFINITION = """\
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
"""
EVENT_DEFINITION = """\
int64 tick
string kind
string json
"""

CDR_LITTLE_ENDIAN = 0x0000_0100
"""First word of every CDR message."""

EGO_DTYPE = np.dtype(
    [
        ("encapsulation", "<u4"),
        ("tick", "<i8"),
        ("position_m", "<f8", (3,)),
        ("quat_xyzw", "<f8", (4,)),
        ("velocity_world_mps", "<f8", (3,)),
        ("omega_body_radps", "<f8", (3,)),
        ("steer", "<f8"),
        ("throttle", "<f8"),
        ("brake", "<f8"),
        ("raw_steer", "<f8"),
        ("raw_throttle", "<f8"),
        ("raw_brake", "<f8"),
        ("road_wheel_rad", "<f8"),
        ("speed_mps", "<f8"),
        ("wheel_spin_radps", "<f8", (4,)),
        ("reverse", "?"),
        ("handbrake", "?"),
        ("raw_reverse", "?"),
        ("raw_handbrake", "?"),
    ]
)
"""One `EgoState` message in CDR."""
_EGO = struct.Struct("<Iq25d4?")


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
    controls: Controls = field(default_factory=Controls)
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
        """The row that `pack_ego` made an `EGO_DTYPE` of."""
        return cls(
            position_m=row["position_m"],
            quat_xyzw=row["quat_xyzw"],
            velocity_world_mps=row["velocity_world_mps"],
            omega_body_radps=row["omega_body_radps"],
            controls=_controls(row, ""),
            raw=_controls(row, "raw_"),
            road_wheel_rad=float(row["road_wheel_rad"]),
            speed_mps=float(row["speed_mps"]),
            wheel_spin_radps=row["wheel_spin_radps"],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Event:
    """Something that happened during the drive."""

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
    """CDR bytes of an `EgoState` message."""
    done, raw = row.controls, row.raw if row.raw is not None else row.controls
    return _EGO.pack(
        CDR_LITTLE_ENDIAN,
        tick,
        *_floats(row.position_m),
        *_floats(row.quat_xyzw),
        *_floats(row.velocity_world_mps),
        *_floats(row.omega_body_radps),
        done.steer,
        done.throttle,
        done.brake,
        raw.steer,
        raw.throttle,
        raw.brake,
        row.road_wheel_rad,
        row.speed_mps,
        *_floats(row.wheel_spin_radps),
        done.reverse,
        done.handbrake,
        raw.reverse,
        raw.handbrake,
    )


def _controls(row: np.void, prefix: str) -> Controls:
    return Controls(
        steer=float(row[prefix + "steer"]),
        throttle=float(row[prefix + "throttle"]),
        brake=float(row[prefix + "brake"]),
        reverse=bool(row[prefix + "reverse"]),
        handbrake=bool(row[prefix + "handbrake"]),
    )


def _floats(values: ArrayLike) -> list[float]:
    result: list[float] = np.asarray(values, dtype=np.float64).tolist()
    return result


def pack_event(tick: int, kind: str, json_text: str) -> bytes:
    """CDR bytes of an `Event` message."""
    out = struct.pack("<Iq", CDR_LITTLE_ENDIAN, tick)
    for text in (kind, json_text):
        data = text.encode() + b"\0"
        out += bytes(-(len(out) - 4) % 4) + struct.pack("<I", len(data)) + data
    return out


def unpack_ego(payloads: Sequence[bytes]) -> NDArray[np.void]:
    """Rows of `EGO_DTYPE`.

    Raises:
        ValueError: a message has another size.
    """
    return message_rows(payloads, EGO_DTYPE)


def unpack_event(payload: bytes) -> tuple[int, str, str]:
    """Tick, kind and JSON text of an `Event` message."""
    (tick,) = struct.unpack_from("<q", payload, 4)
    at, texts = 12, []
    for _ in range(2):
        at += -(at - 4) % 4
        (length,) = struct.unpack_from("<I", payload, at)
        texts.append(payload[at + 4 : at + 3 + length].decode())
        at += 4 + length
    return tick, texts[0], texts[1]


def message_rows(payloads: Sequence[bytes], dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Messages as rows of one array.

    Raises:
        ValueError: a message has another size.
    """
    if any(len(payload) != dtype.itemsize for payload in payloads):
        raise ValueError(f"message not of {dtype.itemsize} bytes")
    return np.frombuffer(b"".join(payloads), dtype=dtype)


VIOLATIONS = ("red_light", "off_road", "wrong_way", "speeding", "off_route")
"""Kinds of violations; each is an event of an episode when it begins."""
