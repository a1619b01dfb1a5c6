"""Direction signs of motorways: boards on the verge, on cantilevers, and countdown markers.

Foot at the origin, z up, faces along +x, towards those who come. Sizes follow the German rules for motorway
signs (RWBA 2000) and the catalogue of traffic signs (Zeichen 450).
"""

import math

import numpy as np

from carlaloc_env.assets.primitives import Look, box, placed, quad, tube
from carlaloc_env.assets.signs import SIGN_BACK, board
from carlaloc_env.assets.texture_atlas import cell_corners, street_name_uv
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

BOARD_M = (4.4, 2.9)
"""Width and height of a direction board [m]."""
VERGE_BOTTOM_M = 1.5
"""Height of the lower edge of boards on the verge [m]."""
CLEAR_M = 5.7
"""Free height under what hangs over a road [m]."""
MARKER_M = (0.75, 1.5)
"""Width and height of a countdown marker [m]."""
_MAST_STEEL = Look(Material.METAL_GALVANISED, Tag.POLE, (195, 198, 200))
_RIM_WHITE = Look(Material.SIGN, Tag.TRAFFIC_SIGN, (235, 235, 232))
_GREEN = Look(Material.METAL_PAINTED, Tag.TRAFFIC_SIGN, (2, 46, 22))
_BLUE = Look(Material.METAL_PAINTED, Tag.TRAFFIC_SIGN, (4, 28, 92))
_PAINT = Look(Material.METAL_PAINTED, Tag.TRAFFIC_SIGN, (225, 225, 222))


def direction_board(*names: int, width_m: float = BOARD_M[0]) -> Mesh:
    """Names below each other over a white rim, face along +x, centred on the origin.

    Args:
        names: Rows of `STREET_NAMES`, from the top down.
        width_m: Width [m]; rows keep the proportions of half a `BOARD_M`.
    """
    row = BOARD_M[1] / 2 * width_m / BOARD_M[0]
    height = row * len(names)
    parts = [
        box(SIGN_BACK, (0.06, width_m, height), (-0.002, 0.0, 0.0)),
        quad(_RIM_WHITE, _face(width_m, height, 0.029)),
        quad(_GREEN, _face(width_m - 0.12, height - 0.12, 0.032)),
    ]
    for k, index in enumerate(names):
        plate = board("rectangle", width_m - 0.5, 0.72 * row, cell_corners(street_name_uv(index)))
        parts.append(placed(plate, (0.042, 0.0, 0.5 * height - (k + 0.5) * row)))
    return merge(parts)


def verge_sign(*names: int, width_m: float = BOARD_M[0]) -> Mesh:
    """Board on two posts beside the road."""
    face = direction_board(*names, width_m=width_m)
    top = VERGE_BOTTOM_M + float(np.ptp(face.vertices_m[:, 2]))
    middle = (0.0, 0.0, 0.5 * (VERGE_BOTTOM_M + top))
    posts = [
        tube(_MAST_STEEL, [(-0.13, y, -0.4), (-0.13, y, top - 0.1)], 0.07, 8)
        for y in (-0.32 * width_m, 0.32 * width_m)
    ]
    heights = (VERGE_BOTTOM_M + share * (top - VERGE_BOTTOM_M) for share in (0.2, 0.8))
    rails = [box(_MAST_STEEL, (0.05, 0.94 * width_m, 0.08), (-0.055, 0.0, z)) for z in heights]
    return merge([placed(face, middle), *posts, *rails])


def cantilever(reach_m: float, first: int, second: int, third: int, low_m: float = 0.0) -> Mesh:
    """Post beside the road with an arm over its lanes and two boards.

    Args:
        reach_m: How far the arm reaches along −y, over the road in right-hand traffic [m]; below 0 along +y.
        first: Row of `STREET_NAMES` on the board of the through lanes.
        second: Row on the board at the post, where the exit is.
        third: The row below it.
        low_m: Height of the road above the post's foot [m].
    """
    z = low_m + CLEAR_M
    parts = [
        tube(_MAST_STEEL, [(-0.25, 0.0, -0.4), (-0.25, 0.0, z + 1.9)], [0.3, 0.22], 12),
        box(_MAST_STEEL, (0.8, 0.8, 0.16), (-0.25, 0.0, 0.08)),
    ]
    for dz in (0.4, 1.6):
        parts.append(box(_MAST_STEEL, (0.18, abs(reach_m), 0.18), (-0.25, -0.5 * reach_m, z + dz)))
    bay = math.copysign(1.3, reach_m)
    for k in range(int(abs(reach_m) / 1.3)):
        ends = (z + 0.4, z + 1.6) if k % 2 else (z + 1.6, z + 0.4)
        line = [(-0.25, -bay * k, ends[0]), (-0.25, -bay * (k + 1), ends[1])]
        parts.append(tube(_MAST_STEEL, line, 0.05, 5, caps=False))
    near, far = 0.32 * reach_m, 0.78 * reach_m
    width = min(BOARD_M[0], 0.44 * abs(reach_m))
    for names, y in (((second, third), near), ((first,), far)):
        parts.append(placed(direction_board(*names, width_m=width), (-0.08, -y, z + 1.0)))
    return merge(parts)


def countdown_marker(stripes: int) -> Mesh:
    """Blue board with a white slant stripe for every 100 m that are left."""
    width, height = MARKER_M
    middle = 0.9 + 0.5 * height
    parts = [
        box(SIGN_BACK, (0.03, width, height), (0.0, 0.0, middle)),
        quad(_PAINT, _face(width, height, 0.0165) + np.array([0.0, 0.0, middle])),
        quad(_BLUE, _face(width - 0.06, height - 0.06, 0.0175) + np.array([0.0, 0.0, middle])),
        tube(_MAST_STEEL, [(-0.06, 0.0, -0.3), (-0.06, 0.0, 0.9 + height)], 0.04, 8),
    ]
    half = 0.5 * width - 0.03
    for k in range(stripes):
        low = middle + 0.38 * (k - 0.5 * (stripes - 1)) - 0.22
        corners = [(-half, low), (half, low + 0.3), (half, low + 0.44), (-half, low + 0.14)]
        parts.append(quad(_PAINT, [(0.0185, y, z) for y, z in corners]))
    return merge(parts)


def _face(width_m: float, height_m: float, x_m: float) -> np.ndarray:
    """Corners of an upright rectangle that faces +x, centred on the x axis."""
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.column_stack([np.full(4, x_m), 0.5 * signs * (width_m, height_m)])
