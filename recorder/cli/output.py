"""Output of commands: streams that take any character, announcements, log files, results as JSON."""

import csv
import json
import logging
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.files.atomic_files import atomic_write


def make_streams_safe() -> None:
    """Give closed streams a place, and let "?" stand for characters that a stream does not take.

    The next file that is opened would else get the number of a closed stream, and all that is printed. Output
    of a closed stdout fails, so that its loss is reported; that of a closed stderr is dropped.
    """
    for number, mode in enumerate((os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")


def announced(cost: object) -> None:
    """Write size and time of long work before it begins."""
    print(cost, file=sys.stderr, flush=True)


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


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]], *, digits: int) -> None:
    """Write a table of all columns that rows have (.csv), floats with so many digits."""
    columns = dict.fromkeys(name for row in rows for name in row)
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns))
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.{digits}g}" if isinstance(v, float) else v for k, v in row.items()})


def to_json(result: Mapping[str, Any]) -> str:
    """JSON text of a result; numbers that are not finite become null."""
    return json.dumps(_plain(result), indent=2, allow_nan=False, ensure_ascii=True)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)
