"""Lays a finished dataset out for a hub: card, Croissant, tables, citation, and no folder of too many files.

Nothing is uploaded. Files are linked where the disk allows it; the folder can then be pushed as it is.
"""

from __future__ import annotations

import json
import os
import shutil
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env import __version__
from carlaloc_env.core.errors import ConfigError, OutputError
from carlaloc_env.core.files.atomic_files import atomic_write
from recorder.dataset.checksums import file_sha256, read_checksums
from recorder.dataset.layout import CHECKSUMS
from recorder.dataset.manifest import DatasetManifest
from recorder.publishing.croissant import croissant
from recorder.publishing.tables import CONDITIONS, TRAJECTORIES, conditions, trajectories
from recorder.writers.text_templates import filled

FOLDER_FILES = 10_000
"""Entries of a folder of the Hugging Face hub."""
SHARD_BYTES = 1_000_000_000
"""Size from which a tar shard is closed [bytes]."""
CARD, CROISSANT, CITATION = "README.md", "croissant.json", "CITATION.bib"


def prepare_for_hub(dataset: Path, folder: Path, *, folder_files: int = FOLDER_FILES) -> None:
    """Lay a dataset out in a new folder.

    Args:
        dataset: A finished dataset.
        folder: New folder.
        folder_files: Files of a folder from which they are put into shards.

    Raises:
        ConfigError: there is no finished dataset, or a package is missing.
        OutputError: the folder exists.
    """
    DatasetManifest.read(dataset)
    if folder.exists():
        raise OutputError(f"{folder} exists; choose another")
    check_packages()
    with atomic_write(folder) as part:
        part.mkdir()
        _lay_out(dataset, part, folder_files)


def check_packages() -> None:
    """Check that the packages for tables and metadata are installed.

    Raises:
        ConfigError: a package is missing.
    """
    missing = [name for name in ("mlcroissant", "pyarrow") if find_spec(name) is None]
    if missing:
        raise ConfigError(f"--hub needs {' and '.join(missing)}; pip install 'carlaloc[hub]'")


def _lay_out(dataset: Path, folder: Path, folder_files: int) -> None:
    manifest, sums = DatasetManifest.read(dataset), read_checksums(dataset)
    members: dict[Path, list[str]] = {}
    for name in sums:
        members.setdefault(Path(name).parent, []).append(name)
    shards: list[Path] = []
    for parent, names in members.items():
        if len(names) > folder_files:
            shards += _shards(dataset, folder, parent, names)
        else:
            for name in names:
                _link(dataset / name, folder / name)
    shutil.copy(dataset / CHECKSUMS, folder / CHECKSUMS)
    tables = {TRAJECTORIES: trajectories(dataset), CONDITIONS: conditions(dataset, sums)}
    for path, table in tables.items():
        (folder / path).parent.mkdir(exist_ok=True)
        table.to_parquet(folder / path, compression="zstd", index=False)
    cite = filled(CITATION, package="recorder.publishing", version=__version__)
    (folder / CITATION).write_text(cite, encoding="utf-8")
    description = _description(manifest, len(tables[CONDITIONS]))
    listed = {name: file_sha256(folder / name) for name in (*tables, CHECKSUMS)}
    listed |= {str(path.relative_to(folder)): file_sha256(path) for path in shards}
    listed |= {name: digest for name, digest in sums.items() if (folder / name).exists()}
    metadata = croissant(
        name="CarlaLoc", description=description, cite_as=cite, sha256=listed,
        seeds=_origin(manifest), tables=tables,
    )  # fmt: skip
    (folder / CROISSANT).write_text(json.dumps(metadata, indent=1) + "\n", encoding="utf-8")
    text = _card(description, cite, tables, has_shards=bool(shards))
    (folder / CARD).write_text(text, encoding="utf-8")


def _shards(dataset: Path, folder: Path, parent: Path, members: Sequence[str]) -> Iterator[Path]:
    """Tar files of a folder's files, in their order, without times and owners: the same bytes every time."""
    number, tar, path = 0, None, folder
    for name in sorted(members):
        if tar is None:
            path = folder / parent.with_name(f"{parent.name}-{number:05d}.tar")
            path.parent.mkdir(parents=True, exist_ok=True)
            tar = tarfile.open(path, "w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115
        info = tarfile.TarInfo(Path(name).name)
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


def _origin(manifest: DatasetManifest) -> str:
    episodes = {town: drive["episode"] for town, drive in manifest.drives.items()}
    origins = [f"{town}: episode {e['sha256'][:16]}, seed {e['seed']}" for town, e in episodes.items()]
    return "; ".join(origins)


def _description(manifest: DatasetManifest, sequences: int) -> str:
    towns = ", ".join(manifest.drives)
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
    return filled(
        CARD,
        package="recorder.publishing",
        front=yaml.safe_dump(front, sort_keys=False, allow_unicode=True),
        description=description,
        cite=cite,
        has_shards=has_shards,
    )
