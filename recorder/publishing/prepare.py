"""A finished dataset laid out for a hub: card, Croissant, tables, citation, and no folder of too many files.

Nothing is uploaded. Files are linked where the disk allows it; the folder can then be pushed as it is.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tarfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env import __version__
from carlaloc_env.core.errors import ConfigError, OutputError
from recorder.dataset.manifest import FILE_NAME

FOLDER_FILES = 10_000
"""Entries of a folder of the Hugging Face hub."""
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
        ConfigError: there is no finished dataset, or a package is missing.
        OutputError: the folder exists.
    """
    if not (dataset / FILE_NAME).exists():
        raise ConfigError(f"{dataset} holds no {FILE_NAME}; give the folder of a finished dataset")
    if folder.exists():
        raise OutputError(f"{folder} exists; choose another")
    check_packages()
    with new_folder(folder) as part:
        shards = _lay_out(dataset, part, url=url, date=date, folder_files=folder_files)
    files = [path for path in folder.rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files)
    return HubFolder(path=folder, files=len(files), size=size, shards=shards)


def check_packages() -> None:
    """Make sure that tables and metadata can be written.

    Raises:
        ConfigError: a package is missing.
    """
    missing = [name for name in ("mlcroissant", "pyarrow") if find_spec(name) is None]
    if missing:
        raise ConfigError(f"--hub needs {' and '.join(missing)}; pip install 'carlaloc-env[hub]'")


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
    # Imported when they are known to be there.
    from recorder.publishing.croissant import croissant
    from recorder.publishing.tables import CONDITIONS, TRAJECTORIES, conditions, trajectories

    document = yaml.safe_load((dataset / FILE_NAME).read_text("utf-8"))
    sums: dict[str, str] = dict(document["sha256"])
    shards: dict[str, str] = {}
    crowded = [Path(name) for name in _crowded(sums, folder_files)]
    for name in sums:
        if not any(parent in Path(name).parents for parent in crowded):
            _link(dataset / name, folder / name)
    for parent in crowded:
        members = [name for name in sums if parent in Path(name).parents]
        for path in _shards(dataset, folder, parent, members):
            shards[str(path.relative_to(folder))] = _sha256(path)
    shutil.copy(dataset / FILE_NAME, folder / FILE_NAME)
    tables = {TRAJECTORIES: trajectories(dataset), CONDITIONS: conditions(dataset, sums)}
    for path, table in tables.items():
        (folder / path).parent.mkdir(exist_ok=True)
        table.to_parquet(folder / path, compression="zstd", index=False)
    cite = _CITE % __version__
    (folder / CITATION).write_text(cite, encoding="utf-8")
    description = _description(document, len(tables[CONDITIONS]))
    listed = {name: _sha256(folder / name) for name in (*tables, FILE_NAME)}
    listed |= {name: digest for name, digest in sums.items() if (folder / name).exists()} | shards
    metadata = croissant(
        name="CarlaLoc", description=description, url=url, cite_as=cite, date=date, sha256=listed,
        seeds=_origin(document), tables=tables,
    )  # fmt: skip
    (folder / CROISSANT).write_text(json.dumps(metadata, indent=1) + "\n", encoding="utf-8")
    text = _card(description, cite, tables, has_shards=bool(shards))
    (folder / CARD).write_text(text, encoding="utf-8")
    return len(shards)


def _crowded(names: Iterable[str], limit: int) -> list[str]:
    """Folders that hold more files than that themselves."""
    counts = Counter(str(Path(name).parent) for name in names)
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
        return hashlib.file_digest(file, "sha256").hexdigest()


def _origin(document: dict[str, Any]) -> str:
    drives = document.get("drives", {})
    found = [f"{town}: episode {drive['episode']['sha256'][:16]}, seed {drive['episode']['seed']}"
             for town, drive in drives.items()]  # fmt: skip
    return "; ".join(found) or f"town {document.get('town')}"


def _description(document: dict[str, Any], sequences: int) -> str:
    towns = ", ".join(document.get("drives", {})) or str(document.get("town"))
    return (
        f"{sequences} sequences of simulated driving ({towns}) for SLAM: cameras, events, LiDAR, radar, "
        "IMU, GNSS and exact truth. All sequences of a town have the same ego motion, under other weathers "
        "and traffic."
    )


def _card(description: str, cite: str, tables: Mapping[str, Any], *, has_shards: bool) -> str:
    """The dataset card: YAML front matter that the hub reads, then text for people."""
    rows = max(len(table) for table in tables.values())
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
        "size_categories": [next((text for limit, text in sizes if rows < limit), "10M<n<100M")],
        "configs": [
            {"config_name": Path(path).stem, "data_files": path, "default": path == next(iter(tables))}
            for path in tables
        ],
    }
    shards = (
        "\nFolders of very many files are tar shards (`cam0/data-00000.tar` …): unpack them in the folder of "
        "their name, and the checksums of `dataset.yaml` hold.\n"
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
* `dataset.yaml`: recipe, origin and the SHA-256 of every file; `croissant.json`: the same for machines.
{shards}
Everything is synthetic: nobody in it exists. Whoever has the drives and the recipe makes the same files anew.

```bibtex
{cite.rstrip()}
```
"""
