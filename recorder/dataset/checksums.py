"""SHA-256 of all files below a folder, in the form that ``sha256sum -c SHA256SUMS`` reads."""

from __future__ import annotations

import hashlib
from pathlib import Path

from carlaloc_env.core.errors import CarlaLocError, ConfigError, WriterError
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.core.files.text_files import read_text
from recorder.dataset.layout import CHECKSUMS, files_below


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 by path of every file below a folder, but hidden files and the folder's `CHECKSUMS`."""
    return {name: file_sha256(folder / name) for name in _names(folder)}


def write_checksums(folder: Path) -> None:
    """Write `CHECKSUMS`; sums of sub-folders with a `CHECKSUMS` are copied from there.

    Raises:
        WriterError: it cannot be written.
    """
    digests: dict[str, str] = {}
    for file in folder.glob(f"*/*/{CHECKSUMS}"):
        inner = file.parent.relative_to(folder)
        digests |= {str(inner / name): digest for name, digest in read_checksums(file.parent).items()}
    lines = [f"{digests.get(name) or file_sha256(folder / name)}  {name}\n" for name in _names(folder)]
    write_whole(folder / CHECKSUMS, "".join(lines), WriterError)


def read_checksums(folder: Path, error: type[CarlaLocError] = ConfigError) -> dict[str, str]:
    """SHA-256 of a folder's files by path, from its `CHECKSUMS`.

    Raises:
        CarlaLocError: of the kind `error`; it cannot be read.
    """
    text = read_text(folder / CHECKSUMS, "list of checksums", error)
    rows = [line.split("  ", 1) for line in text.splitlines()]
    if any(len(row) != 2 or len(row[0]) != 64 for row in rows):
        raise error(f"cannot read {folder / CHECKSUMS}: no lines of SHA-256 and name; make the dataset anew")
    return {name: digest for digest, name in rows}


def _names(folder: Path) -> list[str]:
    """Paths of all files, in the order of their parts."""
    names = []
    for path in files_below(folder):
        inner = path.relative_to(folder)
        if inner != Path(CHECKSUMS) and not any(p.startswith(".") for p in inner.parts):
            names.append(inner.as_posix())
    return names


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, read in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()
