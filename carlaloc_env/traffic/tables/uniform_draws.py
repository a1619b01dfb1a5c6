"""Uniform draws for compiled functions: a hash of what is decided, the same on every machine."""

import numpy as np

from carlaloc_env.core.jit import compiled

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
"""2⁶⁴ over the golden ratio: SplitMix64's increment."""
_MIX_A = np.uint64(0xBF58476D1CE4E5B9)
"""First multiplier of SplitMix64's finaliser."""
_MIX_B = np.uint64(0x94D049BB133111EB)
"""Second multiplier of SplitMix64's finaliser."""
_ONE_53 = 1.0 / 9007199254740992.0
"""2⁻⁵³: makes 53 random bits a number in [0, 1)."""


@compiled
def _mixed(x: np.uint64) -> np.uint64:
    """SplitMix64's finaliser of 64 bits."""
    x = (x ^ (x >> np.uint64(30))) * _MIX_A
    x = (x ^ (x >> np.uint64(27))) * _MIX_B
    return x ^ (x >> np.uint64(31))


@compiled
def hash_uniform(seed: int, purpose: int, entity: int, counter: int) -> float:
    """Uniform draw in [0, 1), the same for the same seed, purpose, entity and counter.

    SplitMix64's finaliser over the arguments (Steele, Lea & Flood, "Fast splittable pseudorandom
    number generators", OOPSLA 2014).
    """
    x = _mixed(np.uint64(seed) + _GOLDEN)
    x = _mixed(x ^ np.uint64(purpose) * _GOLDEN)
    x = _mixed(x ^ np.uint64(entity) * _GOLDEN)
    x = _mixed(x ^ np.uint64(counter) * _GOLDEN)
    return float(x >> np.uint64(11)) * _ONE_53


@compiled
def happens(probability: float, seed: int, purpose: int, entity: int, counter: int) -> bool:
    """Whether something of a probability happens, by the draw of `hash_uniform`."""
    return probability > 0.0 and hash_uniform(seed, purpose, entity, counter) < probability
