"""Message of an episode with all actors and signals: fixed point, split so that it compresses well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.timeline.actor_quantisation import ActorCodes, decode_actors, encode_actors
from carlaloc_env.timeline.actors import ActorFrame
from recorder.episode.record_types import RecordType

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


def pack_actors(
    first_step: int, frames: Sequence[ActorFrame], signals: Sequence[NDArray[np.uint8]]
) -> NDArray[np.void]:
    """`ActorFrame` messages of consecutive steps, shape (K,), together: a field costs as much as for one."""
    whole = {name: np.stack([getattr(frame, name) for frame in frames]) for name in ActorFrame.__slots__}
    codes = encode_actors(ActorFrame(**whole))
    rows = np.repeat(ACTORS.row(_lengths(len(frames[0]), len(signals[0]))), len(frames))
    rows["step"] = np.arange(first_step, first_step + len(frames))
    for k, axis in enumerate(_AXES):
        rows[f"{axis}_tile"] = codes.position[..., k] >> 16
        rows[f"{axis}_fraction"] = codes.position[..., k] & 0xFFFF
    rows["travelled_tile"] = codes.travelled >> 16
    rows["travelled_fraction"] = codes.travelled & 0xFFFF
    for name in ("heading", "pitch", "roll", "steer", "speed", "lights"):
        rows[name] = getattr(codes, name)
    rows["signals"] = signals
    return rows


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
