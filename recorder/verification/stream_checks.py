"""Checks a sequence's streams: numbers of messages, their stamps, and equal stamps of a stereo pair."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from carlaloc_env.samples import Image, ObjectList, Odometry
from recorder.dataset.bag_messages import Stamps, stamps_in
from recorder.dataset.layout import files_below
from recorder.dataset.reading_checks import check_gaps
from recorder.writers.formats.nuscenes_tables import VERSION
from recorder.writers.ros.messages import message_type
from recorder.writers.topics import TopicProfile

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
    stamps_by_topic = stamps_in(bag)
    expected = expected_counts(samples, profile, ros1=bag.suffix == ".bag")
    for (topic, kind), stamps in sorted(stamps_by_topic.items()):
        wanted = expected.get((topic, kind))
        if wanted is not None and wanted != len(stamps):
            yield f"{topic} has {len(stamps)} messages instead of {wanted}"
        yield from check_gaps(topic, np.unique(stamps))
    by_topic = {topic: stamps for (topic, _), stamps in stamps_by_topic.items()}
    left, right = (profile.topic(Image, stream) for stream in _PAIR)
    if left in by_topic and right in by_topic:
        yield from check_pair(f"{left} and {right}", by_topic[left], by_topic[right])


def expected_counts(
    samples: Mapping[str, int], profile: TopicProfile, *, ros1: bool
) -> dict[tuple[str, str], int]:
    """Number of messages by topic and type that samples become in a bag of ROS 1 or 2."""
    counts: Counter[tuple[str, str]] = Counter()
    kinds = {rule.sample for rule in profile.rules}
    for stream, number in samples.items():
        for kind in kinds:
            if _TRUTH_STREAMS.get(kind, stream) != stream:
                continue
            for route in profile.routes(kind, stream, samples):
                counts[route.topic, message_type(route.message, ros1=ros1)] += number
    return dict(counts)


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
        yield from _unequal(name, "images", listed, there)
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


def check_nuscenes(folder: Path) -> Iterator[str]:
    """Files that the tables of a nuScenes folder name and that are missing, or that they do not name."""
    tables = folder / VERSION
    rows = [json.loads((tables / f"{name}.json").read_text("utf-8")) for name in ("sample_data", "lidarseg")]
    names = (row["filename"] for table in rows for row in table)
    yield from _check_list(folder, ("samples", "sweeps", "lidarseg"), names)


def check_colmap(folder: Path) -> Iterator[str]:
    """Pictures that COLMAP's tables name and that are missing, and twins that do not have the same view."""
    lines = (folder / "sparse" / "0" / "images.txt").read_text("utf-8").splitlines()[::2]
    yield from _check_list(folder, ("images",), (f"images/{line.split()[-1]}" for line in lines))
    for frame in json.loads((folder / "transforms.json").read_text("utf-8"))["frames"]:
        twins = (frame.get("clean_plate_path"), *frame.get("weather_paths", {}).values())
        for twin in (folder / path for path in twins if path):
            # A twin may be replayed later, or by another rig.
            if twin.parents[1].is_dir() and not twin.exists():
                yield f"{folder.name}: {frame['file_path']} has no twin in {twin.parents[2].name}"


def _check_list(folder: Path, parts: tuple[str, ...], names: Iterable[str]) -> Iterator[str]:
    files = (path for part in parts for path in files_below(folder / part))
    there = {path.relative_to(folder).as_posix() for path in files}
    yield from _unequal(folder.name, "files", set(names), there)


def _unequal(name: str, what: str, listed: set[str], there: set[str]) -> Iterator[str]:
    if missing := sorted(listed - there):
        yield f"{name}: {len(missing)} {what} are missing, the first is {missing[0]}"
    if unknown := sorted(there - listed):
        yield f"{name}: {len(unknown)} {what} are not listed, the first is {unknown[0]}"
