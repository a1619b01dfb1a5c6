"""PyBullet, imported without the line that it prints; all modules of this package take it from here."""

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

__all__ = ["pybullet"]
_BANNER = b"pybullet build time"


@contextmanager
def _without_banner(descriptor: int) -> Iterator[None]:
    """Leave PyBullet's line out of what is written to standard output (1) or error (2).

    C code writes it, so that Python's own redirection does not help. All else is passed on.
    """
    try:
        kept = os.dup(descriptor)
    except OSError:
        yield  # it is closed: the line is lost anyway
        return
    with tempfile.TemporaryFile() as caught:
        _flush()
        os.dup2(caught.fileno(), descriptor)
        try:
            yield
        finally:
            _flush()
            os.dup2(kept, descriptor)
            os.close(kept)
            caught.seek(0)
            _write(descriptor, b"".join(line for line in caught if not line.startswith(_BANNER)))


def _flush() -> None:
    """Empty Python's buffers, and C's, of which Python knows nothing."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    ctypes.CDLL("ucrtbase" if os.name == "nt" else None).fflush(None)


def _write(descriptor: int, content: bytes) -> None:
    while content:
        content = content[os.write(descriptor, content) :]


with _without_banner(1), _without_banner(2):
    pybullet: Any = import_module("pybullet")
    """The module."""
