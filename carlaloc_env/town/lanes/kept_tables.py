"""Samples of lanes kept on disk: making them takes a sixth of loading a town."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from carlaloc_env.core.files.array_cache import Arrays, cached
from carlaloc_env.town.lanes.centre_lines import KeepTables, LaneTables


def kept_tables(
    name: str, *, module: str, content: str, kept_files: int, folder: Path | None = None
) -> KeepTables:
    """What gives a town's tables, from the cache when the same code made them of the same content before.

    Args:
        name: Name of the town.
        module: Module that says on which relief lanes lie; a change in its imports outdates the file.
        content: Hash of its map and of what shapes its relief.
        kept_files: Files that are kept of this town.
        folder: Where files lie; the default cache when left out.
    """
    return lambda make: cached(
        name,
        "lanes",
        module=module,
        make=make,
        to_arrays=_to_arrays,
        from_arrays=_from_arrays,
        content=content,
        kept_files=kept_files,
        folder=folder,
    )


def _to_arrays(tables: LaneTables) -> Arrays:
    return {field.name: getattr(tables, field.name) for field in fields(LaneTables)}


def _from_arrays(arrays: Arrays) -> LaneTables:
    # Copies: compiled functions take arrays of a file, which nobody can write to, for another type.
    return LaneTables(**{field.name: arrays[field.name].copy() for field in fields(LaneTables)})
