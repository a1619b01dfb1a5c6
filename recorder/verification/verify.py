"""Verifies a dataset: every byte by its checksum, every stream by its stamps, the calibration by the data."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from recorder.dataset.checksums import checksums, read_checksums
from recorder.dataset.layout import DatasetFolder, SequenceFolder
from recorder.dataset.manifest import DatasetManifest, SequenceDescription
from recorder.replaying.working_folder import FOLDER
from recorder.verification.against import compare
from recorder.verification.calibration_fit import check_fit
from recorder.verification.stream_checks import (
    check_bag,
    check_colmap,
    check_euroc,
    check_kitti,
    check_nuscenes,
)
from recorder.writers.topics import TopicProfile

_FOLDERS = {"euroc": check_euroc, "kitti": check_kitti, "nuscenes": check_nuscenes, "colmap": check_colmap}
"""Checks of the formats that are folders."""


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
    folder: str | Path, progress: Callable[[str], None] | None = None, *, against: Path | None = None
) -> Verification:
    """Check a finished dataset for faults.

    Args:
        folder: Folder of the dataset.
        progress: Called with the name of each part before it is checked.
        against: The same dataset, made elsewhere: pictures and events may differ from it within bounds.

    Raises:
        ConfigError: a folder holds no dataset.
    """
    folder = Path(folder)
    manifest = DatasetManifest.read(folder)
    expected = read_checksums(folder)
    report = progress or (lambda _: None)
    report("checksums")
    findings = list(check_files(folder, expected))
    if (folder / FOLDER).exists():
        findings.append(f"{FOLDER}: an unfinished run lies there; run its command again")
    for name in manifest.sequences:
        report(name)
        town, _, condition = name.partition("/")
        sequence = DatasetFolder(folder).drive(town).sequence(condition)
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
    digests = checksums(folder)
    for name, digest in sorted(expected.items()):
        if name not in digests:
            yield f"{name}: missing"
        elif digests[name] != digest:
            yield f"{name}: changed since it was written (SHA-256)"
    for name in sorted(set(digests) - set(expected)):
        yield f"{name}: not part of the dataset"


def _check_sequence(sequence: SequenceFolder, profile: TopicProfile) -> Iterator[str]:
    try:
        samples = SequenceDescription.read(sequence).samples
        for bag in sequence.bags:
            yield from (f"{bag.name}: {fault}" for fault in check_bag(bag, samples, profile))
        for name, check in _FOLDERS.items():
            if (folder := sequence.place(name)).is_dir():
                yield from check(folder)
        if sequence.bags:
            yield from check_fit(sequence.drive, sequence.bags[0], profile, samples)
    # Readers raise many kinds of errors on damaged files: struct, zlib, assertions, …
    except Exception as error:
        yield f"cannot be read: {type(error).__name__} {' '.join(str(error).split())[:200]}"
