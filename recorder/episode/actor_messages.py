"""The actors' message of an episode: fixed point, split so that it compresses well."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.timeline.actor_quantisation import ActorCodes, decode_actors, encode_actors
from carlaloc_env.timeline.timeline import ActorFrame
from recorder.episode.messages import CDR_LITTLE_ENDIAN, message_rows

ACTORS_TOPIC = "/actors"
ACTORS_TYPE = "carlaloc_msgs/msg/ActorFrame"
ACTORS_DEFINITION = """\
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
"""

_AXES = "xyz"
_WORDS = (
    *((f"{axis}_tile", "<i2") for axis in _AXES),
    *((f"{axis}_fraction", "<u2") for axis in _AXES),
    ("heading", "<i2"),
    ("pitch", "<i2"),
    ("roll", "<i2"),
    ("steer", "<i2"),
    ("speed", "<i2"),
    ("travelled_tile", "<i2"),
    ("travelled_fraction", "<u2"),
)


@functools.lru_cache(maxsize=8)
def actors_dtype(actors: int, signals: int) -> np.dtype[np.void]:
    """Layout of an `ActorFrame` message of so many actors and signal heads in CDR."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = [
        ("encapsulation", "<u4"),
        ("step", "<i8"),
    ]
    for name, kind in _WORDS:
        fields += [(f"{name}_count", "<u4"), (name, kind, (actors,))]
        fields += [(f"{name}_padding", "u1", (-2 * actors % 4,))]
    fields += [
        ("lights_count", "<u4"),
        ("lights", "u1", (actors,)),
        ("lights_padding", "u1", (-actors % 4,)),
        ("signals_count", "<u4"),
        ("signals", "u1", (signals,)),
    ]
    return np.dtype(fields)


def pack_actors(step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> bytes:
    """CDR bytes of an `ActorFrame` message."""
    codes = encode_actors(frame)
    row = np.zeros((), dtype=actors_dtype(len(frame), len(signals)))
    row["encapsulation"] = CDR_LITTLE_ENDIAN
    row["step"] = step
    for k, axis in enumerate(_AXES):
        row[f"{axis}_tile"] = codes.position[:, k] >> 16
        row[f"{axis}_fraction"] = codes.position[:, k] & 0xFFFF
    row["travelled_tile"] = codes.travelled >> 16
    row["travelled_fraction"] = codes.travelled & 0xFFFF
    for name in ("heading", "pitch", "roll", "steer", "speed", "lights"):
        row[name] = getattr(codes, name)
    for name in (*(name for name, _ in _WORDS), "lights"):
        row[f"{name}_count"] = len(frame)
    row["signals_count"] = len(signals)
    row["signals"] = signals
    return row.tobytes()


def unpack_actors(payloads: Sequence[bytes], actors: int) -> NDArray[np.void]:
    """Rows of `actors_dtype`; the number of signal heads is that of the first message.

    Raises:
        ValueError: a message has another size or number of actors.
    """
    signals = len(payloads[0]) - actors_dtype(actors, 0).itemsize if payloads else 0
    if signals < 0:
        raise ValueError(f"actor frame shorter than {actors} actors need")
    rows = message_rows(payloads, actors_dtype(actors, signals))
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


def _joined(rows: NDArray[np.void], name: str) -> NDArray[np.int32]:
    whole: NDArray[np.int32] = rows[f"{name}_tile"].astype(np.int32) << 16 | rows[f"{name}_fraction"]
    return whole
