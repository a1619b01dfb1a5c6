"""The rack on the ego's roof that carries its sensors, as LiDARs see it; pictures do not show it."""

from carlaloc_env.assets.primitives import Look, box
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

_BAR_M, _RAIL_M, _GAP_M = (0.08, 0.03), (0.04, 0.03), 0.06
"""Widths and heights of cross bars, as of common load carriers, and of rails; space below them [m]."""
_REAR_M, _FRONT_M, _HALF_WIDTH_M = 0.35, 1.80, 0.55
"""Ends of the rack along x and the middle of its rails along y of `base_link` [m]."""
_CROSS_BARS_M = (0.40, 0.75, 1.70)
"""Places of the cross bars along x [m]; the last one carries the cameras above the windscreen."""
_CAMERA_M, _ANTENNA_M = (0.08, 0.06, 0.06), (0.12, 0.12, 0.04)
"""Sizes of a camera's and of the GNSS antenna's housing [m]."""


def roof_rack() -> Mesh:
    """Rails, cross bars, two cameras and an antenna, in the `base_link` frame."""
    bar, case = Look(Material.METAL_PAINTED, Tag.CAR), Look(Material.PLASTIC, Tag.CAR)
    middle_m = EGO_SIZE_M[2] + _GAP_M + 0.5 * _BAR_M[1]
    top_m, length_m = middle_m + 0.5 * _BAR_M[1], _FRONT_M - _REAR_M
    parts = [
        box(bar, (length_m, *_RAIL_M), (_REAR_M + 0.5 * length_m, side * _HALF_WIDTH_M, middle_m))
        for side in (1.0, -1.0)
    ]
    across_m = _BAR_M[0], 2.0 * _HALF_WIDTH_M, _BAR_M[1]
    parts += [box(bar, across_m, (x, 0.0, middle_m)) for x in _CROSS_BARS_M]
    parts += [box(case, _CAMERA_M, (1.75, y, top_m + 0.5 * _CAMERA_M[2])) for y in (0.2, -0.2)]
    parts.append(box(case, _ANTENNA_M, (0.70, 0.0, top_m + 0.5 * _ANTENNA_M[2])))
    return merge(parts)
