"""Verify a dataset: every byte by its checksum, every stream by its stamps, the calibration by the data.

Checks of a sequence's streams: number of messages, their stamps, and equal stamps of a stereo pair.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from carlaloc_env.core.files.output_paths import path_below
from carlaloc_env.samples import Image, ObjectList, Odometry
from recorder.dataset.bag_messages import Stamps, stamps_in
from recorder.dataset.checksums import checksums, read_checksums
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.manifest import DatasetManifest, SequenceDescription
from recorder.dataset.reading_checks import check_gaps
from recorder.replaying.working_folder import FOLDER
from recorder.verification.against import compare
from recorder.verification.calibration_fit import check_fit
from recorder.writers.formats.nuscenes_tables import VERSION
from recorder.writers.ros.messages import ENCODERS
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
    found = stamps_in(bag)
    expected = expected_counts(samples, profile)
    for (topic, kind), stamps in sorted(found.items()):
        wanted = expected.get((topic, kind))
        if wanted is not None and wanted != len(stamps):
            yield f"{topic} has {len(stamps)} messages instead of {wanted}"
        yield from check_gaps(topic, np.unique(stamps))
    by_topic = {topic: stamps for (topic, _), stamps in found.items()}
    left, right = (profile.topic(Image, stream) for stream in _PAIR)
    if left in by_topic and right in by_topic:
        yield from check_pair(f"{left} and {right}", by_topic[left], by_topic[right])


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
            if twin.parents[2].is_dir() and not twin.exists():
                yield f"{folder.name}: {frame['file_path']} has no twin in {twin.parents[3].name}"


def _check_list(folder: Path, parts: tuple[str, ...], names: Iterable[str]) -> Iterator[str]:
    listed = set(names)
    files = (path for part in parts for path in (folder / part).rglob("*") if path.is_file())
    there = {path.relative_to(folder).as_posix() for path in files}
    if missing := sorted(listed - there):
        yield f"{folder.name}: {len(missing)} files are missing, the first is {missing[0]}"
    if unknown := sorted(there - listed):
        yield f"{folder.name}: {len(unknown)} files are not listed, the first is {unknown[0]}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """Result of a verification."""

    files: int
    """Number of files whose checksums were compared."""
    sequences: int
    """Number of sequences."""
    findings: tuple[str, ...]
    """Faults, a line each; empty: the dataset is whole and correct."""
    within: tuple[str, ...] = ()
    """Files that differ from the other dataset's within the bounds, a line each."""


def verify(
    folder: Path, progress: Callable[[str], None] | None = None, *, against: Path | None = None
) -> Verification:
    """Check a finished dataset for faults.

    Args:
        folder: Folder of the dataset.
        progress: Called with the name of each part before it is checked.
        against: The same dataset, made elsewhere: pictures and events may differ from it within bounds.

    Raises:
        ConfigError: a folder holds no dataset.
    """
    manifest = DatasetManifest.read(folder)
    expected = read_checksums(folder)
    report = progress or (lambda _: None)
    report("checksums")
    findings = list(check_files(folder, expected))
    if (folder / FOLDER).exists():
        findings.append(f"{FOLDER}: an unfinished run lies there; run its command again")
    for name in manifest.sequences:
        report(name)
        sequence = SequenceFolder(path_below(folder, name))
        profile = manifest.profile(sequence.path.parent.name)
        findings += [f"{name}: {fault}" for fault in _check_sequence(sequence, profile)]
    within: tuple[str, ...] = ()
    if against is not None:
        report(str(against))
        comparison = compare(folder, against)
        findings += comparison.findings
        within = comparison.within
    return Verification(
        files=len(expected),
        sequences=len(manifest.sequences),
        findings=tuple(findings),
        within=within,
    )


def check_files(folder: Path, expected: dict[str, str]) -> Iterator[str]:
    """Files that are missing, changed or unknown."""
    found = checksums(folder)
    for name, digest in sorted(expected.items()):
        if name not in found:
            yield f"{name}: missing"
        elif found[name] != digest:
            yield f"{name}: changed since it was written (SHA-256)"
    for name in sorted(set(found) - set(expected)):
        yield f"{name}: not part of the dataset"


def _check_sequence(sequence: SequenceFolder, profile: TopicProfile) -> Iterator[str]:
    try:
        samples = SequenceDescription.read(sequence).samples
        for bag in sequence.bags:
            yield from (f"{bag.name}: {fault}" for fault in check_bag(bag, samples, profile))
        if (mav0 := sequence.place("euroc")).is_dir():
            yield from check_euroc(mav0)
        if (kitti := sequence.place("kitti")).is_dir():
            yield from check_kitti(kitti)
        if (nuscenes := sequence.place("nuscenes")).is_dir():
            yield from check_nuscenes(nuscenes)
        if (colmap := sequence.place("colmap")).is_dir():
            yield from check_colmap(colmap)
        if sequence.bags:
            yield from check_fit(sequence.drive, sequence.bags[0], profile, samples)
    # Readers raise many kinds of errors on damaged files: struct, zlib, assertions, …
    except Exception as error:
        yield f"cannot be read: {type(error).__name__} {' '.join(str(error).split())[:200]}"
