"""Counter-based randomness: one stream per (seed, name, stamp).

A number depends on nothing but its key, so neither the order of sampling, nor parallel workers,
nor a further sensor changes the noise of a sensor (Salmon et al., "Parallel random numbers: as
easy as 1, 2, 3", SC 2011: Philox).
"""

from __future__ import annotations

import hashlib

import numpy as np

_WORD = (1 << 64) - 1
"""64 bits."""


def stream(seed: int, name: str, stamp_ns: int = 0, index: int = 0) -> np.random.Generator:
    """Generator of one stream, the same on every machine and in every order of calls.

    Args:
        seed: The one seed of an episode or a replay.
        name: Name of what draws, e.g. ``"lidar/range"``.
        stamp_ns: Stamp of the sample the numbers are for [ns]; may be negative.
        index: Further counter, e.g. a block or an actor.
    """
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest()
    key = np.frombuffer(digest, dtype="<u8").astype(np.uint64)
    counter = np.array([0, 0, index & _WORD, stamp_ns & _WORD], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))
