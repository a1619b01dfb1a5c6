"""Makes a whole episode of a recording that was cut off."""

from __future__ import annotations

import heapq
from pathlib import Path

from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX, atomic_write, check_output_file
from recorder.episode.actor_messages import ACTORS
from recorder.episode.episode import Episode, read_episode_file
from recorder.episode.file_names import RECORDING_SUFFIX
from recorder.episode.mcap_container import ContainerWriter
from recorder.episode.messages import EGO, EVENT
from recorder.episode.writer import FLUSH_NS


def repair_episode(path: str | Path, target: str | Path | None = None, *, overwrite: bool = False) -> Episode:
    """Write the content of a cut-off recording as a whole file; the recording stays unchanged.

    Args:
        path: The recording, with or without its `.recording` suffix.
        target: New file; by default the name that the recording would have got.
        overwrite: Whether an older episode of that name is replaced.

    Returns:
        The repaired episode; its `path` is the new file.

    Raises:
        EpisodeError: nothing can be read.
        OutputError: the target exists.
    """
    source = Episode.load(path, allow_partial=True).path
    stem = source.name.removesuffix(RECORDING_SUFFIX)
    if target is None:
        name = stem if stem != source.name else f"{source.stem}_repaired{EPISODE_SUFFIX}"
        target = source.with_name(name)
    target = Path(target)
    check_output_file(target, suffixes=(EPISODE_SUFFIX,), overwrite=overwrite)
    with atomic_write(target, EpisodeError) as part:
        _rewrite(source, part)
    return Episode.load(target)


def _rewrite(source: Path, target: Path) -> None:
    found = read_episode_file(source)
    out = ContainerWriter(target)
    for name, values in found.metadata:
        out.add_metadata(name, values)
    numbers = {record.topic: out.add_channel(record) for record in (EGO, ACTORS, EVENT)}
    streams = [
        zip(found.stamps_ns[topic], [number] * len(found.payloads[topic]), found.payloads[topic], strict=True)
        for topic, number in numbers.items()
        if topic in found.payloads
    ]
    cut_ns = FLUSH_NS
    for stamp, number, payload in heapq.merge(*streams, key=lambda message: message[0]):
        if stamp >= cut_ns:
            out.close_chunk()
            cut_ns = stamp + FLUSH_NS
        out.add_message(number, stamp, payload)
    out.finish()
