"""Poles, fences, barriers, building sites and traffic lights along roads.

Poles, wires, fences and barriers along roads; foot at the origin, z up.

Building sites and their parts; foot at the origin, z up.

Traffic lights on posts and mast arms.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.primitives import Look, box, disc, extrude, lathe, placed, pose, rings, tube
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

POST = Look(Material.METAL_GALVANISED, Tag.POLE)
"""Zinc-coated posts of signs and lights."""


def utility_pole(height_m: float = 10.5) -> Mesh:
    """Wooden pole with a cross-arm along y; wires leave at `utility_wires_m`."""
    wood = Look(Material.WOOD, Tag.POLE, (190, 180, 170))
    arm_z = height_m - 0.6
    parts = [
        tube(wood, [(0, 0, 0), (0, 0, height_m)], [0.15, 0.10], 10),
        box(wood, (0.12, 2.2, 0.14), (0.12, 0, arm_z)),
    ]
    for y in (-1.0, -0.4, 0.4, 1.0):
        foot, head = (0.12, y, arm_z + 0.07), (0.12, y, arm_z + 0.22)
        parts.append(tube(Look(Material.PLASTIC, Tag.POLE, (70, 40, 24)), [foot, head], [0.05, 0.03], 6))
    grey, profile = (
        Look(Material.METAL_PAINTED, Tag.POLE, (120, 124, 124)),
        [(0.22, 0), (0.22, 0.75), (0.16, 0.82)],
    )
    return merge([*parts, lathe(grey, profile, 10, (0.36, 0, height_m - 2.4))])


def utility_wires_m(height_m: float = 10.5) -> NDArray[np.float64]:
    """Where wires leave a utility pole [m], shape (4, 3)."""
    return np.array([(0.12, y, height_m - 0.38) for y in (-1.0, -0.4, 0.4, 1.0)])


def fence(length_m: float, height_m: float, *, kind: str) -> Mesh:
    """Piece of fence along +x from the origin: iron ``bars``, wooden ``boards`` or ``rails``."""
    if kind == "bars":
        look = Look(Material.METAL_PAINTED, Tag.FENCE, (12, 14, 13))
        parts = [box(look, (length_m, 0.04, 0.04), (0.5 * length_m, 0, z)) for z in (0.12, height_m - 0.12)]
        xs = np.arange(0.06, length_m, 0.13)
        parts += [box(look, (0.022, 0.022, height_m - 0.06), (x, 0, 0.5 * height_m + 0.03)) for x in xs]
        post = (0.07, 0.07, height_m + 0.08)
        return merge([*parts, *(box(look, post, (x, 0, 0.5 * height_m + 0.04)) for x in (0.0, length_m))])
    wood = Look(Material.WOOD, Tag.FENCE)
    posts = [
        box(wood, (0.10, 0.10, height_m + 0.05), (x, 0, 0.5 * height_m)) for x in np.linspace(0, length_m, 3)
    ]
    if kind == "rails":
        size = (length_m, 0.04, 0.12)
        rails = [box(wood, size, (0.5 * length_m, 0.06, z * height_m)) for z in (0.3, 0.6, 0.9)]
        return merge([*posts, *rails])
    count = max(int(length_m / 0.16), 1)
    for k in range(count):
        size = (0.145, 0.02, height_m - 0.05 - 0.01 * (k % 3))
        posts.append(box(wood, size, (0.08 + k * length_m / count, 0.06, 0.5 * height_m + 0.03)))
    return merge(posts)


def delineator() -> Mesh:
    """White roadside post with a reflector, 1 m high."""
    white, reflector = (
        Look(Material.PLASTIC, Tag.POLE, (230, 230, 225)),
        Look(Material.SIGN, Tag.POLE, (230, 120, 20)),
    )
    post = extrude(white, [(-0.06, -0.06), (0.06, 0.0), (-0.06, 0.06)], 1.0)
    return merge([post, box(reflector, (0.125, 0.05, 0.18), (-0.002, 0.0, 0.78))])


_CONCRETE = Look(Material.CONCRETE, Tag.BUILDING, (205, 202, 194))
_SITE_YELLOW = Look(Material.METAL_PAINTED, Tag.STATIC, (190, 120, 8))
_ORANGE = Look(Material.PLASTIC, Tag.DYNAMIC, (200, 60, 6))
_BAND_WHITE = Look(Material.SIGN, Tag.DYNAMIC, (235, 235, 230))
_CONTAINERS = ((10, 60, 120), (140, 20, 12), (30, 90, 50), (180, 180, 175))


def traffic_cone() -> Mesh:
    """Cone of 0.75 m with two white bands."""
    base = box(Look(Material.RUBBER, Tag.DYNAMIC), (0.4, 0.4, 0.04), (0.0, 0.0, 0.02))
    body = lathe(_ORANGE, [(0.15, 0.04), (0.03, 0.75), (0.0, 0.75)], 10)
    bands = [lathe(_BAND_WHITE, [(r0 + 0.004, z0), (r1 + 0.004, z1)], 10) for r0, z0, r1, z1 in
             ((0.113, 0.26, 0.091, 0.39), (0.074, 0.49, 0.052, 0.62))]  # fmt: skip
    return merge([base, body, *bands])


def road_barrier() -> Mesh:
    """Red and white board of 2 m on two feet, along y."""
    red = Look(Material.SIGN, Tag.DYNAMIC, (190, 16, 10))
    boards = [
        box((_BAND_WHITE, red)[k % 2], (0.04, 0.25, 0.22), (0.0, -0.875 + 0.25 * k, 0.9)) for k in range(8)
    ]
    feet = [box(_SITE_YELLOW, (0.5, 0.06, 0.06), (0.0, y, 0.03)) for y in (-0.8, 0.8)]
    legs = [box(_SITE_YELLOW, (0.05, 0.05, 1.0), (0.0, y, 0.5)) for y in (-0.8, 0.8)]
    return merge([*boards, *feet, *legs])


def tower_crane() -> Mesh:
    """Crane with a square mast of 32 m and a jib of 34 m along +x."""
    half, height_m, jib_m = 0.8, 32.0, 34.0
    parts = [box(Look(Material.CONCRETE, Tag.STATIC), (4.0, 4.0, 0.8), (0.0, 0.0, 0.4))]
    for x in (-half, half):
        parts += [box(_SITE_YELLOW, (0.14, 0.14, height_m), (x, y, height_m / 2)) for y in (-half, half)]
    for k, z in enumerate(np.arange(0.8, height_m - 1.6, 1.6)):
        s = half if k % 2 else -half
        ends = [((-half, s, z), (half, s, z + 1.6)), ((s, -half, z), (s, half, z + 1.6))]
        ends += [((-half, -s, z), (half, -s, z + 1.6)), ((-s, half, z), (-s, -half, z + 1.6))]
        parts += [tube(_SITE_YELLOW, list(pair), 0.05, 4, caps=False) for pair in ends]
    rope, z0 = Look(Material.RUBBER, Tag.STATIC), height_m + 0.3
    for y in (-0.6, 0.6):
        parts.append(box(_SITE_YELLOW, (jib_m + 12.0, 0.12, 0.12), ((jib_m - 12.0) / 2, y, z0)))
    parts.append(box(_SITE_YELLOW, (jib_m + 8.0, 0.12, 0.12), ((jib_m - 8.0) / 2, 0.0, z0 + 1.3)))
    for x in np.arange(-6.0, jib_m - 2.0, 2.0):
        lines = [[(x, y, z0), (x + 1.0, 0.0, z0 + 1.3)] for y in (-0.6, 0.6)]
        parts += [tube(_SITE_YELLOW, line, 0.04, 4, caps=False) for line in lines]
    parts += [
        box(Look(Material.CONCRETE, Tag.STATIC), (2.6, 1.6, 2.0), (-10.5, 0.0, z0 - 1.0)),
        box(Look(Material.METAL_PAINTED, Tag.STATIC, (220, 220, 215)), (1.4, 1.2, 2.0), (0.9, 1.4, z0 - 1.2)),
        tube(_SITE_YELLOW, [(0.0, 0.0, z0), (0.0, 0.0, z0 + 6.0)], [0.35, 0.1], 4),
        tube(_SITE_YELLOW, [(0.0, 0.0, z0 + 6.0), (0.7 * jib_m, 0.0, z0 + 1.3)], 0.04, 4, caps=False),
        tube(_SITE_YELLOW, [(0.0, 0.0, z0 + 6.0), (-10.5, 0.0, z0)], 0.04, 4, caps=False),
        tube(rope, [(0.6 * jib_m, 0.0, z0), (0.6 * jib_m, 0.0, z0 - 9.0)], 0.03, 4),
    ]  # fmt: skip
    return merge(parts)


def frame_building(width_m: float, depth_m: float, storeys: int) -> Mesh:
    """Shell of columns and floors with reinforcement bars on top, centred on the origin."""
    parts, step = [], 3.4
    xs, ys = (np.linspace(-0.5, 0.5, max(2, round(size / 5.0) + 1)) * size for size in (depth_m, width_m))
    for storey in range(storeys):
        z = storey * step
        parts.append(box(_CONCRETE, (depth_m + 0.8, width_m + 0.8, 0.28), (0.0, 0.0, z + step)))
        parts += [box(_CONCRETE, (0.4, 0.4, step), (x, y, z + step / 2)) for x in xs for y in ys]
    top = storeys * step + 0.14
    rust = Look(Material.METAL_PAINTED, Tag.BUILDING, (70, 30, 14))
    for x in xs:
        for y in ys:
            parts += [box(rust, (0.03, 0.03, 1.1), (x + dx, y, top + 0.55)) for dx in (-0.14, 0.14)]
    rail = Look(Material.WOOD, Tag.FENCE)
    for side in (-1.0, 1.0):
        parts.append(box(rail, (0.05, width_m + 0.8, 0.15), (side * (depth_m / 2 + 0.4), 0.0, top + 1.0)))
    return merge(parts)


def construction_site(width_m: float, depth_m: float, draw: np.random.Generator) -> Mesh:
    """Fenced site on bare soil: a shell, a crane, containers, heaps and cones; its gate looks along +x."""
    soil = box(Look(Material.SOIL, Tag.GROUND), (depth_m, width_m, 0.3), (0.0, 0.0, -0.1))
    frame = frame_building(0.45 * width_m, 0.5 * depth_m, int(draw.integers(2, 5)))
    parts = [soil, placed(frame, (-0.12 * depth_m, -0.18 * width_m, 0.05))]
    crane_at, crane_yaw = (-0.1 * depth_m, 0.18 * width_m, 0.05), float(draw.uniform(0.0, 6.28))
    parts.append(placed(tower_crane(), crane_at, crane_yaw))
    for k in range(4):
        look = Look(Material.SHEET_METAL, Tag.STATIC, _CONTAINERS[int(draw.integers(4))])
        spot = (0.28 * depth_m, (0.12 + 0.1 * (k // 2)) * width_m, 1.35 + 2.6 * (k % 2))
        parts.append(box(look, (6.0, 2.5, 2.6), spot))
    for _ in range(4):
        x, y = draw.uniform(0.2, 0.42) * depth_m, draw.uniform(-0.4, 0.02) * width_m
        radius = float(draw.uniform(1.4, 2.6))
        look = Look((Material.GRAVEL, Material.SOIL)[int(draw.integers(2))], Tag.STATIC)
        heap = [(radius, 0.0), (0.5 * radius, 0.5 * radius), (0.05, 0.62 * radius)]
        parts.append(lathe(look, heap, 12, (x, y, 0)))
    parts += [placed(traffic_cone(), (0.5 * depth_m + 0.6, y, 0.0)) for y in (-3.4, -1.8, 1.8, 3.4)]
    parts += _hoarding(width_m, depth_m)
    return merge(parts)


def _hoarding(width_m: float, depth_m: float) -> list[Mesh]:
    """Board fence round the site with a gate of 6 m and barriers in it."""
    panel = fence(3.0, 1.9, kind="boards")
    parts = []
    for x, y, yaw, length in (
        (-depth_m / 2, -width_m / 2, 0.0, depth_m),
        (-depth_m / 2, width_m / 2, 0.0, depth_m),
        (-depth_m / 2, -width_m / 2, np.pi / 2, width_m),
        (depth_m / 2, -width_m / 2, np.pi / 2, 0.5 * width_m - 3.0),
        (depth_m / 2, 3.0, np.pi / 2, 0.5 * width_m - 3.0),
    ):
        count = max(1, int(length / 3.0))
        for k in range(count):
            at = k * length / count
            spot = (x + elementary.cos(yaw) * at, y + elementary.sin(yaw) * at, 0.0)
            parts.append(placed(panel, spot, yaw))
    parts += [placed(road_barrier(), (depth_m / 2, y, 0.0)) for y in (-1.4, 1.4)]
    return parts


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
