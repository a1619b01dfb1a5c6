"""Arrays that processes share: views of a file of the cache, whose pages are in memory once for all."""

from carlaloc_env.core.files.array_cache import cached
from carlaloc_env.core.files.array_files import Arrays, arrays_hash

SHARED_FROM_BYTES = 1 << 20
"""Smaller arrays have memory of their own."""


def read_only(arrays: Arrays) -> Arrays:
    """Views to which nobody can write, as to those of a file, so that one compiled function takes both."""
    views = {name: value.view() for name, value in arrays.items()}
    for value in views.values():
        value.setflags(write=False)
    return views


def in_shared_memory(arrays: Arrays, name: str, kind: str, *, module: str, kept_files: int) -> Arrays:
    """The same arrays, read-only, in a file of the cache if they are large.

    What nobody reads need not be in memory at all.

    Args:
        arrays: Arrays by name.
        name: Beginning of the file's name.
        kind: Its suffix without the dot.
        module: Module that made them.
        kept_files: Files of this name that are kept.
    """
    views = read_only(arrays)
    if sum(value.nbytes for value in views.values()) < SHARED_FROM_BYTES:
        return views
    return cached(
        name,
        kind,
        module=module,
        make=lambda: views,
        to_arrays=lambda made: made,
        from_arrays=lambda stored: {name: stored[name] for name in views},
        content=arrays_hash(views),
        kept_files=kept_files,
    )
