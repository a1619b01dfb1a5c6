"""How much slower than the reference machine this one is, remembered from its last replay."""

import json
import time
import zlib
from contextlib import suppress

import numpy as np

from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.array_cache import default_cache_dir
from carlaloc_env.core.files.atomic_files import atomic_write

FILE = "machine.json"
"""Name of the file in the cache's folder."""
LARGEST = 10.0
"""Factors beyond this one, or below its inverse, are no machine's."""
_WORK_BYTES, REFERENCE_S = 4_000_000, 0.1
"""Size of random bytes, and the CPU time in which the reference machine packs them [s]."""


def measured_slowness() -> float:
    """CPU time of a fixed work now over that of the reference machine; in plain C, alike on processors."""
    work = np.random.default_rng(0).bytes(_WORK_BYTES)
    began_s = time.process_time()
    zlib.compress(work)
    return (time.process_time() - began_s) / REFERENCE_S


def slowness() -> float:
    """CPU time of this machine over that of the reference machine; 1 before its first replay."""
    try:
        factor = float(json.loads((default_cache_dir() / FILE).read_text(encoding="utf-8"))["slowness"])
    except (OSError, ValueError, KeyError, TypeError):
        return 1.0
    return factor if 1.0 / LARGEST <= factor <= LARGEST else 1.0


def remember_slowness(factor: float) -> None:
    """Keep the factor for the next replay; a cache that cannot be written is left as it is."""
    with suppress(OutputError), atomic_write(default_cache_dir() / FILE) as part:
        part.write_text(json.dumps({"slowness": factor}), encoding="utf-8")
