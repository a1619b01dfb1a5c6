"""Signs and billboards along roads.

Traffic signs on posts, with faces from the SIGN atlas.

Direction signs of motorways: boards on the verge, on cantilevers, and countdown markers.

Foot at the origin, z up, faces along +x, towards those who come. Sizes follow the German rules for motorway
signs (RWBA 2000) and the catalogue of traffic signs (Zeichen 450).

Billboards of the wayside, with a picture on both faces.
"""

import hashlib
import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.posts_and_fences import POST
from carlaloc_env.assets.primitives import Look, box, circle, panel, placed, quad, surface, tube
from carlaloc_env.assets.texture_atlas import STREET_NAMES, SignCell, atlas_uv, cell_corners, street_name_uv
from carlaloc_env.core import elementary
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

_FACE = Look(Material.SIGN, Tag.TRAFFIC_SIGN)
SIGN_BACK = Look(Material.METAL_GALVANISED, Tag.TRAFFIC_SIGN, (200, 200, 200))
"""Backs and rims of signs."""

SIGNS: dict[str, tuple[SignCell, str, float, float]] = {
    "stop": (SignCell.STOP, "octagon", 0.75, 0.75),
    "yield": (SignCell.YIELD, "triangle", 0.90, 0.80),
    "speed_30": (SignCell.SPEED_30, "rectangle", 0.61, 0.76),
    "speed_40": (SignCell.SPEED_40, "rectangle", 0.61, 0.76),
    "speed_50": (SignCell.SPEED_50, "rectangle", 0.61, 0.76),
    "speed_60": (SignCell.SPEED_60, "rectangle", 0.61, 0.76),
    "speed_90": (SignCell.SPEED_90, "rectangle", 0.61, 0.76),
    "no_entry": (SignCell.NO_ENTRY, "circle", 0.70, 0.70),
    "one_way": (SignCell.ONE_WAY, "rectangle", 0.90, 0.30),
    "crossing": (SignCell.CROSSING, "diamond", 0.85, 0.85),
    "parking": (SignCell.PARKING, "rectangle", 0.45, 0.60),
    "bus_stop": (SignCell.BUS_STOP, "rectangle", 0.45, 0.60),
}
"""Cell, outline, width [m] and height [m] of each sign face."""


def sign(kind: str, text: str | None = None) -> Mesh:
    """Sign on a post, foot at the origin, face along +x.

    Args:
        kind: A key of `SIGNS`, ``speed`` with the number as text, or ``street_name``.
        text: Number of a speed sign, or a street name, which chooses one of `STREET_NAMES`.

    Raises:
        ConfigError: no sign of this kind exists.
    """
    if kind == "street_name":
        return _street_name(text or "")
    if kind == "speed":
        limits = np.array([30, 40, 50, 60, 90])
        value = float(text) if text else 50.0
        kind = f"speed_{limits[int(np.argmin(np.abs(limits - value)))]}"
    if kind not in SIGNS:
        raise ConfigError(unknown_name("sign", kind, (*SIGNS, "speed", "street_name")))
    cell, outline, width, height = SIGNS[kind]
    bottom = 2.1
    post = tube(POST, [(0, 0, 0), (0, 0, bottom + height)], 0.03, 8)
    face = board(outline, width, height, cell_corners(atlas_uv(Material.SIGN, cell)))
    return merge([post, placed(face, (0.045, 0.0, bottom + 0.5 * height))])


def board(outline: str, width_m: float, height_m: float, uv_corners: NDArray[np.float64]) -> Mesh:
    """Sign plate centred on the origin, face along +x, grey behind.

    Args:
        outline: ``octagon``, ``triangle``, ``circle``, ``diamond`` or ``rectangle``.
        width_m: Width [m].
        height_m: Height [m].
        uv_corners: Texture coordinates of the enclosing rectangle's corners [m], shape (4, 2).
    """
    flat = _outline(outline)
    count = len(flat)
    low, span = uv_corners[0], uv_corners[2] - uv_corners[0]
    uv = low + (flat + 0.5) * span
    rim = np.stack([np.zeros(count), flat[:, 0] * width_m, flat[:, 1] * height_m], axis=-1)
    k = np.arange(1, count - 1)
    fan = np.stack([np.zeros_like(k), k, k + 1], axis=-1)
    half = np.array([0.006, 0.0, 0.0])
    front = surface(_FACE, rim + half, fan, uv, 10.0)
    back = surface(SIGN_BACK, rim - half, fan[:, ::-1], rim[:, 1:], 10.0)
    near, far = np.arange(count), np.arange(count) + count
    near_next, far_next = np.roll(near, -1), np.roll(far, -1)
    edge = np.concatenate([np.stack([far, far_next, near_next], -1), np.stack([far, near_next, near], -1)])
    both = np.concatenate([rim + half, rim - half])
    return merge([front, back, surface(SIGN_BACK, both, edge, both[:, 1:], 30.0)])


def _outline(name: str) -> NDArray[np.float64]:
    """Outline in (y, z), anticlockwise seen from +x, inside the square ±0.5."""
    if name == "octagon":
        angle = np.pi / 8 + np.pi / 4 * np.arange(8)
        corners = np.stack([elementary.cos(angle), elementary.sin(angle)], axis=-1)
        return np.asarray(0.5 / elementary.cos(np.pi / 8) * corners)
    if name == "circle":
        return 0.5 * circle(20)
    shapes = {
        "triangle": [(0.0, -0.5), (0.5, 0.5), (-0.5, 0.5)],
        "diamond": [(0.0, -0.5), (0.5, 0.0), (0.0, 0.5), (-0.5, 0.0)],
        "rectangle": [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)],
    }
    return np.array(shapes[name], dtype=np.float64)


def _street_name(text: str) -> Mesh:
    """Two name plates at right angles on a post."""
    first = STREET_NAMES.index(text) if text in STREET_NAMES else hashlib.blake2b(text.encode()).digest()[0]
    parts = [tube(POST, [(0, 0, 0), (0, 0, 3.0)], 0.035, 8), box(SIGN_BACK, (0.05, 0.05, 0.04), (0, 0, 3.02))]
    for step, turn in ((0, 0.0), (3, 0.5 * np.pi)):
        corners = cell_corners(street_name_uv(first + step))
        for flip in (0.0, np.pi):
            plate = board("rectangle", 0.96, 0.24, corners)
            yaw = turn + flip
            spot = (0.02 * elementary.cos(yaw), 0.02 * elementary.sin(yaw), 2.60 + 0.28 * (step > 0))
            parts.append(placed(plate, spot, yaw))
    return merge(parts)


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


def billboard(
    picture: int = 0, *, width_m: float = 7.2, height_m: float = 3.6, bottom_m: float = 3.4
) -> Mesh:
    """Board on two posts with a catwalk and lamps, facing +x; the back shows the next picture.

    Args:
        picture: Cell of `Material.BILLBOARD`, any whole number.
        width_m: Width of the picture [m].
        height_m: Height of the picture [m].
        bottom_m: Height of its lower edge [m].
    """
    steel = Look(Material.METAL_GALVANISED, Tag.STATIC, (190, 190, 190))
    dark = Look(Material.METAL_PAINTED, Tag.STATIC, (36, 40, 42))
    frame = Look(Material.METAL_PAINTED, Tag.STATIC, (60, 64, 60))
    middle = bottom_m + 0.5 * height_m
    parts = [
        tube(steel, [(0.0, y, -0.4), (0.0, y, bottom_m + height_m - 0.2)], 0.16, 8)
        for y in (-0.27 * width_m, 0.27 * width_m)
    ]
    w, h = 0.5 * width_m, 0.5 * height_m
    corners = [(0.0, -w, -h), (0.0, w, -h), (0.0, w, h), (0.0, -w, h)]
    for turn, cell in ((0.0, picture), (np.pi, picture + 3)):
        uv = cell_corners(atlas_uv(Material.BILLBOARD, cell))
        board = panel(Look(Material.BILLBOARD, Tag.STATIC), corners, uv, 0.06, frame)
        spot = (0.24 * elementary.cos(turn), 0.0, middle)
        parts += [placed(mesh, spot, turn) for mesh in board]
    for z in (bottom_m - 0.07, bottom_m + height_m + 0.07):
        parts.append(box(frame, (0.56, width_m + 0.3, 0.14), (0.0, 0.0, z)))
    for y in (-w - 0.07, w + 0.07):
        parts.append(box(frame, (0.56, 0.14, height_m), (0.0, y, middle)))
    parts.append(box(dark, (0.7, width_m, 0.05), (0.62, 0.0, bottom_m - 0.25)))
    for y in (-0.5 * w, 0.5 * w):
        parts.append(tube(dark, [(0.2, y, bottom_m - 0.2), (1.1, y, bottom_m - 0.1)], 0.03, 5))
        parts.append(box(dark, (0.22, 0.5, 0.12), (1.1, y, bottom_m - 0.05)))
    return merge(parts)
