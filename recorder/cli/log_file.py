"""A log file beside what a command shows."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def logged_to(path: Path, name: str) -> Iterator[None]:
    """Append what a logger is told, from INFO on, to a file; who sees it elsewhere sees no more than before.

    Args:
        path: The file.
        name: Name of the logger.
    """
    logger = logging.getLogger(name)
    file = logging.FileHandler(path, encoding="utf-8")
    file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    file.setLevel(logging.INFO)
    before, shown = logger.level, logger.getEffectiveLevel()
    others = [(handler, handler.level) for handler in logging.getLogger().handlers]
    for handler, level in others:
        handler.setLevel(max(level, shown))
    logger.addHandler(file)
    logger.setLevel(min(logging.INFO, shown))
    try:
        yield
    finally:
        logger.setLevel(before)
        logger.removeHandler(file)
        file.close()
        for handler, level in others:
            handler.setLevel(level)
