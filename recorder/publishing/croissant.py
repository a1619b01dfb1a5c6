"""Croissant 1.1, the metadata format of machine learning's hubs (mlcommons.org), for a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

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
