"""A log file beside what a command shows."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def logged_to(path: Path, name: str) -> Iterator[None]:
    """Append a logger's messages, from INFO on, to a file.

    Args:
        path: The file.
        name: Name of the logger.
    """
    logger = logging.getLogger(name)
    file = logging.FileHandler(path, encoding="utf-8")
    file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    file.setLevel(logging.INFO)
    logger.addHandler(file)
    try:
        yield
    finally:
        logger.removeHandler(file)
        file.close()
