"""Patches of snow on level ground, the same for cameras and LiDARs: where a pattern of the world is high."""

import numpy as np

COARSE_PER_M, COARSE_SHARE = 0.31, 0.65
"""Frequency of the pattern's wide layer [1/m], and its share."""
FINE_PER_M, FINE_SHIFT = 1.3, 7.7
"""Frequency of its fine layer [1/m], and by how much that is moved."""
_SHARES = (0.0, 0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.98, 1.0)
_LEVELS = (1.2, 0.812, 0.709, 0.642, 0.590, 0.543, 0.5, 0.456, 0.410, 0.358, 0.290, 0.188, -0.2)
"""Values that the pattern exceeds on those shares of the ground, counted at two million places."""


def least_patch(snow_cover: float) -> float:
    """Value of the pattern above which snow lies, for a share of the ground 0–1."""
    return float(np.interp(snow_cover, _SHARES, _LEVELS))
