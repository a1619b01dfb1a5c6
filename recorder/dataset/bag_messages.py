"""Topics, messages and stamps of bags, and the topic of a stream under a profile."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples import Sample
from recorder.bags.reader import open_bag, refused_in_one_line
from recorder.dataset.readings import ImuSample
from recorder.writers.topics import TopicProfile

Stamps: TypeAlias = NDArray[np.int64]
"""Times of messages [ns], shape (N,)."""


def topics_in(bag: Path) -> dict[str, int]:
    """Number of messages by topic.

    Raises:
        EvaluationError: the bag is missing or damaged.
    """
    with open_bag(bag) as reader:
        counts: dict[str, int] = {}
        for connection in reader.connections:
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
        return counts


def messages(bag: Path, topic: str) -> Iterator[Any]:
    """All messages of a topic.

    Raises:
        EvaluationError: the bag is missing or damaged.
    """
    with open_bag(bag) as reader:
        wanted = [connection for connection in reader.connections if connection.topic == topic]
        # Without any the reader would give all messages.
        if not wanted:
            return
        with refused_in_one_line(bag):
            for connection, _, raw in reader.messages(connections=wanted):
                yield reader.deserialize(raw, connection.msgtype)


def stamp_ns(message: Any) -> int:
    """Time in a message's header [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def stamps_in(bag: Path) -> dict[tuple[str, str], Stamps]:
    """Times of all messages [ns], by topic and type.

    Raises:
        EvaluationError: the bag is missing or damaged.
    """
    stamps_ns: dict[tuple[str, str], list[int]] = defaultdict(list)
    with open_bag(bag) as reader, refused_in_one_line(bag):
        for connection, stamp, _ in reader.messages():
            stamps_ns[connection.topic, connection.msgtype].append(stamp)
    return {key: np.array(stamps, np.int64) for key, stamps in stamps_ns.items()}


def imu_sample(message: Any) -> ImuSample:
    """An inertial message's stamp and values."""
    a, w = message.linear_acceleration, message.angular_velocity
    return ImuSample(
        stamp_ns=stamp_ns(message),
        acceleration_mps2=np.array([a.x, a.y, a.z]),
        angular_velocity_radps=np.array([w.x, w.y, w.z]),
    )


def topic_of(
    profile: TopicProfile,
    kind: type[Sample],
    wanted: Sequence[str],
    *,
    streams: Collection[str],
    encoders: Collection[str],
) -> str | None:
    """Topic of the first wanted stream that a profile writes by a known encoder; None: it has none.

    Args:
        profile: Topics of the bag.
        kind: Kind of sample.
        wanted: Names of streams, the best one first.
        streams: All streams of the sequence.
        encoders: Names of those of `messages.ENCODERS` whose messages the reader understands.
    """
    for stream in wanted:
        for route in profile.routes(kind, stream, streams) if stream in streams else ():
            if route.message in encoders:
                return route.topic
    return None
