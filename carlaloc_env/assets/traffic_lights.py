"""Traffic lights on posts and mast arms; foot at the origin, heads face along +x."""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.posts_and_fences import POST
from carlaloc_env.assets.primitives import Look, box, disc, lathe, placed, pose, rings, tube
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

_CASE = Look(Material.METAL_PAINTED, Tag.TRAFFIC_LIGHT, (10, 11, 10))
_HEAD_YELLOW = Look(Material.METAL_PAINTED, Tag.TRAFFIC_LIGHT, (190, 120, 10))
_DARK_LENSES = tuple(
    Look(Material.PLASTIC, Tag.TRAFFIC_LIGHT, tint) for tint in ((44, 4, 4), (48, 26, 2), (3, 26, 12))
)
HEAD_M = (0.20, 0.36, 1.07)
"""Depth, width, height of a three-lens head [m]."""
_POST_BOTTOM_M = 2.5
"""Height of the lower edge of heads on a post [m]."""


def traffic_light(head_count: int, arm_m: float) -> tuple[Mesh, NDArray[np.float64]]:
    """Traffic light with its foot at the origin; its heads face along +x, towards the traffic.

    Args:
        head_count: Heads with three lenses each.
        arm_m: Length of a mast arm along −y, over the road in right-hand traffic [m]; below 0 along +y, as in
            left-hand traffic; 0 = post only.

    Returns:
        The mesh with dark lenses, and the lens poses (head, lens, 4, 4): lenses red, yellow, green
        (state = lens + 1), x out of the lens.
    """
    if arm_m:
        on_arm = max(head_count - 1, 1)
        spots = [(0.0, math.copysign(1.0, arm_m) * (-abs(arm_m) + 0.35 + 3.2 * k)) for k in range(on_arm)]
        bottoms = [5.2] * on_arm
        if head_count > 1:
            spots.append((0.24, 0.0))
            bottoms.append(_POST_BOTTOM_M)
        parts = _mast(6.6, 5.9, arm_m)
    else:
        spots = [(0.22, 0.30 * (k - 0.5 * (head_count - 1)) * 1.8) for k in range(head_count)]
        bottoms = [_POST_BOTTOM_M] * head_count
        parts = [
            tube(POST, [(0, 0, 0), (0, 0, _POST_BOTTOM_M + HEAD_M[2] + 0.1)], [0.075, 0.06], 10),
            _foot(0.16),
        ]
    poses = []
    for (x, y), bottom in zip(spots, bottoms, strict=True):
        parts.append(placed(_head(), (x, y, bottom)))
        parts.append(box(_CASE, (max(x, 0.1), 0.06, 0.05), (0.5 * x - 0.05, y, bottom + 0.75 * HEAD_M[2])))
        heights = bottom + HEAD_M[2] * np.array([5, 3, 1]) / 6
        poses.append([pose((x + 0.5 * HEAD_M[0] + 0.004, y, z)) for z in heights])
    return merge(parts), np.array(poses)


@functools.cache
def _head() -> Mesh:
    """Case, backplate, visors and dark lenses, lower edge at z = 0, centred on x, y."""
    depth, width, height = HEAD_M
    plate = Look(Material.METAL_PAINTED, Tag.TRAFFIC_LIGHT, (8, 8, 8))
    border = Look(Material.SIGN, Tag.TRAFFIC_LIGHT, (190, 120, 10))
    parts = [
        box(_HEAD_YELLOW, (depth, width, height), (0.0, 0.0, 0.5 * height)),
        box(_CASE, (0.004, width - 0.02, height - 0.02), (0.5 * depth, 0.0, 0.5 * height)),
        box(plate, (0.012, width + 0.26, height + 0.26), (-0.02, 0.0, 0.5 * height)),
    ]
    for y in (-0.5 * width - 0.13, 0.5 * width + 0.13):
        parts.append(box(border, (0.016, 0.03, height + 0.26), (-0.02, y, 0.5 * height)))
    for k, look in enumerate(_DARK_LENSES):
        z = height * (5 - 2 * k) / 6
        parts.append(placed(disc(look, 0.145, 16, 0.5 * depth + 0.006), (0.0, 0.0, z)))
        parts.append(placed(_visor(), (0.5 * depth, 0.0, z)))
    return merge(parts)


def _visor() -> Mesh:
    """Hood over a lens, open below, with an inner and an outer skin."""
    angle = np.radians(np.linspace(-40, 220, 12))
    arcs = []
    for radius in (0.158, 0.150):
        y, z = -radius * elementary.cos(angle), radius * elementary.sin(angle)
        # Underside of the hood is cut back, as on a tunnel visor.
        front = 0.10 + 0.14 * np.clip((z + 0.1) / 0.2, 0, 1)
        arcs.append([np.stack([x, y, z], axis=-1) for x in (np.zeros(12), front)])
    (outer_near, outer_far), (inner_near, inner_far) = arcs
    return rings(_CASE, np.stack([outer_near, outer_far, inner_far, inner_near], axis=1), crease_deg=40.0)


def _mast(post_m: float, arm_z_m: float, arm_m: float) -> list[Mesh]:
    arm = [(0, 0, arm_z_m - 0.25), (0, -0.35 * arm_m, arm_z_m + 0.05), (0, -arm_m, arm_z_m + 0.12)]
    if abs(arm_m) > 7:
        case = box(_CASE, (0.5, 0.4, 1.1), (-0.45, 0.25, 0.55))
    else:
        case = box(_CASE, (0.12, 0.2, 0.3), (-0.2, 0, 1.2))
    post = tube(POST, [(0, 0, 0), (0, 0, post_m)], [0.15, 0.10], 12)
    return [post, tube(POST, arm, [0.10, 0.075, 0.05], 10), _foot(0.28), case]


def _foot(radius_m: float) -> Mesh:
    profile = [(radius_m, 0.0), (radius_m, 0.05), (0.7 * radius_m, 0.22), (0.5 * radius_m, 0.24)]
    return lathe(POST, profile, 12)
