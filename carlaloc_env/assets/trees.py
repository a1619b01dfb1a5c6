"""Trees and palms: species, trunks, branches, crowns.

Branch radii follow r_child = r_parent · n^(−1/2.3) (Weber & Penn, SIGGRAPH 1995); low detail keeps
the total leaf area with fewer, larger pieces, so that colour and LiDAR returns stay.

Kinds of trees: their sizes, branching and leaves.

Palms: a bare trunk with arching fronds.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from carlaloc_env.assets.plants import (
    CLUMP_AREA,
    TRIANGLE_AREA,
    clumps,
    directions,
    leaf_colours,
    leaf_mesh,
    leaf_triangles,
    unit,
)
from carlaloc_env.assets.primitives import Look, tube
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import stream
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, face_vectors, merge
from carlaloc_env.scene.semantic_tags import Tag


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeForm:
    """Shape of a kind of tree; ranges are (least, greatest)."""

    height_m: tuple[float, float]
    crown_m: tuple[float, float]
    """Diameter of the crown."""
    trunk_m: tuple[float, float]
    """Diameter of the trunk at breast height."""
    bare_m: tuple[float, float]
    """Height of the first branch."""
    branches: int
    twigs: int
    """Second-level branches on each first-level one."""
    rise: tuple[float, float]
    """Sine of the branches' slope, at the bottom and at the top of the crown."""
    reach: Callable[[float], float]
    """Length of a branch over the crown's radius, by the share of the crown's height where it begins."""
    leaf_m: float
    """Edge of a leaf triangle at high detail [m]."""
    density: float
    """Leaf area over the crown's projected area."""
    tint: tuple[int, int, int] = (220, 220, 220)
    bark: tuple[int, int, int] = (235, 235, 235)
    """Tint of the trunk."""
    clumps: int = 44
    """Leaf clumps of the crown at high detail; three fifths of them are drawn there, fewer farther off."""
    squash: float = 0.82
    """Height of a clump over its width."""
    ragged: float = 0.28
    """How uneven clumps are at high detail, as a share of their radius."""
    far_clumps: float = 1.0
    """Share of the usual number of clumps that is drawn at lower detail."""
    top: float = 0.80
    """Height of the trunk over that of the tree."""
    bough: float = 0.5
    """Thickness of the lowest branch over the trunk's."""
    bough_sides: int = 5
    """Corners of a branch at high detail."""
    bough_every: tuple[int, int, int] = (1, 4, 0)
    """Every n-th branch is drawn at each of `DETAILS`; 0 = none."""
    arch: float = 0.08
    """How far the middle of a branch lies above its ends, as a share of its length; hanging below 0."""
    needles: bool = False
    """Whether leaves grow along the branches, more on long ones, and nowhere else."""
    palm: bool = False
    """Whether it has fronds at the top of a bare trunk, `branches` of them, and no branches."""


def _round(share: float, widest: float = 0.35) -> float:
    away = (share - widest) / (1.08 - widest if share > widest else 0.75)
    return math.sqrt(max(1.0 - away**2, 0.05))


def _tall(share: float) -> float:
    return _round(share, 0.30)


def _column(share: float) -> float:
    return math.sqrt(max(1.0 - (2.0 * share - 0.9) ** 2, 0.12))


def _cone(share: float) -> float:
    return 1.02 - 0.97 * share


FORMS: dict[str, TreeForm] = {
    "plane": TreeForm(
        height_m=(9.0, 13.0), crown_m=(5.5, 7.5), trunk_m=(0.28, 0.42), bare_m=(2.6, 3.4), branches=9,
        twigs=2, rise=(0.30, 0.85), reach=_round, leaf_m=0.30, density=7.6, clumps=32, bark=(255, 250, 235),
    ),
    "lime": TreeForm(
        height_m=(8.0, 12.0), crown_m=(4.5, 6.0), trunk_m=(0.25, 0.36), bare_m=(2.4, 3.0), branches=10,
        twigs=2, rise=(0.30, 0.9), reach=_tall, leaf_m=0.27, density=8.5, clumps=32, tint=(205, 230, 195),
    ),
    "park": TreeForm(
        height_m=(14.0, 19.0), crown_m=(10.0, 13.0), trunk_m=(0.55, 0.85), bare_m=(3.0, 4.0), branches=12,
        twigs=3, rise=(0.20, 0.8), reach=_round, leaf_m=0.46, density=7.0, tint=(190, 205, 180), clumps=44,
    ),
    "conifer": TreeForm(
        height_m=(12.0, 18.0), crown_m=(4.8, 6.0), trunk_m=(0.30, 0.46), bare_m=(0.8, 1.5), branches=60,
        twigs=0, rise=(-0.30, 0.30), reach=_cone, leaf_m=0.40, density=13.0, tint=(125, 165, 140), clumps=84,
        squash=0.45, ragged=0.36, far_clumps=0.7, top=0.97, bough=0.32, bough_sides=3, bough_every=(2, 0, 0),
        arch=-0.06, needles=True,
    ),
    "young": TreeForm(
        height_m=(3.6, 5.0), crown_m=(2.0, 2.8), trunk_m=(0.08, 0.13), bare_m=(1.2, 1.6), branches=7, twigs=2,
        rise=(0.2, 0.8), reach=_round, leaf_m=0.17, density=7.5, tint=(235, 240, 200), clumps=20,
    ),
    "autumn": TreeForm(
        height_m=(7.0, 10.0), crown_m=(4.5, 6.0), trunk_m=(0.22, 0.32), bare_m=(2.2, 2.8), branches=9,
        twigs=2, rise=(0.35, 0.85), reach=_round, leaf_m=0.26, density=7.2, tint=(430, 165, 60), clumps=30,
    ),
    "birch": TreeForm(
        height_m=(10.0, 15.0), crown_m=(3.8, 5.0), trunk_m=(0.18, 0.28), bare_m=(2.4, 3.4), branches=13,
        twigs=2, rise=(0.55, 0.95), reach=_tall, leaf_m=0.22, density=7.5, tint=(245, 250, 190),
        bark=(255, 255, 255), clumps=34,
    ),
    "poplar": TreeForm(
        height_m=(16.0, 22.0), crown_m=(2.8, 3.8), trunk_m=(0.35, 0.55), bare_m=(1.2, 1.8), branches=18,
        twigs=1, rise=(1.6, 2.4), reach=_column, leaf_m=0.28, density=24.0, tint=(215, 225, 190), clumps=60,
        squash=1.7,
    ),
    "orchard": TreeForm(
        height_m=(4.0, 5.4), crown_m=(3.6, 4.6), trunk_m=(0.16, 0.26), bare_m=(1.2, 1.6), branches=8, twigs=2,
        rise=(0.2, 0.7), reach=_round, leaf_m=0.20, density=6.6, tint=(225, 245, 185), clumps=24,
    ),
    "palm": TreeForm(
        height_m=(8.0, 12.0), crown_m=(4.4, 5.4), trunk_m=(0.26, 0.36), bare_m=(7.0, 10.0), branches=22,
        twigs=0, rise=(0.2, 0.9), reach=_round, leaf_m=0.55, density=1.0, tint=(205, 215, 165),
        bark=(225, 215, 200), clumps=0, palm=True,
    ),
}  # fmt: skip
"""All kinds of trees."""

DETAILS = ("high", "low", "far")
"""Levels of detail: beside the ego's route, beside other roads, and farther off."""


def palm(
    form: TreeForm, rng: np.random.Generator, height: float, crown: float, trunk: float, detail: str
) -> Mesh:
    """A bare, slightly bent trunk with arching fronds."""
    lean = rng.normal(0.0, 0.05 * height, 2)
    top = height - 0.12 * crown
    t = np.linspace(0.0, 1.0, 6)
    axis = np.stack([lean[0] * t**2, lean[1] * t**2, top * t], axis=-1)
    radii = 0.5 * trunk * np.array([1.5, 1.05, 0.95, 0.9, 0.85, 1.0])
    sides = 9 if detail == "high" else 4
    bark = Look(Material.BARK, Tag.VEGETATION, form.bark)
    stem = tube(bark, axis, radii, sides, crease_deg=60.0)
    fronds = form.branches if detail == "high" else form.branches // 3
    width = 0.62 * form.branches / fronds
    share = (np.arange(fronds) + 0.5) / fronds
    # Both levels of detail draw as many numbers, so that the same seed stays the same tree.
    noise = rng.normal(0.0, 0.1, (form.branches, 2))[:fronds]
    yaw = 2.4 * np.arange(fronds) + noise[:, 0]
    reach = 0.5 * crown * (1.0 + noise[:, 1])
    rise = np.where(share > 0.35, 1.1 * share, -0.35)
    s = np.linspace(0.0, 1.0, 9 if detail == "high" else 6)
    along = reach[:, None] * s
    z = top + reach[:, None] * (rise[:, None] * s - (0.75 + 0.35 * rise[:, None]) * s**2)
    half = 0.5 * width * elementary.sin(np.pi * np.clip(0.12 + 0.88 * s, 0, 1)) + 0.02
    cos_yaw, sin_yaw = elementary.cos(yaw)[:, None], elementary.sin(yaw)[:, None]
    edges = []
    for side in (-1.0, 0.0, 1.0):
        x = axis[-1, 0] + cos_yaw * along - sin_yaw * side * half
        y = axis[-1, 1] + sin_yaw * along + cos_yaw * side * half
        edges.append(np.stack([x, y, z - abs(side) * 0.45 * half], axis=-1))
    points = np.stack(edges, axis=1)
    index = np.arange(points[..., 0].size).reshape(points.shape[:3])
    near_right, far_right = index[:, :-1, :-1], index[:, :-1, 1:]
    near_left, far_left = index[:, 1:, :-1], index[:, 1:, 1:]
    corners = [near_right, far_right, far_left, near_right, far_left, near_left]
    triangles = np.stack(corners, axis=-1).reshape(-1, 3)
    colour = np.repeat(leaf_colours(form.tint, (0.7 + 0.3 * share)[:, None]), index[0].size, axis=0)
    return merge([stem, leaf_mesh(points, triangles, points[..., :2], colour)])


_CORE_FRACTION = {"high": 0.30, "low": 0.20, "far": 0.25}
"""Part of the leaf area that clumps have."""
_CLUMP_FRACTION = {"high": 0.6, "low": 0.18, "far": 0.12}
"""Part of the clumps that is kept; they grow to keep their area."""
_LEAF_SCALE = {"high": 1.4, "low": 3.3, "far": 4.6}
"""How many times larger leaves are."""


def tree(kind: str = "plane", seed: int = 0, detail: str = "high") -> Mesh:
    """Tree with its foot at the origin.

    Args:
        kind: A key of `FORMS`.
        seed: Chooses size and branching; the same tree at both levels of detail.
        detail: ``high`` (1–4 k triangles), ``low`` (a quarter) or ``far`` (a tenth), same leaf area.

    Raises:
        ConfigError: unknown kind or detail.
    """
    if kind not in FORMS:
        raise ConfigError(unknown_name("tree", kind, FORMS))
    if detail not in DETAILS:
        raise ConfigError(unknown_name("level of detail", detail, DETAILS))
    form, rng = FORMS[kind], stream(seed, f"tree/{kind}")
    height, crown, trunk, bare = (
        float(rng.uniform(*bounds)) for bounds in (form.height_m, form.crown_m, form.trunk_m, form.bare_m)
    )
    if form.palm:
        return palm(form, rng, height, crown, trunk, detail)
    wood, tips = _skeleton(form, rng, height, crown, trunk, bare, detail)
    middle = np.array([0.0, 0.0, bare + 0.45 * (height - bare)])
    points = _foliage_points(form, rng, tips, height, crown, bare)
    area = form.density * np.pi * (0.5 * crown) ** 2
    return merge([*wood, *_crown(form, rng, points, middle, area, detail)])


def _skeleton(
    form: TreeForm,
    rng: np.random.Generator,
    height: float,
    crown: float,
    trunk: float,
    bare: float,
    detail: str,
) -> tuple[list[Mesh], Array]:
    """Trunk and branches as tubes, and the points where twigs end, shape (K, 3)."""
    bark = Look(Material.BARK, Tag.VEGETATION, form.bark)
    high = detail == "high"
    lean = rng.normal(0, 0.015 * height, (4, 2))
    lean[0] = 0
    top = height * form.top
    levels = np.array([0.0, 0.35, 0.7, 1.0]) * top
    axis = np.concatenate([np.cumsum(lean, axis=0), levels[:, None]], axis=-1)
    radius = 0.5 * trunk
    base = np.concatenate([axis[:1], [[0, 0, 0.35]], axis[1:]])
    radii = np.array([1.35, 1.0, 0.85, 0.55, 0.12]) * radius
    wood = [tube(bark, base, radii, 8 if high else 4, crease_deg=70.0)]
    tips = [axis[-1]]
    turn = rng.uniform(0, 2 * np.pi)
    every = form.bough_every[DETAILS.index(detail)]
    for k in range(form.branches):
        share = (k + rng.uniform(0.1, 0.9)) / form.branches
        turn += 2.4 + rng.normal(0, 0.25)
        z = bare + share * (top * 0.96 - bare)
        start = np.array([np.interp(z, axis[:, 2], axis[:, i]) for i in range(3)])
        reach = form.reach(share) * 0.5 * crown * rng.uniform(0.8, 1.0)
        slope = form.rise[0] + share * (form.rise[1] - form.rise[0])
        end = start + reach * np.array([elementary.cos(turn), elementary.sin(turn), slope])
        bend = 0.5 * (start + end) + np.array([0, 0, form.arch * reach])
        r0 = radius * form.bough * (1 - 0.6 * share)
        if every and k % every == 0:
            line, thickness = [start, bend, bend + 0.7 * (end - bend)], [r0, 0.7 * r0, 0.2 * r0]
            sides = form.bough_sides if high else 3
            wood.append(tube(bark, line, thickness, sides, caps=False, crease_deg=80.0))
        if form.needles:
            tips += list(start + np.linspace(0.15, 1, 6)[:, None] * (end - start))
        else:
            tips += [end, bend + 0.4 * (end - bend)]
        for _ in range(form.twigs):
            at = bend + rng.uniform(0.0, 0.8) * (end - bend)
            spread = 0.45 * reach * directions(rng, 1)[0] * np.array([1, 1, 0.6])
            tip = at + spread + np.array([0, 0, 0.2 * reach])
            r1 = r0 * 0.7 * float(elementary.power(max(form.twigs, 1), -1 / 2.3))
            if high:
                wood.append(tube(bark, [at, tip], [r1, 0.3 * r1], 3, caps=False, crease_deg=80.0))
            tips.append(tip)
    return wood, np.array(tips)


def _foliage_points(
    form: TreeForm, rng: np.random.Generator, tips: Array, height: float, crown: float, bare: float
) -> Array:
    """Middles of leaf clumps, shape (K, 3)."""
    if form.needles:
        return tips[rng.permutation(len(tips))[: form.clumps]]
    # The outermost twigs lie inside the crown, not beyond it.
    centre = np.array([0.0, 0.0, 0.5 * (height + bare)])
    inner = centre + 0.80 * (tips - centre)
    extra = form.clumps
    direction = directions(rng, extra) * np.sqrt(rng.uniform(0.15, 1.0, (extra, 1)))
    half = 0.5 * (height - bare)
    width = 0.36 * crown
    spots = direction * np.array([width, width, 0.78 * half]) + (0, 0, bare + half)
    points = np.concatenate([inner[rng.permutation(len(inner))[: form.clumps]], spots])
    return points[rng.permutation(len(points))[: form.clumps]]


def _crown(
    form: TreeForm, rng: np.random.Generator, points: Array, middle: Array, area_m2: float, detail: str
) -> list[Mesh]:
    """Clumps at the points, and leaves that stand out of them."""
    high = detail == "high"
    share = _CLUMP_FRACTION[detail] * (1.0 if high else form.far_clumps)
    chosen = points[: max(round(share * len(points)), 6)]
    weight = rng.uniform(0.75, 1.25, len(points))[: len(chosen)]
    if form.needles:
        # Long boughs carry more needles than the leader.
        weight = weight * (0.35 + 0.4 * np.sqrt(np.sum(chosen[:, :2] ** 2, axis=-1)))
    squash, ragged = form.squash, form.ragged if high else 0.36
    # Surface of a spheroid over that of a sphere, after K. Thomsen's approximation.
    flat = elementary.power((1.0 + 2.0 * elementary.power(squash, 1.6075)) / 3.0, 1.0 / 1.6075)
    core_m2 = _CORE_FRACTION[detail] * area_m2 / flat
    radii = weight * np.sqrt(core_m2 / (CLUMP_AREA * float(np.sum(weight**2))))
    body = clumps(rng, chosen, radii, middle, form.tint, squash=squash, ragged=ragged)
    size = form.leaf_m * _LEAF_SCALE[detail]
    count = max(int((area_m2 - _area_m2(body)) / (TRIANGLE_AREA * size**2)), 8)
    # Sprays of leaves hang about every twig, clumps fill the crown behind them.
    owner = rng.integers(0, len(points), count)
    away = directions(rng, count)
    bough = np.sqrt(area_m2 / (CLUMP_AREA * len(points)))
    reach = bough * np.sqrt(rng.uniform(0.25, 1.0, (count, 1))) * 1.35
    spots = points[owner] + away * reach * np.array([1.0, 1.0, squash])
    spots[:, 2] = np.maximum(spots[:, 2], 0.3)
    out = unit(0.5 * unit(spots - middle) + 0.5 * away)
    span = np.sqrt(np.max(np.sum((points - middle) ** 2, axis=-1))) + bough
    depth = np.sqrt(np.sum((spots - middle) ** 2, axis=-1)) / span
    shade = np.clip(0.42 + 0.5 * depth + 0.2 * out[:, 2], 0.4, 1.0)
    leaves = leaf_triangles(rng, spots, out, size * rng.uniform(0.8, 1.2, count), form.tint, shade)
    return [body, leaves]


def _area_m2(mesh: Mesh) -> float:
    across = face_vectors(mesh.vertices_m.astype(np.float64), mesh.triangles)
    return float(0.5 * np.sqrt(np.sum(across**2, axis=-1)).sum())
