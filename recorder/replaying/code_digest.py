"""Digest of all code that makes a dataset: a run resumes only work of the same code."""

from __future__ import annotations

import functools
import hashlib
import sys
from pathlib import Path

import carlaloc_env
import recorder
from carlaloc_env.core.files.library_versions import library_version
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.registry import SENSOR_KINDS
from recorder.dataset.manifest import VERSIONED

_SUFFIXES = (".py", ".glsl", ".vert", ".frag", ".jinja")


@functools.cache
def code_digest() -> str:
    """SHA-256 of the sources of both packages and of the versions of libraries that shape a dataset."""
    digest = hashlib.sha256()
    for package in (carlaloc_env, recorder):
        folder = Path(str(package.__file__)).parent
        for path in sorted(path for path in folder.rglob("*") if path.suffix in _SUFFIXES):
            digest.update(f"{path.relative_to(folder)}\n".encode())
            digest.update(path.read_bytes())
    for name in VERSIONED:
        digest.update(f"{name} {library_version(name)}\n".encode())
    return digest.hexdigest()


def own_code_digest(rig: SensorRig, topics: str) -> str:
    """SHA-256 of the files of a user's own sensors and topics; empty: there are none."""
    own = {type(sensor) for sensor in rig.sensors} - set(SENSOR_KINDS.values())
    files = {str(sys.modules[kind.__module__].__file__) for kind in own}
    if ".py:" in topics:
        files.add(topics.rpartition(":")[0])
    return " ".join(hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in sorted(files))
