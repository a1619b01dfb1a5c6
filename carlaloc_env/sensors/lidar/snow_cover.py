"""Ground under snow, as LiDARs see it: white where snow lies, bare in wheel tracks and under bridges."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.raycast import Hits
from carlaloc_env.road.wheel_tracks import CLEARANCE_M, TRACK_HALF_M, TRACK_M, WheelTracks
from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scene.mottle import value_noise
from carlaloc_env.weather.snow_patches import COARSE_PER_M, COARSE_SHARE, FINE_PER_M, FINE_SHIFT, least_patch

SNOW_REFLECTANCE = 0.80
"""Reflectance of snow at 905 nm: nearly 1 in the visible when fresh, less from 800 nm on (O'Brien and Munis,
"Red and near-infrared spectral reflectance of snow", 1975), and less again of old snow."""
_TONE = SNOW_REFLECTANCE / MATERIALS[Material.PLAIN].reflectance
_ON_ROAD_M = 0.4
"""Height above a lane within which something is its surface [m]."""


def under_snow(
    hits: Hits, rows: NDArray[np.intp], points_m: Array, tracks: WheelTracks, snow_cover: float
) -> Hits:
    """Hits with snow for a surface where it lies; what they are, where and how steep stays.

    Args:
        hits: What rays meet.
        rows: Hits of the ground, shape (M,).
        points_m: Where they are in the world [m], shape (M, 3).
        tracks: Wheel tracks of the lanes.
        snow_cover: Share of open level ground under snow, 0–1.
    """
    white = np.empty(len(rows), np.bool_)
    _covered(points_m, *tracks.at(points_m), least_patch(snow_cover), white)
    snowy = hits.take(np.arange(len(hits)))
    snowy.material[rows[white]] = Material.PLAIN
    snowy.tone[rows[white]] = _TONE
    return snowy


@compiled
def _covered(points_m: Array, away_m: F32, above_m: F32, least: float, out: NDArray[np.bool_]) -> None:
    """Whether snow lies at places; see the block SNOW of ``shade.frag``."""
    for i in range(len(points_m)):
        x, y = points_m[i, 0], points_m[i, 1]
        patch = COARSE_SHARE * value_noise(COARSE_PER_M * x, COARSE_PER_M * y)
        patch += (1.0 - COARSE_SHARE) * value_noise(FINE_PER_M * x + FINE_SHIFT, FINE_PER_M * y + FINE_SHIFT)
        ragged_m = abs(away_m[i] - TRACK_M) + 0.3 * (patch - 0.5)
        bare = abs(above_m[i]) < _ON_ROAD_M and ragged_m < TRACK_HALF_M
        out[i] = patch > least and not bare and above_m[i] > -CLEARANCE_M
