"""Events as `dvs_msgs/EventArray`, packed as a whole: an object per event would take 10 s a second."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores

from carlaloc_env.samples import Events


def definitions(store: Stores) -> dict[str, str]:
    """The messages of the rpg_dvs_ros drivers, in the words of a type store's ROS."""
    time = "time" if store == Stores.ROS1_NOETIC else "builtin_interfaces/Time"
    return {
        "dvs_msgs/msg/Event": f"uint16 x\nuint16 y\n{time} ts\nbool polarity\n",
        "dvs_msgs/msg/EventArray": "std_msgs/Header header\nuint32 height\nuint32 width\n"
        "dvs_msgs/Event[] events\n",
    }


_ROS1 = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("polarity", "u1")])
_CDR = np.dtype(
    {
        "names": ["y", "sec", "nsec", "polarity", "next_x"],
        "formats": ["<u2", "<u4", "<u4", "u1", "<u2"],
        "offsets": [0, 4, 8, 12, 14],
        "itemsize": 16,
    }
)
"""CDR aligns every number to its own size: 16 bytes per event, the last two of them the next one's x."""


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
    """The same for ROS 2.

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


def _count(events: NDArray[np.void]) -> bytes:
    return np.uint32(len(events)).tobytes()
