"""Compares two builds of a dataset: pictures and events within bounds, all other files byte for byte.

All bytes are equal on processors of the same kind. On other kinds the software renderer rounds a few
values of pictures differently, and event cameras depend on pictures (docs/factory.md has measurements).
"""

import itertools
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from recorder.bags.reader import open_bag
from recorder.dataset.checksums import checksums
from recorder.dataset.layout import CHECKSUMS, DATASET, EPISODES
from recorder.dataset.manifest import DatasetManifest
from recorder.episode.episode import read_episode_file
from recorder.episode.mcap_container import Container
from recorder.writers.ros.event_messages import EVENT_TYPE, unpacked_events

STEP = 1
"""Largest difference of a value of a picture [steps of 8 bits]."""
STEP_SHARE = 1e-4
"""Largest share of a picture's values that differ."""
JPEG_STEP, JPEG_SHARE = 8, 1e-2
"""The same of a JPEG: such a difference changes values by 5 steps there, and 0.3 % of them."""
EVENT_SHARE = 0.05
"""Largest share of events that only one of two files or messages has."""
_OF_A_RECORDING = ("created_utc", "versions", "crc32", "sha256")
"""Entries of an episode's header and description that depend on the time and program of recording."""
_FEW = 5
"""Number of events without a counterpart that is always accepted."""
_LABELS = ("semantic", "instance", "label", "masks")
"""Parts of the names of pictures whose values are labels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Result of a comparison."""

    within: tuple[str, ...]
    """Files that differ by no more than their bounds, a line each."""
    findings: tuple[str, ...]
    """Files that differ by more, a line each, with what differs."""


def compare(folder: Path, other: Path) -> Comparison:
    """Compare a dataset with another build of the same recipe.

    Args:
        folder: A dataset.
        other: The other dataset.

    Raises:
        ConfigError: the other folder holds no dataset.
    """
    manifests = [DatasetManifest.read(path) for path in (folder, other)]
    ours, theirs = checksums(folder), checksums(other)
    findings = [f"{name}: only in {other}" for name in sorted(set(theirs) - set(ours))]
    findings += [f"{name}: not in {other}" for name in sorted(set(ours) - set(theirs))]
    if len({repr(_origins(manifest)) for manifest in manifests}) > 1:
        findings.append(f"{DATASET}: the drives have another rig, stretch, seed or town")
    within = []
    for name in sorted(set(ours) & set(theirs)):
        if ours[name] == theirs[name] or name.endswith((".mp4", CHECKSUMS)) or name == DATASET:
            continue
        try:
            beyond = differences(folder / name, other / name)
        # Readers raise many kinds of errors on damaged files.
        except Exception as error:
            beyond = f"cannot be compared: {type(error).__name__} {' '.join(str(error).split())[:200]}"
        if beyond:
            findings.append(f"{name}: {beyond}")
        else:
            within.append(f"{name}: differs from {other} within the bounds")
    return Comparison(within=tuple(within), findings=tuple(findings))


def _origins(manifest: DatasetManifest) -> dict[str, Any]:
    """Origins of the drives, without the entries that differ between recordings of the same drive."""
    return {
        town: {**origin, "episode": {k: v for k, v in origin["episode"].items() if k not in _OF_A_RECORDING}}
        for town, origin in manifest.drives.items()
    }


def differences(ours: Path, theirs: Path) -> str:
    """Difference of two files beyond the bounds; empty if there is none."""
    kind = ours.suffix
    if kind == ".mcap" and ours.parent.name == EPISODES:
        return _of_episodes(ours, theirs)
    if kind == ".png" and not _is_label(str(ours)):
        return of_pictures(*(np.asarray(cv2.imread(str(p), cv2.IMREAD_UNCHANGED)) for p in (ours, theirs)))
    if kind == ".jpg":
        return of_pictures(
            *(np.asarray(cv2.imread(str(path))) for path in (ours, theirs)), step=JPEG_STEP, most=JPEG_SHARE
        )
    if kind == ".npz":
        return _of_arrays(*(dict(np.load(path)) for path in (ours, theirs)))
    if kind == ".h5":
        return _of_arrays(_event_file(ours), _event_file(theirs))
    if kind in (".bag", ".mcap", ".db3"):
        return next(_of_messages(ours, theirs), "")
    return "has other bytes"


def of_pictures(
    ours: NDArray[Any], theirs: NDArray[Any], *, step: int = STEP, most: float = STEP_SHARE
) -> str:
    """Difference of two 8-bit pictures beyond the bounds; empty if there is none."""
    if ours.shape != theirs.shape or ours.dtype != np.uint8 or theirs.dtype != np.uint8:
        return "has other bytes"
    apart = np.abs(ours.astype(np.int16) - theirs)
    share = np.count_nonzero(apart) / max(apart.size, 1)
    if apart.max(initial=0) > step:
        return f"a value differs by {apart.max()} steps, {step} is the bound"
    return f"{share:.2g} of its values differ, {most:g} is the bound" if share > most else ""


def of_events(ours: NDArray[np.void], theirs: NDArray[np.void]) -> str:
    """Difference of two arrays of events, in any order, beyond the bound; empty if there is none."""
    first, second = (Counter(rows.tolist()) for rows in (ours, theirs))
    alone = ((first - second) + (second - first)).total()
    share = alone / max((first | second).total(), 1)
    if share <= EVENT_SHARE or alone <= _FEW:
        return ""
    return f"{share:.2g} of its events stand in one alone, {EVENT_SHARE:g} is the bound"


def _of_arrays(ours: dict[str, NDArray[Any]], theirs: dict[str, NDArray[Any]]) -> str:
    for name in sorted(set(ours) | set(theirs)):
        if name not in ours or name not in theirs:
            return f"{name} is in one alone"
        if name == "events":
            if beyond := of_events(ours[name], theirs[name]):
                return beyond
        elif not np.array_equal(ours[name], theirs[name]):
            return f"{name} differs"
    return ""


def _event_file(path: Path) -> dict[str, NDArray[Any]]:
    """Events of a DSEC file as rows, and its other arrays but the index, which follows from the events."""
    arrays: dict[str, NDArray[Any]] = {}

    def visit(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            arrays[name] = node[()]

    with h5py.File(path) as file:
        file.visititems(visit)
    columns = {name: arrays.pop(f"events/{name}") for name in "txyp" if f"events/{name}" in arrays}
    if columns:
        arrays.pop("ms_to_idx", None)
        rows = np.empty(len(columns["t"]), [(name, values.dtype) for name, values in columns.items()])
        for name, values in columns.items():
            rows[name] = values
        arrays["events"] = rows
    return arrays


def _of_episodes(ours: Path, theirs: Path) -> str:
    """Difference of two recordings of a drive, except for times and versions of recording."""
    first, second = (read_episode_file(path) for path in (ours, theirs))
    if (first.payloads, first.stamps_ns) != (second.payloads, second.stamps_ns):
        return "is another drive"
    return "" if _header(first) == _header(second) else "has another header"


def _header(episode: Container) -> list[dict[str, str]]:
    rows = [values for _, values in episode.metadata]
    return [{name: text for name, text in row.items() if name not in _OF_A_RECORDING} for row in rows]


def _of_messages(ours: Path, theirs: Path) -> Iterator[str]:
    """Differences of two bags beyond the bounds, message by message."""
    paths = [path if path.suffix == ".bag" else path.parent for path in (ours, theirs)]
    with open_bag(paths[0]) as first, open_bag(paths[1]) as second:
        for mine, other in itertools.zip_longest(first.messages(), second.messages()):
            if mine is None or other is None:
                yield "has another number of messages"
                return
            (connection, stamp, data), (its, its_stamp, its_data) = mine, other
            topic, kind = connection.topic, connection.msgtype
            if (topic, kind, stamp) != (its.topic, its.msgtype, its_stamp):
                yield f"messages differ from {stamp} ns on: {topic}, {its.topic}"
                return
            if data != its_data and (beyond := _of_message(topic, kind, data, its_data, first.deserialize)):
                yield f"{topic} at {stamp} ns: {beyond}"


def _of_message(topic: str, kind: str, ours: bytes, theirs: bytes, read: Callable[[bytes, str], Any]) -> str:
    if kind == EVENT_TYPE:
        (head, events), (its_head, its_events) = unpacked_events(ours), unpacked_events(theirs)
        return of_events(events, its_events) if head == its_head else "has another header"
    if kind == "sensor_msgs/msg/Image" and not _is_label(topic):
        first, second = (read(data, kind) for data in (ours, theirs))
        # Pixels stand at the end.
        if ours[: -len(first.data)] != theirs[: -len(second.data)]:
            return "has another header"
        if first.encoding in ("rgb8", "bgr8", "mono8"):
            return of_pictures(first.data, second.data)
    return "has other bytes"


def _is_label(name: str) -> bool:
    return any(part in name for part in _LABELS)
