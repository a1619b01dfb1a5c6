"""Topic profiles: rules for the topic and the message of each stream."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from carlaloc_env.samples import Sample


@dataclass(frozen=True, slots=True)
class TopicRule:
    """Topic and message of the samples of some streams."""

    sample: type[Sample]
    """Kind of sample."""
    stream: str
    """Name of the stream; a ``*`` stands for any text."""
    topic: str
    """Topic; ``{}`` is the text that the ``*`` matched."""
    message: str
    """Name of the function in `messages.ENCODERS`."""
    frame_id: str | None = None
    """Frame in the message's header; None: the sample's."""
    unless: str | None = None
    """Not written when the rig has this stream (with ``{}`` as above), which holds the same and more."""
    beside: bool = False
    """Whether it is written beside what other patterns give, and keeps its topic: a driver's message."""

    def match(self, stream: str) -> str | None:
        """Text that the ``*`` matches, or None if the rule is for other streams."""
        if "*" not in self.stream:
            return "" if stream == self.stream else None
        head, tail = self.stream.split("*", 1)
        fits = len(stream) >= len(head) + len(tail) and stream.startswith(head) and stream.endswith(tail)
        return stream[len(head) : len(stream) - len(tail)] if fits else None


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicRoute:
    """Topic, message and frame of a stream."""

    topic: str
    """Topic."""
    message: str
    """Name of the function in `messages.ENCODERS`."""
    frame_id: str | None
    """Frame in the header; None: the sample's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicProfile:
    """A set of rules and of topics that belong to no sensor."""

    name: str
    """Name of the profile."""
    rules: tuple[TopicRule, ...]
    """Rules; for each stream those of the first stream pattern that fits count, and those `beside`."""
    tf_static: bool = True
    """Whether `/tf_static` is written."""
    drivers: bool = False
    """Whether sensors with a `layout` have their driver's messages, too, see `driver_layouts`."""
    definitions: Mapping[str, str] = field(default_factory=dict)
    """Definitions of message types that rosbags lacks, by names such as ``my_msgs/Ranges``."""

    def routes(
        self, kind: type[Sample], stream: str, streams: Collection[str] | None = None
    ) -> tuple[TopicRoute, ...]:
        """Topics and messages of a stream's samples; none if the profile leaves the stream out.

        Args:
            kind: Kind of sample.
            stream: Name of the stream.
            streams: All streams of the rig; None: unknown, nothing is left out.
        """
        routes: list[TopicRoute] = []
        pattern: str | None = None
        kept = {rule.topic for rule in self.rules if rule.beside}
        for rule in self.rules:
            counts = rule.sample is kind and (rule.beside or pattern in (None, rule.stream))
            part = rule.match(stream) if counts else None
            if part is None:
                continue
            pattern = pattern if rule.beside else rule.stream
            if rule.unless is None or rule.unless.format(part) not in (streams or ()):
                topic = rule.topic.format(part)
                if topic in kept and not rule.beside:
                    topic = f"/{stream}{topic}"
                routes.append(TopicRoute(topic=topic, message=rule.message, frame_id=rule.frame_id))
        return tuple(routes)

    def topic(self, kind: type[Sample], stream: str) -> str:
        """First topic of a stream, or ``/`` + its name if the profile does not hold it."""
        routes = self.routes(kind, stream)
        return routes[0].topic if routes else f"/{stream}"

    def frame(self, kind: type[Sample], stream: str, frame_id: str) -> str:
        """Frame in the headers of a stream whose samples have the frame `frame_id`."""
        routes = self.routes(kind, stream)
        return routes[0].frame_id or frame_id if routes else frame_id
