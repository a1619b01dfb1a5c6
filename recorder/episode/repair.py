"""Makes a whole episode of a recording that was cut off."""

from __future__ import annotations

import heapq
from contextlib import suppress
from pathlib import Path

from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.file_locks import take_lock
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX, check_output_file
from carlaloc_env.core.files.recordings import RECORDING_SUFFIX
from recorder.episode.actor_messages import ACTORS
from recorder.episode.ego_messages import EVENT, ego_record
from recorder.episode.episode import Episode, episode_file, read_episode_file
from recorder.episode.mcap_container import CUT_OFF, NOT_CLOSED, ContainerWriter
from recorder.episode.writer import FLUSH_NS


def repair_episode(path: str | Path, target: str | Path | None = None, *, overwrite: bool = False) -> Episode:
    """Write the content of a cut-off recording as a whole file, and remove the recording then.

    A recording that is damaged, not only cut off, stays, and so does a file that is no recording.

    Args:
        path: The recording, with or without its `.recording` suffix.
        target: New file; by default the name that the recording would have got.
        overwrite: Whether an older episode of that name is replaced.

    Returns:
        The repaired episode; its `path` is the new file.

    Raises:
        EpisodeError: nothing can be read, or a process still writes to it.
        OutputError: the target exists.
    """
    source = episode_file(path)
    if _is_written(source):
        raise EpisodeError(
            f"{source} is still being recorded; end that drive first (or copy the file, where there is none)"
        )
    problem = Episode.load(source, allow_partial=True).problem
    stem = source.name.removesuffix(RECORDING_SUFFIX)
    if target is None:
        name = stem if stem != source.name else f"{source.stem}_repaired{EPISODE_SUFFIX}"
        target = source.with_name(name)
    target = Path(target)
    check_output_file(target, suffixes=(EPISODE_SUFFIX,), overwrite=overwrite)
    with atomic_write(target, EpisodeError) as part:
        _rewrite(source, part)
    whole = Episode.load(target)
    if stem != source.name and problem in (None, NOT_CLOSED, CUT_OFF):
        with suppress(OSError):
            source.unlink()
    return whole


def _is_written(path: Path) -> bool:
    """Whether a process still holds a recording."""
    try:
        with path.open("r+b") as file:
            return not take_lock(file)
    except OSError:
        # It is missing, or cannot be changed: then reading it says more.
        return False


def _rewrite(source: Path, target: Path) -> None:
    container = read_episode_file(source)
    out = ContainerWriter(target)
    for name, values in container.metadata:
        out.add_metadata(name, values)
    # The first three are always there, so that a file of one car is as it was.
    others = [ego_record(car) for car in range(1, len(Episode.load(source, allow_partial=True).egos))]
    numbers = {record.topic: out.add_channel(record) for record in (ego_record(0), ACTORS, EVENT, *others)}
    streams = [
        zip(
            container.stamps_ns[topic],
            [number] * len(container.payloads[topic]),
            container.payloads[topic],
            strict=True,
        )
        for topic, number in numbers.items()
        if topic in container.payloads
    ]
    cut_ns = FLUSH_NS
    for stamp, number, payload in heapq.merge(*streams, key=lambda message: message[0]):
        if stamp >= cut_ns:
            out.close_chunk()
            cut_ns = stamp + FLUSH_NS
        out.add_message(number, stamp, payload)
    out.finish()
