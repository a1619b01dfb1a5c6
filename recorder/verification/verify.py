"""Verify a dataset: every byte by its checksum, every stream by its stamps, the calibration by the data."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.files.text_files import read_text
from recorder.dataset.manifest import FILE_NAME, checksums
from recorder.replaying.working_folder import FOLDER
from recorder.verification.against import compare
from recorder.verification.calibration_fit import check_fit
from recorder.verification.stamps import bags_of, check_bag, check_euroc, check_kitti
from recorder.writers.topics import profile_by_name


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """What was looked at, and what is wrong."""

    files: int
    """Number of files whose checksums were compared."""
    sequences: int
    """Number of sequences."""
    findings: tuple[str, ...]
    """What is wrong, a line each; empty: the dataset is whole and true."""
    within: tuple[str, ...] = ()
    """Files that differ from those of another making within the bounds, a line each."""


def verify(
    folder: Path, progress: Callable[[str], None] | None = None, *, against: Path | None = None
) -> Verification:
    """Look for all that can be wrong with a finished dataset.

    Args:
        folder: Folder with `dataset.yaml`.
        progress: Told what is looked at.
        against: The same dataset, made elsewhere: pictures and events may differ from it within bounds.

    Raises:
        ConfigError: a folder holds no dataset.
    """
    document = _document(folder)
    tell = progress or (lambda _: None)
    tell("checksums")
    findings = list(check_files(folder, document["sha256"]))
    if (folder / FOLDER).exists():
        findings.append(f"{FOLDER}: an unfinished run lies there; run its command again")
    for name in document["sequences"]:
        tell(name)
        findings += [f"{name}: {what}" for what in _check_sequence(folder / name, str(document["topics"]))]
    within: tuple[str, ...] = ()
    if against is not None:
        tell(str(against))
        comparison = compare(folder, against)
        findings += comparison.findings
        within = comparison.within
    return Verification(
        files=len(document["sha256"]),
        sequences=len(document["sequences"]),
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


def _check_sequence(sequence: Path, topics: str) -> Iterator[str]:
    try:
        samples = yaml.safe_load(read_text(sequence / "sequence.yaml", "sequence's description"))["samples"]
        for bag in bags_of(sequence):
            yield from (f"{bag.name}: {what}" for what in check_bag(bag, samples, profile_by_name(topics)))
        if (sequence / "mav0").is_dir():
            yield from check_euroc(sequence / "mav0")
        if (sequence / "kitti").is_dir():
            yield from check_kitti(sequence / "kitti")
        if bags_of(sequence):
            yield from check_fit(sequence.parent, bags_of(sequence)[0])
    # Damaged files make their readers raise whatever their parts do: struct, zlib, assertions, …
    except Exception as error:
        yield f"cannot be read: {type(error).__name__} {' '.join(str(error).split())[:200]}"


def _document(folder: Path) -> dict[str, Any]:
    file = folder / FILE_NAME
    if not file.exists():
        raise ConfigError(f"{folder} holds no {FILE_NAME}; give the folder of a finished dataset")
    try:
        document = yaml.safe_load(read_text(file, "dataset's description"))
        return {key: document[key] for key in ("sha256", "sequences", "topics")}
    except (KeyError, TypeError, yaml.YAMLError) as error:
        raise ConfigError(f"cannot read {file}: {' '.join(str(error).split())}; replay it anew") from error
