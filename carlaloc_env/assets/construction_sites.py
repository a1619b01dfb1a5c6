"""Construction sites and their parts: cones, barriers, cranes, shells; foot at the origin, z up."""

import numpy as np

from carlaloc_env.assets.posts_and_fences import fence
from carlaloc_env.assets.primitives import Look, box, lathe, placed, tube
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

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
    bases = [box(_SITE_YELLOW, (0.5, 0.06, 0.06), (0.0, y, 0.03)) for y in (-0.8, 0.8)]
    legs = [box(_SITE_YELLOW, (0.05, 0.05, 1.0), (0.0, y, 0.5)) for y in (-0.8, 0.8)]
    return merge([*boards, *bases, *legs])


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
