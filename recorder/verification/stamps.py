"""Checks of a sequence's streams: number of messages, their stamps, and equal stamps of a stereo pair."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples import Image, ObjectList, Odometry
from recorder.dataset.readings import open_bag
from recorder.writers.ros.messages import ENCODERS
from recorder.writers.topics import TopicProfile

Stamps = NDArray[np.int64]
_PAIR = ("rgb_left", "rgb_right")
"""Streams of a stereo pair."""
_TRUTH_STREAMS = {Odometry: "truth", ObjectList: "objects"}
"""Streams of the replay itself, whose rules fit any name."""


def check_bag(bag: Path, samples: Mapping[str, int], profile: TopicProfile) -> Iterator[str]:
    """Faults of the messages of a bag.

    Args:
        bag: The bag.
        samples: Number of samples by stream, from the sequence's description.
        profile: Topics of the bag.
    """
    found: dict[str, list[int]] = defaultdict(list)
    types: dict[str, str] = {}
    with open_bag(bag) as reader:
        for connection, stamp, _ in reader.messages():
            found[connection.topic].append(stamp)
            types[connection.topic] = connection.msgtype
    expected = expected_counts(samples, profile)
    for topic, stamps in sorted(found.items()):
        wanted = expected.get((topic, types[topic]))
        if wanted is not None and wanted != len(stamps):
            yield f"{topic} has {len(stamps)} messages instead of {wanted}"
        yield from check_gaps(topic, np.unique(np.array(stamps, np.int64)))
    left, right = (profile.topic(Image, stream) for stream in _PAIR)
    if left in found and right in found:
        yield from check_pair(f"{left} and {right}", np.array(found[left]), np.array(found[right]))


def expected_counts(samples: Mapping[str, int], profile: TopicProfile) -> dict[tuple[str, str], int]:
    """Number of messages by topic and type that samples become."""
    counts: Counter[tuple[str, str]] = Counter()
    kinds = {rule.sample for rule in profile.rules}
    for stream, number in samples.items():
        for kind in kinds:
            if _TRUTH_STREAMS.get(kind, stream) != stream:
                continue
            for route in profile.routes(kind, stream, samples):
                counts[route.topic, ENCODERS[route.message][0]] += number
    return dict(counts)


def check_gaps(name: str, stamps_ns: Stamps) -> Iterator[str]:
    """Gaps between messages, and stamps that do not rise."""
    steps = np.diff(stamps_ns)
    if len(steps) < 2:
        return
    period = int(np.median(steps))
    if period <= 0 or steps.min() <= 0:
        yield f"{name}: stamps do not rise"
        return
    wide = np.flatnonzero(steps > 1.5 * period)
    if len(wide):
        first = stamps_ns[wide[0]]
        yield f"{name} has {len(wide)} gaps, the first of {steps[wide[0]] / 1e9:.3f} s after {first} ns"


def check_pair(name: str, left_ns: Stamps, right_ns: Stamps) -> Iterator[str]:
    """Unequal stamps of a stereo pair's images; cameras of different rates are no pair."""
    if min(len(left_ns), len(right_ns)) < 2:
        return
    periods = [float(np.median(np.diff(np.sort(stamps)))) for stamps in (left_ns, right_ns)]
    if abs(periods[0] - periods[1]) > 0.1 * periods[0]:
        return
    apart = np.setxor1d(left_ns, right_ns)
    if len(apart):
        yield f"{name} have {len(apart)} unequal stereo stamps, the first at {apart[0]} ns"


def check_euroc(mav0: Path) -> Iterator[str]:
    """Faults of the tables and images of a EuRoC folder."""
    pictures: dict[str, Stamps] = {}
    for table in sorted(mav0.glob("*/data.csv")):
        lines = [line.split(",") for line in table.read_text("utf-8").splitlines() if line[:1] != "#"]
        stamps = np.array([int(line[0]) for line in lines], np.int64)
        name = f"{mav0.name}/{table.parent.name}"
        yield from check_gaps(name, stamps)
        if not table.parent.name.startswith("cam"):
            continue
        pictures[table.parent.name] = stamps
        listed = {line[1] for line in lines}
        there = {path.name for path in (table.parent / "data").iterdir()}
        if missing := sorted(listed - there):
            yield f"{name}: {len(missing)} images are missing, the first is {missing[0]}"
        if unknown := sorted(there - listed):
            yield f"{name}: {len(unknown)} images are not listed, the first is {unknown[0]}"
    if "cam0" in pictures and "cam1" in pictures:
        yield from check_pair(f"{mav0.name}/cam0 and cam1", pictures["cam0"], pictures["cam1"])


def check_kitti(folder: Path) -> Iterator[str]:
    """Unequal numbers of files and lines in a KITTI folder."""
    counts = {name: len(list((folder / name).iterdir())) for name in ("velodyne", "labels")}
    counts |= {
        name: len((folder / name).read_text("ascii").split("\n")) - 1 for name in ("poses.txt", "times.txt")
    }
    if len(set(counts.values())) > 1:
        numbers = ", ".join(f"{name} {number}" for name, number in counts.items())
        yield f"{folder.name} has unequal counts: {numbers}"
