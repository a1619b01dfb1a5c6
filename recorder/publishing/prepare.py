"""A finished dataset laid out for a hub: card, Croissant, tables, citation, and no folder of too many files.

Nothing is uploaded. Files are linked where the disk allows it; the folder can then be pushed as it is.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env import __version__
from carlaloc_env.core.errors import ConfigError, OutputError
from recorder.dataset.checksums import read_checksums
from recorder.dataset.layout import CHECKSUMS, DATASET
from recorder.dataset.manifest import DatasetManifest
from recorder.factory.quantities import size_text
from recorder.publishing.croissant import croissant
from recorder.publishing.tables import (
    CONDITIONS,
    TRAJECTORIES,
    check_parquet,
    write_conditions,
    write_trajectories,
)

FOLDER_FILES, REPOSITORY_FILES, FILE_BYTES = 10_000, 100_000, 200e9
"""What a repository of the Hugging Face hub holds: entries of a folder, files in all, bytes of a file."""
SHARD_BYTES = 1_000_000_000
"""Size from which a tar shard is closed [bytes]."""
CARD, CROISSANT, CITATION = "README.md", "croissant.json", "CITATION.bib"
_CITE = """\
@misc{carlaloc,
  title  = {CarlaLoc: a driving world, a full SLAM sensor suite and a dataset factory},
  author = {{The CarlaLoc authors}},
  note   = {Made with version %s}
}
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class HubFolder:
    """What was laid out."""

    path: Path
    """The folder."""
    files: int
    """Number of files."""
    size: int
    """Their size [bytes]."""
    shards: int
    """Number of tar shards."""


def prepare_for_hub(
    dataset: Path, folder: Path, *, url: str, date: str, folder_files: int = FOLDER_FILES
) -> HubFolder:
    """Lay a dataset out in a new folder.

    Args:
        dataset: A finished dataset.
        folder: New folder.
        url: Where it will lie.
        date: Day of publication, ISO 8601.
        folder_files: Files of a folder from which they are put into shards.

    Raises:
        ConfigError: there is no finished dataset, it is too large for a hub, or pyarrow is missing.
        OutputError: the folder exists.
    """
    DatasetManifest.read(dataset)
    if folder.exists():
        raise OutputError(f"{folder} exists; choose another")
    check_parquet()
    with new_folder(folder) as part:
        shards = _lay_out(dataset, part, url=url, date=date, folder_files=folder_files)
    files = [path for path in folder.rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files)
    return HubFolder(path=folder, files=len(files), size=size, shards=shards)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A folder under a temporary name, which takes its own if all goes well, and is removed if not."""
    part = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        part.mkdir(parents=True)
        yield part
        part.rename(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _lay_out(dataset: Path, folder: Path, *, url: str, date: str, folder_files: int) -> int:
    """Write everything; return the number of shards."""
    manifest = DatasetManifest.read(dataset)
    sums = read_checksums(dataset)
    shards: dict[str, str] = {}
    crowded = [Path(name) for name in _crowded(sums, folder_files)]
    for name in sums:
        if not any(parent in Path(name).parents for parent in crowded):
            _link(dataset / name, folder / name)
    for parent in crowded:
        members = [name for name in sums if parent in Path(name).parents]
        for path in _shards(dataset, folder, parent, members):
            shards[str(path.relative_to(folder))] = _sha256(path)
    shutil.copy(dataset / CHECKSUMS, folder / CHECKSUMS)
    poses = write_trajectories(dataset, folder / TRAJECTORIES)
    sequences = write_conditions(dataset, folder / CONDITIONS, sums)
    cite = _CITE % __version__
    (folder / CITATION).write_text(cite, encoding="utf-8")
    description = _description(manifest, sequences)
    listed = {name: _sha256(folder / name) for name in (TRAJECTORIES, CONDITIONS, DATASET, CHECKSUMS)}
    listed |= {name: digest for name, digest in sums.items() if (folder / name).exists()} | shards
    metadata = croissant(
        name="CarlaLoc", description=description, url=url, cite_as=cite, date=date, sha256=listed,
        seeds=_origin(manifest),
    )  # fmt: skip
    (folder / CROISSANT).write_text(json.dumps(metadata, indent=1) + "\n", encoding="utf-8")
    (folder / CARD).write_text(_card(description, cite, poses, bool(shards)), encoding="utf-8")
    if problems := list(hub_problems(folder)):
        raise ConfigError(f"{dataset} is not for a hub: {problems[0]}")
    return len(shards)


def hub_problems(folder: Path) -> Iterator[str]:
    """Which limits of the hub a folder does not keep, a line each."""
    count = 0
    for parent, folders, files in os.walk(folder):
        count += len(files)
        if len(folders) + len(files) > FOLDER_FILES:
            yield f"{parent} has {len(folders) + len(files)} entries, more than {FOLDER_FILES}"
        for name in files:
            size = (Path(parent) / name).stat().st_size
            if size > FILE_BYTES:
                yield f"{parent}/{name} takes {size_text(size)}, more than {size_text(FILE_BYTES)}"
    if count > REPOSITORY_FILES:
        yield f"{count} files, more than {REPOSITORY_FILES}; choose formats of fewer files, such as rosbag2"


def _crowded(names: Sequence[str] | dict[str, str], limit: int) -> list[str]:
    """Folders that hold more files than that themselves."""
    counts: dict[str, int] = {}
    for name in names:
        parent = str(Path(name).parent)
        counts[parent] = counts.get(parent, 0) + 1
    return sorted(parent for parent, count in counts.items() if count > limit)


def _shards(dataset: Path, folder: Path, parent: Path, members: Sequence[str]) -> Iterator[Path]:
    """Tar files of a folder's files, in their order, without times and owners: the same bytes every time."""
    number, tar, path = 0, None, folder
    for name in sorted(members):
        if tar is None:
            path = folder / parent.with_name(f"{parent.name}-{number:05d}.tar")
            path.parent.mkdir(parents=True, exist_ok=True)
            tar = tarfile.open(path, "w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115
        info = tarfile.TarInfo(str(Path(name).relative_to(parent)))
        info.size = (dataset / name).stat().st_size
        with (dataset / name).open("rb") as file:
            tar.addfile(info, file)
        if tar.offset >= SHARD_BYTES:
            tar.close()
            yield path
            number, tar = number + 1, None
    if tar is not None:
        tar.close()
        yield path


def _link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copy(source, target)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return (
            hashlib.file_digest(file, "sha256").hexdigest()
            if hasattr(hashlib, "file_digest")
            else _long(file)
        )


def _long(file: Any) -> str:
    digest = hashlib.sha256()
    while piece := file.read(1 << 20):
        digest.update(piece)
    return digest.hexdigest()


def _origin(manifest: DatasetManifest) -> str:
    episodes = {town: drive["episode"] for town, drive in manifest.drives.items()}
    found = [f"{town}: episode {e['sha256'][:16]}, seed {e['seed']}" for town, e in episodes.items()]
    return "; ".join(found)


def _description(manifest: DatasetManifest, sequences: int) -> str:
    towns = ", ".join(manifest.drives)
    return (
        f"{sequences} sequences of simulated driving ({towns}) for SLAM: cameras, events, LiDAR, radar, "
        "IMU, GNSS and exact truth. All sequences of a town have the same ego motion, under other weathers "
        "and traffic."
    )


def _card(description: str, cite: str, poses: int, has_shards: bool) -> str:
    """The dataset card: YAML front matter that the hub reads, then text for people."""
    sizes = ((1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"), (1e7, "1M<n<10M"))
    front = {
        "license": "mit",
        "pretty_name": "CarlaLoc",
        "task_categories": ["robotics", "depth-estimation", "image-segmentation"],
        "tags": [
            "slam",
            "visual-inertial-odometry",
            "lidar",
            "event-camera",
            "synthetic",
            "autonomous-driving",
        ],
        "size_categories": [next((text for limit, text in sizes if poses < limit), "10M<n<100M")],
        "configs": [
            {"config_name": "trajectories", "default": True, "data_files": TRAJECTORIES},
            {"config_name": "conditions", "data_files": CONDITIONS},
        ],
    }
    shards = (
        "\nFolders of very many files are tar shards (`cam0/data-00000.tar` …): unpack them in the folder of "
        "their name, and the checksums of `SHA256SUMS` hold.\n"
        if has_shards
        else ""
    )
    return f"""\
---
{yaml.safe_dump(front, sort_keys=False, allow_unicode=True).rstrip()}
---

# CarlaLoc

{description}

* `TOWN/WEATHER_TRAFFIC/`: the sequences, `TOWN/calibration/`, `TOWN/ground_truth/`, `episodes/`: the drives.
* `data/trajectories.parquet`: the true pose of every sensor, 200 Hz; `data/conditions.parquet`: a row
  a sequence.
* `dataset.yaml`: recipe and origin, `SHA256SUMS`: checksums, `croissant.json`: both for machines.
{shards}
Everything is synthetic: nobody in it exists. Whoever has the drives and the recipe makes the same files anew.

```bibtex
{cite.rstrip()}
```
"""
