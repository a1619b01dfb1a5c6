"""Traffic signs on posts, with faces from the SIGN atlas."""

import hashlib

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.posts_and_fences import POST
from carlaloc_env.assets.primitives import Look, box, circle, placed, surface, tube
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
