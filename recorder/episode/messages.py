"""The messages of an episode about the ego and about what happened.

Byte layout of messages, derived from their ROS 2 definitions: for numpy, for `struct`, for single values.

Messages lie in CDR as ROS 2 sends it (OMG DDS-XTypes, plain CDR version 1): a word that names the
encoding, then every value at a multiple of its size, counted from behind that word; sequences begin
with their length, strings end with a zero byte.

The actors' message of an episode: fixed point, split so that it compresses well.
"""

from __future__ import annotations

import dataclasses
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.clock import stamp_ns
from carlaloc_env.core.ego import Controls
from carlaloc_env.timeline.actor_quantisation import ActorCodes, decode_actors, encode_actors
from carlaloc_env.timeline.timeline import ActorFrame

ENCAPSULATION = 0x0000_0100
"""First word of every message, as a little-endian number: CDR, little-endian."""
_CODES = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
"""`struct` codes of the primitive types; numpy has the same."""
_FIELD = re.compile(r"(?P<kind>\w+)(?P<array>\[(?P<length>\d*)\])?\s+(?P<name>[a-z]\w*)$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One line of a message definition."""

    name: str
    """Name of the value."""
    kind: str
    """Primitive type, or ``string``."""
    length: int | None
    """Length of a fixed array, None of a single value or a sequence."""
    is_sequence: bool
    """Whether the number of values differs from message to message."""

    @property
    def size(self) -> int:
        """Size of one value, and what its position is a multiple of [byte]; 1 of a string's characters."""
        return 1 if self.kind == "string" else struct.calcsize("<" + _CODES[self.kind])


@dataclass(frozen=True, kw_only=True)
class RecordType:
    """A kind of messages of an episode.

    Raises:
        ValueError: the definition holds something else than primitive types, their arrays, and strings.
    """

    topic: str
    """Where such messages stand."""
    name: str
    """Name of the type, e.g. ``carlaloc_msgs/msg/Event``."""
    definition: str
    """Text of its ``.msg`` file."""

    def __post_init__(self) -> None:
        self.fields  # noqa: B018  a bad definition fails where it is written

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """Values of a message, in order."""
        lines = (line.partition("#")[0].strip() for line in self.definition.splitlines())
        return tuple(_field(line) for line in lines if line)

    def dtype(self, lengths: Mapping[str, int] | None = None) -> np.dtype[np.void]:
        """Layout for numpy, with the fields' names.

        Beside them stand ``encapsulation``, ``<name>_count`` before each sequence, and padding.

        Args:
            lengths: Length of each sequence by its name.
        """
        return _dtype(self, tuple(sorted((lengths or {}).items())))

    def row(self, lengths: Mapping[str, int] | None = None) -> NDArray[np.void]:
        """A message to be filled in, shape (): all zeros but the encapsulation and the sequences' lengths."""
        row = np.zeros((), dtype=self.dtype(lengths))
        row["encapsulation"] = ENCAPSULATION
        for name, length in (lengths or {}).items():
            row[f"{name}_count"] = length
        return row

    def rows(self, payloads: Sequence[bytes], lengths: Mapping[str, int] | None = None) -> NDArray[np.void]:
        """Messages as rows of one array.

        Raises:
            ValueError: a message has another size.
        """
        dtype = self.dtype(lengths)
        if any(len(payload) != dtype.itemsize for payload in payloads):
            raise ValueError(f"{self.name} not of {dtype.itemsize} bytes")
        return np.frombuffer(b"".join(payloads), dtype=dtype)

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """Bytes of a message of single values and strings."""
        out = bytearray(struct.pack("<I", ENCAPSULATION))
        for field in self.fields:
            out += bytes(-(len(out) - 4) % (4 if field.kind == "string" else field.size))
            if field.kind == "string":
                text = values[field.name].encode() + b"\0"
                out += struct.pack("<I", len(text)) + text
            else:
                out += struct.pack("<" + _CODES[field.kind], values[field.name])
        return bytes(out)

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """Values of a message of single values and strings, by name.

        Raises:
            ValueError: a text is not UTF-8.
            struct.error: the message is too short.
        """
        at, values = 4, dict[str, Any]()
        for field in self.fields:
            size = 4 if field.kind == "string" else field.size
            at += -(at - 4) % size
            code = "I" if field.kind == "string" else _CODES[field.kind]
            (value,) = struct.unpack_from(f"<{code}", payload, at)
            at += size
            if field.kind == "string":
                values[field.name] = payload[at : at + value - 1].decode()
                at += value
            else:
                values[field.name] = value
        return values


def _field(line: str) -> Field:
    found = _FIELD.fullmatch(line)
    if found is None or (found["kind"] not in _CODES and (found["kind"] != "string" or found["array"])):
        raise ValueError(f"'{line}' is no field of a primitive type")
    length = int(found["length"]) if found["length"] else None
    is_sequence = found["array"] is not None and length is None
    return Field(name=found["name"], kind=found["kind"], length=length, is_sequence=is_sequence)


@lru_cache(maxsize=64)
def _dtype(record: RecordType, lengths: tuple[tuple[str, int], ...]) -> np.dtype[np.void]:
    count_of = dict(lengths)
    parts: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = [("encapsulation", "<u4")]
    end = 0

    def align(size: int, name: str) -> None:
        nonlocal end
        if gap := -end % size:
            parts.append((f"padding_before_{name}", "u1", (gap,)))
            end += gap

    for field in record.fields:
        if field.kind == "string":
            raise ValueError(f"{record.name} holds a text, {field.name}: numpy has no layout for it")
        count = count_of[field.name] if field.is_sequence else field.length
        if field.is_sequence:
            align(4, f"{field.name}_count")
            parts.append((f"{field.name}_count", "<u4"))
            end += 4
        if count != 0:
            align(field.size, field.name)
        code = np.dtype("<" + _CODES[field.kind]).str
        parts.append((field.name, code) if count is None else (field.name, code, (count,)))
        end += field.size * (1 if count is None else count)
    return np.dtype(parts)


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


VIOLATIONS = ("red_light", "off_road", "wrong_way", "speeding", "off_route")
"""Kinds of violations; each is an event of an episode when it begins."""


ACTORS = RecordType(
    topic="/actors",
    name="carlaloc_msgs/msg/ActorFrame",
    definition="""\
# State of all actors of the catalogue and of all signal heads at one 50 ms step, in fixed point.
int64 step
# Position [m] = 32 * tile + fraction / 2048, world frame.
int16[] x_tile
int16[] y_tile
int16[] z_tile
uint16[] x_fraction
uint16[] y_fraction
uint16[] z_fraction
# Angles [rad] = 2 * pi / 65536 * value.
int16[] heading
int16[] pitch
int16[] roll
int16[] steer
# Speed [m/s] = value / 256.
int16[] speed
# Distance covered [m] = 256 * tile + fraction / 256.
int16[] travelled_tile
uint16[] travelled_fraction
uint8[] lights
uint8[] signals
""",
)
"""Actors and signal heads of every step."""

_AXES = "xyz"


def _lengths(actors: int, signals: int) -> dict[str, int]:
    """Length of every sequence of a message of so many actors and signal heads."""
    lengths = {field.name: actors for field in ACTORS.fields if field.is_sequence}
    return {**lengths, "signals": signals}


def pack_actors(step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> bytes:
    """Bytes of an `ActorFrame` message."""
    codes = encode_actors(frame)
    row = ACTORS.row(_lengths(len(frame), len(signals)))
    row["step"] = step
    for k, axis in enumerate(_AXES):
        row[f"{axis}_tile"] = codes.position[:, k] >> 16
        row[f"{axis}_fraction"] = codes.position[:, k] & 0xFFFF
    row["travelled_tile"] = codes.travelled >> 16
    row["travelled_fraction"] = codes.travelled & 0xFFFF
    for name in ("heading", "pitch", "roll", "steer", "speed", "lights"):
        row[name] = getattr(codes, name)
    row["signals"] = signals
    return row.tobytes()


def unpack_actors(payloads: Sequence[bytes], actors: int) -> NDArray[np.void]:
    """Rows of the layout of `ACTORS`; the number of signal heads is that of the first message.

    Raises:
        ValueError: a message has another size or number of actors.
    """
    signals = len(payloads[0]) - ACTORS.dtype(_lengths(actors, 0)).itemsize if payloads else 0
    if signals < 0:
        raise ValueError(f"actor frame shorter than {actors} actors need")
    rows = ACTORS.rows(payloads, _lengths(actors, signals))
    if np.any(rows["lights_count"] != actors) or np.any(rows["signals_count"] != signals):
        raise ValueError(f"actor frame not of {actors} actors and {signals} signal heads")
    return rows


def actor_states(rows: NDArray[np.void]) -> ActorFrame:
    """States of all rows at once: every array of the frame begins with an axis of K rows."""
    position = np.stack([_joined(rows, axis) for axis in _AXES], axis=-1)
    return decode_actors(
        ActorCodes(
            position=position,
            heading=rows["heading"],
            pitch=rows["pitch"],
            roll=rows["roll"],
            speed=rows["speed"],
            travelled=_joined(rows, "travelled"),
            steer=rows["steer"],
            lights=np.ascontiguousarray(rows["lights"]),
        )
    )


def actor_frames(rows: NDArray[np.void]) -> list[ActorFrame]:
    """The state of each row."""
    states = actor_states(rows)
    return [
        ActorFrame(**{name: getattr(states, name)[k] for name in ActorFrame.__slots__})
        for k in range(len(rows))
    ]


def _joined(rows: NDArray[np.void], name: str) -> NDArray[np.int32]:
    whole: NDArray[np.int32] = rows[f"{name}_tile"].astype(np.int32) << 16 | rows[f"{name}_fraction"]
    return whole
