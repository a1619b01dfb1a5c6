"""Low plants: hedges, shrubs, beds, climbers, grass and crops, and bales of hay."""

import numpy as np

from carlaloc_env.assets.leaves import (
    TRIANGLE_AREA,
    LeafTint,
    clumps,
    directions,
    leaf_colours,
    leaf_triangles,
    separate_leaves,
)
from carlaloc_env.assets.primitives import Look, box, circle, lathe, tube
from carlaloc_env.core import elementary
from carlaloc_env.core.clock import stream
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour, Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag


def hedge(
    length_m: float = 3.0, height_m: float = 1.3, width_m: float = 0.6, seed: int = 0, detail: str = "high"
) -> Mesh:
    """Clipped hedge along +x from the origin."""
    rng = stream(seed, "hedge")
    core = Look(Material.LEAF, Tag.VEGETATION, (86, 122, 99))
    low_m = height_m - 0.06
    inner = box(core, (length_m - 0.04, width_m - 0.10, low_m), (0.5 * length_m, 0.0, 0.5 * low_m))
    size = 0.13 if detail == "high" else 0.24
    area = (1.0 if detail == "high" else 0.7) * (2 * length_m * height_m + length_m * width_m)
    count = int(area / (0.43 * size**2))
    side = rng.uniform(0, 1, count)
    share = 2 * height_m / (2 * height_m + width_m)
    on_side = side < share
    y = np.where(on_side, np.where(side < 0.5 * share, -0.5, 0.5), rng.uniform(-0.5, 0.5, count))
    y = y * (width_m - 0.06)
    z = np.where(on_side, rng.uniform(0.06, 1, count), 1.0) * (height_m - 0.05)
    x = rng.uniform(0.0, length_m, count)
    points = np.stack([x, y, z], -1) + rng.normal(0, 0.02, (count, 3))
    out = np.stack([np.zeros(count), np.where(on_side, np.sign(y), 0.0), np.where(on_side, 0.2, 1.0)], -1)
    return merge([inner, leaf_triangles(rng, points, out, np.full(count, size), (200, 215, 180))])


def shrub(seed: int = 0, detail: str = "high", tint: LeafTint = (215, 225, 190)) -> Mesh:
    """Round shrub of about 1.2 m."""
    rng = stream(seed, "shrub")
    radius, height = rng.uniform(0.5, 0.75), rng.uniform(0.9, 1.4)
    high = detail == "high"
    around = directions(rng, 7)
    centres = around * np.array([0.55, 0.55, 0.25]) * radius + (0.0, 0.0, 0.5 * height)
    centres[:, 2] += np.linspace(-0.1, 0.2, 7) * height
    size = 0.6 * radius
    used = centres if high else centres[::3]
    radii = np.full(len(used), size if high else 1.15 * size)
    middle = np.array([0.0, 0.0, 0.35 * height])
    body = clumps(rng, used, radii, middle, tint, squash=0.85)
    count, edge = (220, 0.15) if high else (56, 0.28)
    out = directions(rng, count)
    out[:, 2] = np.abs(out[:, 2])
    points = out * np.array([radius, radius, 0.62 * height]) * rng.uniform(0.85, 1.15, (count, 1))
    leaves = leaf_triangles(rng, points + middle, out, np.full(count, edge), tint)
    if not high:
        return merge([body, leaves])
    bark = Look(Material.BARK, Tag.VEGETATION)
    ends = np.insert(0.4 * radius * circle(5), 2, 0.6 * height, axis=1)
    return merge([*(tube(bark, [(0, 0, 0), end], [0.03, 0.01], 4) for end in ends), body, leaves])


def bed(seed: int = 0, length_m: float = 3.0, height_m: float = 0.9) -> Mesh:
    """Shrubs in a row along +x from the origin, grown into one another."""
    rng = stream(seed, "bed")
    count, leaves = round(1.7 * length_m), round(48 * length_m)
    x = (np.arange(count) + rng.uniform(0.25, 0.75, count)) * length_m / count
    radii = height_m * rng.uniform(0.36, 0.56, count)
    centres = np.stack([x, rng.uniform(-0.12, 0.12, count), 0.8 * radii], axis=-1)
    middle = np.array([0.5 * length_m, 0.0, 0.1])
    body = clumps(rng, centres, radii, middle, (205, 220, 185), squash=1.0, ragged=0.25)
    owner, out = rng.integers(0, count, leaves), directions(rng, leaves)
    out[:, 2] = np.abs(out[:, 2])
    points = centres[owner] + out * (radii[owner] * rng.uniform(0.95, 1.25, leaves))[:, None]
    return merge([body, leaf_triangles(rng, points, out, rng.uniform(0.11, 0.26, leaves), (205, 220, 185))])


def climber(seed: int = 0, height_m: float = 3.2, width_m: float = 1.3) -> Mesh:
    """Ivy on a wall in the plane of x and z, which faces −y: up to a third of a metre thick."""
    rng = stream(seed, "climber")
    count, size = int(1.2 * height_m * width_m / (TRIANGLE_AREA * 0.26**2)), 0.26
    up = rng.uniform(0.0, 1.0, count)
    # Shoots spread on their way up, and fewer get to the top.
    centre = 0.25 * width_m * elementary.sin(5.0 * up + seed)
    x = centre + width_m * (0.22 + 0.3 * up) * np.clip(rng.normal(0.0, 0.6, count), -1.2, 1.2)
    thick = rng.uniform(0.0, 1.0, count)
    y = -0.03 - 0.32 * thick * np.sqrt(thick) * (1.0 - 0.4 * up)
    points = np.stack([x, y, height_m * up * (0.8 + 0.2 * up)], axis=-1)
    out = np.tile([0.0, -0.95, 0.31], (count, 1))
    return leaf_triangles(rng, points, out, np.full(count, size), (205, 220, 185), 0.7 + 0.3 * (-y / 0.35))


def tufts(
    seed: int,
    count: int,
    radius_m: float,
    height_m: float,
    tint: LeafTint,
    *,
    blade_m: float = 0.04,
    spread: float = 0.35,
) -> Mesh:
    """Long grass or weeds: blades of one triangle each in a round patch, normals up like the ground's."""
    rng = stream(seed, "tufts")
    turn, reach = rng.uniform(0, 2 * np.pi, count), radius_m * np.sqrt(rng.uniform(0, 1, count))
    x, y = reach * elementary.cos(turn), reach * elementary.sin(turn)
    foot = np.stack([x, y, np.full(count, -0.05)], axis=-1)
    yaw = rng.uniform(0, 2 * np.pi, count)
    side = 0.5 * blade_m * np.stack([elementary.cos(yaw), elementary.sin(yaw), np.zeros(count)], axis=-1)
    high = height_m * rng.uniform(0.55, 1.0, count)
    lean = spread * high[:, None] * rng.normal(0, 1, (count, 2))
    tip = foot + np.concatenate([lean, high[:, None] + 0.05], axis=-1)
    vertices = np.stack([foot - side, foot + side, tip], axis=1)
    normals = np.stack([lean[:, 0] / high, lean[:, 1] / high, np.ones(count)], axis=-1)
    normals /= np.sqrt(np.sum(normals * normals, axis=-1, keepdims=True))
    light = rng.uniform(0.7, 1.0, (count, 1)) * np.clip(rng.normal(1.0, 0.07, (count, 3)), 0.8, 1.2)
    return separate_leaves(vertices, rng.uniform(0, 1, (3 * count, 2)), leaf_colours(tint, light), normals)


def stalks(seed: int, height_m: float, tint: Colour) -> Mesh:
    """A handful of cereal stalks."""
    return tufts(seed, 14, 0.42, height_m, tint, blade_m=0.06, spread=0.16)


def maize(seed: int, tint: Colour) -> Mesh:
    """A maize plant, 2.2 m high: a stem and arching leaves of two triangles each."""
    rng = stream(seed, "maize")
    leaves = 8
    yaw = np.pi * np.arange(leaves) + rng.normal(0.0, 0.5, leaves)
    z = np.linspace(0.35, 1.75, leaves)
    reach = 0.55 * (1.0 - 0.45 * (z / 2.0 - 0.4) ** 2) * rng.uniform(0.8, 1.15, leaves)
    out = np.stack([elementary.cos(yaw), elementary.sin(yaw), np.zeros(leaves)], axis=-1)
    side = 0.06 * np.stack([-elementary.sin(yaw), elementary.cos(yaw), np.zeros(leaves)], axis=-1)
    base = np.column_stack([np.zeros((leaves, 2)), z])
    bend = base + out * 0.5 * reach[:, None] + [0.0, 0.0, 0.34]
    tip = base + out * reach[:, None] + [0.0, 0.0, 0.02]
    upper = np.stack([bend - side, bend + side, tip], axis=1)
    lower = np.stack([base, bend + side, bend - side], axis=1)
    stem = [[(-0.03, 0, 0), (0.03, 0, 0), (0, 0, 2.15)], [(0, -0.03, 0), (0, 0.03, 0), (0, 0, 2.15)]]
    corners = np.concatenate([lower, upper, stem])
    count = len(corners)
    colour = leaf_colours(tint, rng.uniform(0.7, 1.0, (count, 1)))
    return separate_leaves(
        corners, rng.uniform(0, 1, (3 * count, 2)), colour, np.tile([0.0, 0.0, 1.0], (count, 1))
    )


def bale() -> Mesh:
    """Round bale of hay, 1.5 m across and 1.2 m long, lying along y."""
    straw = Look(Material.CROP, Tag.DYNAMIC, (255, 225, 150))
    body = lathe(straw, [(0.70, -0.6), (0.75, -0.5), (0.75, 0.5), (0.70, 0.6)], 14)
    turned = body.vertices_m[:, [0, 2, 1]].astype(np.float64) * np.array([1.0, -1.0, 1.0]) + [0.0, 0.0, 0.72]
    normals = body.normals[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0], np.float32)
    return straw.mesh(turned, body.triangles, body.uv_m, normals)
