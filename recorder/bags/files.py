"""Finds the files of a bag of ROS 1 or ROS 2, and their kind by their first bytes, not by names."""

from __future__ import annotations

import functools
import logging
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml
import zstandard

from carlaloc_env.core.errors import EvaluationError

_LOG = logging.getLogger(__name__)
METADATA = "metadata.yaml"
"""File that rosbag2 writes beside the files of a bag when it closes it."""
_ROS1, _SQLITE, _MCAP, _ZSTD = ".bag", ".db3", ".mcap", ".zstd"
_BEGINNINGS = {
    b"#ROSBAG V": _ROS1,
    b"SQLite format 3\0": _SQLITE,
    b"\x89MCAP0\r\n": _MCAP,
    b"\x28\xb5\x2f\xfd": _ZSTD,
}
"""First bytes of a file, and the suffix by which rosbags knows its kind."""
_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"PK\x03\x04": "zip", b"7z\xbc\xaf": "7z"}
_PART = re.compile(r"(?P<name>.*?)(?:_?\d{4}(?:-\d\d){5})?_(?P<number>\d+)")
"""Stem of a part of a split bag, which recorders count from 0: ``run_3``, ``run_2026-11-26-09-30-00_3``."""


def files_of_bag(path: Path, scratch: Callable[[], Path]) -> list[Path]:
    """Paths that `rosbags` reads as one bag.

    A file is itself, whatever lies beside it. A folder with a ``metadata.yaml`` is a ROS 2 bag; another
    folder is the one bag in it, which may be split into numbered files.

    Args:
        path: A file of ROS 1, MCAP or SQLite, compressed by zstd or not, or a folder.
        scratch: Makes an empty folder for what must be unpacked or called otherwise.

    Raises:
        EvaluationError: there is none, or there are several.
    """
    if path.name == METADATA:
        path = path.parent
    if path.is_dir():
        return _of_folder(path, scratch)
    if not path.is_file():
        raise EvaluationError(f"{path}: no such bag; give a file (.bag, .mcap, .db3) or a folder of ROS 2")
    kind = kind_of(path)
    if kind == _ZSTD:
        return files_of_bag(_unpacked(path, scratch), scratch)
    if _has_packed_messages(described := metadata_of(path)):
        if len(described["relative_file_paths"]) > 1:
            raise EvaluationError(
                f"{path} is a part of a bag whose messages are compressed; give its folder {path.parent}"
            )
        return [path.parent]
    return [_file(path, kind, scratch)]


def kind_of(path: Path) -> str:
    """Suffix that fits a file's first bytes: ``.bag``, ``.db3``, ``.mcap`` or ``.zstd``.

    Raises:
        EvaluationError: it is none of these.
    """
    with path.open("rb") as file:
        begin = file.read(16)
    for sign, kind in _BEGINNINGS.items():
        if begin.startswith(sign):
            return kind
    for sign, packer in _PACKED.items():
        if begin.startswith(sign):
            raise EvaluationError(f"{path} is packed by {packer}; unpack it, and give the bag in it")
    raise EvaluationError(f"cannot read {path}: no ROS bag, or a damaged one; give another")


def metadata_of(path: Path) -> dict[str, Any]:
    """Content of ``metadata.yaml`` for a folder, or for a file that it names beside it; else nothing."""
    file = (path if path.is_dir() else path.parent) / METADATA
    try:
        information = _information(file.read_text("utf-8"))
        names = [Path(name).name for name in information["relative_file_paths"]]
    # Whatever is wrong with it: the files are read without it.
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError):
        return {}
    return dict(information) if path.is_dir() or path.name in names else {}


@functools.lru_cache(maxsize=4)
def _information(metadata: str) -> Any:
    """Content of a ``metadata.yaml``; a folder and each of its files need it, and parsing takes long."""
    return yaml.safe_load(metadata)["rosbag2_bagfile_information"]


def _of_folder(folder: Path, scratch: Callable[[], Path]) -> list[Path]:
    if described := metadata_of(folder):
        # Only rosbags' reader of folders unpacks messages. It reads nothing where files and metadata.yaml
        # differ in a topic's quality of service, as after `ros2 bag reindex`: files are read by themselves.
        if _has_packed_messages(described):
            return [folder]
        named = [folder / Path(name).name for name in described["relative_file_paths"]]
        if missing := [file.name for file in named if not file.is_file()]:
            raise EvaluationError(
                f"{folder}: {METADATA} names {', '.join(missing)}, not there; give the file that is"
            )
        return [part for file in named for part in files_of_bag(file, scratch)]
    inside = sorted(folder.iterdir())
    files = [p for p in inside if p.is_file() and _suffix(p) in (_ROS1, _SQLITE, _MCAP)]
    if not files:
        files = [p for p in inside if p.is_dir() and (p / METADATA).is_file()]
    if not files:
        raise EvaluationError(f"{folder} holds no bag; give a file (.bag, .mcap, .db3) or a folder of ROS 2")
    if len(files) > 1 and (files[0].is_dir() or not _is_split(files)):
        names = ", ".join(file.name for file in files)
        raise EvaluationError(f"{folder} holds {len(files)} bags; give one of them: {names}")
    if len(files) > 1:
        _LOG.warning("%s: %d files are read as the parts of one bag", folder, len(files))
    return [part for file in files for part in files_of_bag(file, scratch)]


def _suffix(path: Path) -> str:
    """Suffix of a bag's name, before ``.zstd``."""
    return Path(path.stem).suffix if path.suffix == _ZSTD else path.suffix


def _is_split(files: Sequence[Path]) -> bool:
    """Whether names differ by the number of the part alone."""
    stems = [file.name.removesuffix(_ZSTD).removesuffix(_suffix(file)) for file in files]
    parts = [part for stem in stems if (part := _PART.fullmatch(stem))]
    names = {(part["name"], _suffix(file)) for part, file in zip(parts, files, strict=False)}
    numbers = {int(part["number"]) for part in parts}
    return len(names) == 1 and numbers == set(range(len(files)))


def _unpacked(path: Path, scratch: Callable[[], Path]) -> Path:
    to = scratch() / path.name.removesuffix(path.suffix)
    with path.open("rb") as packed, to.open("wb") as file:
        try:
            reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            shutil.copyfileobj(reader, file)
        except zstandard.ZstdError as error:
            raise EvaluationError(f"cannot unpack {path}: {error}; give a whole one") from error
    return to


def _has_packed_messages(described: dict[str, Any]) -> bool:
    return str(described.get("compression_mode")).lower() == "message"


def _file(path: Path, kind: str, scratch: Callable[[], Path]) -> Path:
    """The path, or a link to it by a name that ends as rosbags wants it."""
    log = path.with_name(f"{path.name}-wal")
    if kind == _SQLITE and log.is_file() and log.stat().st_size:
        raise EvaluationError(
            f"{path} was not closed by its recorder: messages are still in {log.name}; "
            f"run: sqlite3 {path} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )
    if path.suffix == kind:
        return path
    link = scratch() / f"{path.stem}{kind}"
    link.symlink_to(path.resolve())
    return link
