"""Bags: their topics and messages, and the topic of a stream under a profile."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

from carlaloc_env.samples import Sample
from recorder.bags import open_bag, refused_in_one_line
from recorder.writers.topics import TopicProfile

__all__ = ["messages", "open_bag", "stamp_ns", "topic_of", "topics_in"]


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
