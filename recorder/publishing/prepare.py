"""A finished dataset laid out for a hub: card, Croissant, tables, citation, and no folder of too many files.

Nothing is uploaded. Files are linked where the disk allows it; the folder can then be pushed as it is.

Croissant 1.1, the metadata format of machine learning's hubs (mlcommons.org), for a dataset.

Trajectories and conditions of a dataset as tables, which hubs show.
"""

from __future__ import annotations

import json
import os
import shutil
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timezone
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from carlaloc_env import __version__
from carlaloc_env.core.errors import ConfigError, OutputError
from carlaloc_env.core.files.atomic_files import atomic_write
from recorder.dataset.checksums import file_sha256, read_checksums
from recorder.dataset.layout import CHECKSUMS, SEQUENCE, sequences_below
from recorder.dataset.manifest import DatasetManifest, SequenceDescription
from recorder.evaluation.trajectory_files import read_tum
from recorder.writers.text_templates import filled

if TYPE_CHECKING:
    import pandas as pd

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
    """Make sure that tables and metadata can be written.

    Raises:
        ConfigError: a package is missing.
    """
    missing = [name for name in ("mlcroissant", "pyarrow") if find_spec(name) is None]
    if missing:
        raise ConfigError(f"--hub needs {' and '.join(missing)}; pip install 'carlaloc-env[hub]'")


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
    found = [f"{town}: episode {e['sha256'][:16]}, seed {e['seed']}" for town, e in episodes.items()]
    return "; ".join(found)


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


LICENSE = "https://spdx.org/licenses/MIT"
URL = "https://huggingface.co/datasets/OWNER/NAME"
"""Placeholder; the uploader puts the real address in its place."""
_KINDS = {
    "parquet": "application/x-parquet", "yaml": "application/yaml", "mcap": "application/x-mcap",
    "tar": "application/x-tar", "mp4": "video/mp4", "png": "image/png", "csv": "text/csv",
    "h5": "application/x-hdf5", "json": "application/json",
}  # fmt: skip
_PROVENANCE = "http://www.w3.org/ns/prov#"


def croissant(
    *,
    name: str,
    description: str,
    cite_as: str,
    sha256: Mapping[str, str],
    seeds: str,
    tables: Mapping[str, pd.DataFrame],
) -> dict[str, Any]:
    """The metadata as JSON-LD, built by `mlcroissant`.

    Args:
        name: Name of the dataset.
        description: A paragraph about the dataset.
        cite_as: BibTeX.
        sha256: Checksums of all listed files by their paths, tables included.
        seeds: Origin of the drives, for provenance.
        tables: The tables by their paths.
    """
    import mlcroissant as mlc

    metadata = mlc.Metadata(
        conforms_to=["http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0"],
        name=name,
        description=description,
        license=[LICENSE],
        url=URL,
        version="1.0.0",
        date_published=datetime.now(timezone.utc).date().isoformat(),
        creators=[mlc.Organization(name="The CarlaLoc authors")],
        cite_as=cite_as,
        keywords=["SLAM", "visual-inertial odometry", "LiDAR", "event camera", "synthetic", "driving"],
        data_collection="Simulated. A driver (a program, or a person at a wheel) drives once through each "
        "town; sensors look at the recorded motion under every weather and traffic level.",
        data_collection_type=["Synthetic data"],
        data_use_cases=["Evaluation of odometry, SLAM, depth, segmentation and event vision under weather "
                        "and traffic with identical ego motion."],
        data_limitations=["Scenes, weather, sensors and traffic are models; scores on them do not carry "
                          "over to real roads without a check there."],
        data_biases=["Seven towns of one style; traffic keeps to the right."],
        personal_sensitive_information=["None: all persons in it are synthetic."],
        extra_properties={"prov:wasGeneratedBy": f"CarlaLoc, by simulation; {seeds}"},
        distribution=[
            mlc.FileObject(
                id=path,
                name=path.replace("/", "-"),
                content_url=path,
                encoding_formats=[_KINDS.get(path.rsplit(".", 1)[-1], "application/octet-stream")],
                sha256=digest,
            )
            for path, digest in sorted(sha256.items())
        ],
        record_sets=[_records(mlc, path, table) for path, table in tables.items()],
    )  # fmt: skip
    document: dict[str, Any] = metadata.to_json()
    document["@context"]["prov"] = _PROVENANCE
    return document


def _records(mlc: Any, path: str, table: pd.DataFrame) -> Any:
    """The rows of a table, by the name of its file and the types of its columns."""
    name = path.rsplit("/", 1)[-1].removesuffix(".parquet")
    kinds = {np.dtype(np.int64): mlc.DataType.INTEGER, np.dtype(np.float64): mlc.DataType.FLOAT}
    fields = [
        mlc.Field(
            id=f"{name}/{column}",
            name=column,
            data_types=kinds.get(kind, mlc.DataType.TEXT),
            source=mlc.Source(file_object=path, extract=mlc.Extract(column=column)),
        )
        for column, kind in table.dtypes.items()
    ]
    return mlc.RecordSet(id=name, name=name, fields=fields)


TRAJECTORIES, CONDITIONS = "data/trajectories.parquet", "data/conditions.parquet"
"""Paths of the tables in a folder for a hub."""


def trajectories(dataset: Path) -> pd.DataFrame:
    """True poses of all frames of all towns, a row each.

    Columns: town, frame, stamp_ns, tx ty tz [m], qx qy qz qw; the world of `docs/conventions.md`.
    """
    import pandas as pd  # comes with mlcroissant

    tables = []
    for file in sorted(dataset.glob("*/ground_truth/*.tum")):
        truth = read_tum(file)
        columns = {"town": file.parents[1].name, "frame": file.stem, "stamp_ns": truth.stamp_ns}
        columns |= dict(zip(("tx", "ty", "tz"), truth.position_m.T, strict=True))
        columns |= dict(zip(("qx", "qy", "qz", "qw"), truth.quat_xyzw.T, strict=True))
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def conditions(dataset: Path, sha256: Mapping[str, str]) -> pd.DataFrame:
    """A row for each sequence: town, weather, traffic, rig, samples and their number, checksum.

    Args:
        dataset: The dataset.
        sha256: Checksums of all files of the dataset.
    """
    import pandas as pd

    rows = []
    for folder in sequences_below(dataset):
        found = SequenceDescription.read(folder)
        name = f"{folder.path.parent.name}/{folder.name}"
        rows.append(
            {
                "sequence": name,
                "town": folder.path.parent.name,
                "weather": found.weather["name"],
                "traffic": found.traffic["name"],
                "traffic_fraction": float(found.traffic["fraction"]),
                "rig": found.rig,
                "samples": sum(found.samples.values()),
                "samples_by_stream": json.dumps(found.samples),
                "weather_parameters": json.dumps(found.weather),
                "size_bytes": sum(p.stat().st_size for p in folder.path.rglob("*") if p.is_file()),
                "sha256": sha256[f"{name}/{SEQUENCE}"],
            }
        )
    return pd.DataFrame(rows)
