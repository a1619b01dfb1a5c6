"""Croissant 1.1: what a dataset consists of, in words of machine learning's hubs (mlcommons.org)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from recorder.publishing.tables import CONDITIONS, TRAJECTORIES

CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "key": "cr:key",
    "prov": "http://www.w3.org/ns/prov#",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "sc": "https://schema.org/",
    "source": "cr:source",
}
LICENSE = "https://spdx.org/licenses/MIT"
_FIELDS = {
    "trajectories": {
        "town": "sc:Text", "frame": "sc:Text", "stamp_ns": "sc:Integer",
        **dict.fromkeys(("tx", "ty", "tz", "qx", "qy", "qz", "qw"), "sc:Float"),
    },
    "conditions": {
        "sequence": "sc:Text", "town": "sc:Text", "weather": "sc:Text", "traffic": "sc:Text",
        "traffic_fraction": "sc:Float", "rig": "sc:Text", "samples": "sc:Integer",
        "samples_by_stream": "sc:Text", "weather_parameters": "sc:Text", "size_bytes": "sc:Integer",
        "sha256": "sc:Text",
    },
}  # fmt: skip


def croissant(
    *, name: str, description: str, url: str, cite_as: str, date: str, sha256: Mapping[str, str], seeds: str
) -> dict[str, Any]:
    """The metadata as JSON-LD.

    Args:
        name: Name of the dataset.
        description: What it is, a paragraph.
        url: Where it will lie.
        cite_as: BibTeX.
        date: Day of publication, ISO 8601.
        sha256: Checksums of the files that are listed one by one, by their paths; the tables among them.
        seeds: What the drives come from, for provenance.
    """
    files = [_file(path, digest) for path, digest in sorted(sha256.items())]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": [
            "http://mlcommons.org/croissant/1.1",
            "http://mlcommons.org/croissant/RAI/1.0",
        ],
        "name": name,
        "description": description,
        "license": LICENSE,
        "url": url,
        "version": "1.0.0",
        "datePublished": date,
        "creator": {"@type": "Organization", "name": "The CarlaLoc authors"},
        "citeAs": cite_as,
        "isLiveDataset": False,
        "keywords": ["SLAM", "visual-inertial odometry", "LiDAR", "event camera", "synthetic", "driving"],
        "prov:wasGeneratedBy": f"CarlaLoc, by simulation; {seeds}",
        "rai:dataCollection": "Simulated. A driver (a program, or a person at a wheel) drives once through "
        "each town; sensors look at the recorded motion under every weather and traffic level.",
        "rai:dataCollectionType": "Synthetic data",
        "rai:dataUseCases": "Evaluation of odometry, SLAM, depth, segmentation and event vision under "
        "weather and traffic with identical ego motion.",
        "rai:dataLimitations": "Scenes, weather, sensors and traffic are models; scores on them do not carry "
        "over to real roads without a check there.",
        "rai:dataBiases": "Seven towns of one style; traffic keeps to the right.",
        "rai:personalSensitiveInformation": "None: nobody in it exists.",
        "distribution": files,
        "recordSet": [_records("trajectories", TRAJECTORIES), _records("conditions", CONDITIONS)],
    }


def _file(path: str, digest: str) -> dict[str, Any]:
    kinds = {
        "parquet": "application/x-parquet", "yaml": "application/yaml", "mcap": "application/x-mcap",
        "tar": "application/x-tar", "mp4": "video/mp4", "png": "image/png", "csv": "text/csv",
        "h5": "application/x-hdf5", "json": "application/json",
    }  # fmt: skip
    return {
        "@type": "cr:FileObject",
        "@id": path,
        "name": path.replace("/", "-"),
        "contentUrl": path,
        "encodingFormat": kinds.get(path.rsplit(".", 1)[-1], "application/octet-stream"),
        "sha256": digest,
    }


def _records(name: str, path: str) -> dict[str, Any]:
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"{name}/{column}",
            "name": column,
            "dataType": kind,
            "source": {"fileObject": {"@id": path}, "extract": {"column": column}},
        }
        for column, kind in _FIELDS[name].items()
    ]
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "field": fields}
