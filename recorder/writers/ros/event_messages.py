"""Packs events as `dvs_msgs/EventArray` as a whole: an object per event would take 10 s a second."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Events

_ROS1 = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("polarity", "u1")])
_CDR = np.dtype(
    {
        "names": ["y", "sec", "nsec", "polarity", "next_x"],
        "formats": ["<u2", "<u4", "<u4", "u1", "<u2"],
        "offsets": [0, 4, 8, 12, 14],
        "itemsize": 16,
    }
)
"""CDR aligns every number to its size: 16 bytes per event, the last two of them the next event's x."""
EVENT_TYPE = "dvs_msgs/msg/EventArray"
"""Type of the messages."""


def ros1_with_events(empty: bytes, sample: Events, epoch_ns: int) -> bytes:
    """A serialised ROS 1 message without events, and with those of a sample.

    Args:
        empty: The message as ROS 1 writes it; it ends with a count of 0.
        sample: The events.
        epoch_ns: Added to every time [ns].
    """
    events = sample.events
    rows = np.zeros(len(events), _ROS1)
    unix_ns = events["t"] + epoch_ns
    rows["sec"], rows["nsec"] = unix_ns // 10**9, unix_ns % 10**9
    rows["x"], rows["y"], rows["polarity"] = events["x"], events["y"], events["p"]
    return empty[:-4] + _count(events) + rows.tobytes()


def cdr_with_events(empty: bytes, sample: Events, epoch_ns: int) -> bytes:
    """A serialised ROS 2 message without events, and with those of a sample.

    Args:
        empty: The message as CDR; it ends with a count of 0.
        sample: The events.
        epoch_ns: Added to every time [ns].
    """
    events = sample.events
    rows = np.zeros(len(events), _CDR)
    unix_ns = events["t"] + epoch_ns
    rows["sec"], rows["nsec"], rows["polarity"] = unix_ns // 10**9, unix_ns % 10**9, events["p"]
    rows["y"], rows["next_x"][:-1] = events["y"], events["x"][1:]
    body = bytearray(rows.tobytes())
    if len(events):
        body[:4] = events["x"][:1].tobytes() + events["y"][:1].tobytes()
        del body[-3:]
    return empty[:-4] + _count(events) + body


def unpacked_events(data: bytes) -> tuple[bytes, NDArray[np.void]]:
    """Events of a serialised message of ROS 1 or, with its four bytes of encoding before it, of ROS 2.

    Args:
        data: The message.

    Returns:
        The bytes before their count, and rows of t since 1970 [ns], x, y and p (1: brighter), shape (N,).
    """
    # ROS 2: time, text, sizes; ROS 1 has a number before the time. Both end with 13 or 16 bytes an event.
    ros2 = data[:4] == b"\x00\x01\x00\x00" and _rows_at(data, 12, 4) is not None
    rows = _rows_at(data, 12, 4) if ros2 else _rows_at(data, 12, 1)
    if rows is None:
        raise WriterError("a message of events ends early; write the bag again")
    at, count = rows
    events = np.zeros(count, [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
    if ros2:
        body = np.frombuffer(data[at:] + bytes(3), _CDR, count)
        events["x"][1:] = body["next_x"][:-1]
        events["y"][1:] = body["y"][1:]
        if count:
            events["x"][0], events["y"][0] = np.frombuffer(data[at : at + 4], "<u2")
    else:
        body = np.frombuffer(data[at:], _ROS1, count)
        events["x"], events["y"] = body["x"], body["y"]
    events["t"] = body["sec"].astype(np.int64) * 10**9 + body["nsec"]
    events["p"] = body["polarity"]
    return data[: at - 4], events


def _rows_at(data: bytes, text_at: int, aligned: int) -> tuple[int, int] | None:
    """First byte and number of the events of a message, None where its length contradicts that."""
    text_end = text_at + 4 + int.from_bytes(data[text_at : text_at + 4], "little")
    count_at = -(-text_end // aligned) * aligned + 8
    count = int.from_bytes(data[count_at : count_at + 4], "little")
    size = 13 * count if aligned == 1 else max(16 * count - 3, 0)
    return (count_at + 4, count) if count_at + 4 + size == len(data) else None


def _count(events: NDArray[np.void]) -> bytes:
    return np.uint32(len(events)).tobytes()
