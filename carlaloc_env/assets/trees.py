"""Trees, hedges and shrubs with leaves as single triangles.

Branch radii follow r_child = r_parent · n^(−1/2.3) (Weber & Penn, SIGGRAPH 1995); low detail keeps
the total leaf area with fewer, larger triangles, so that colour and LiDAR returns stay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.shapes import Look, box, tube
from carlaloc_env.errors import ConfigError, unknown_name
from carlaloc_env.geometry import cross
from carlaloc_env.materials import Material
from carlaloc_env.rng import stream
from carlaloc_env.scene import Mesh, make_mesh, merge
from carlaloc_env.semantics import Tag

Array = NDArray[np.float64]


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
    shape: str
    """``round``, ``cone`` or ``tall``."""
    leaf_m: float
    """Edge of a leaf triangle at high detail [m]."""
    density: float
    """Leaf area over the crown's projected area."""
    tint: tuple[int, int, int] = (220, 220, 220)
    clumps: int = 70
    """Leaf clumps of the crown at high detail."""


FORMS: dict[str, TreeForm] = {
    "plane": TreeForm(
        height_m=(9.0, 13.0), crown_m=(5.5, 7.5), trunk_m=(0.28, 0.42), bare_m=(2.6, 3.4), branches=9,
        twigs=3,
        rise=(0.30, 0.85), shape="round", leaf_m=0.28, density=2.4, clumps=120,
    ),
    "lime": TreeForm(
        height_m=(8.0, 12.0), crown_m=(4.5, 6.0), trunk_m=(0.25, 0.36), bare_m=(2.4, 3.0), branches=10,
        twigs=3,
        rise=(0.30, 0.9), shape="tall", leaf_m=0.26, density=2.7, tint=(205, 230, 195), clumps=130,
    ),
    "park": TreeForm(
        height_m=(14.0, 19.0), crown_m=(10.0, 13.0), trunk_m=(0.55, 0.85), bare_m=(3.0, 4.0), branches=12,
        twigs=4,
        rise=(0.20, 0.8), shape="round", leaf_m=0.44, density=2.4, tint=(190, 205, 180), clumps=190,
    ),
    "conifer": TreeForm(
        height_m=(12.0, 18.0), crown_m=(4.8, 6.0), trunk_m=(0.30, 0.46), bare_m=(0.8, 1.5), branches=60,
        twigs=0,
        rise=(-0.30, 0.30), shape="cone", leaf_m=0.36, density=6.0, tint=(120, 165, 140), clumps=0,
    ),
    "young": TreeForm(
        height_m=(3.6, 5.0), crown_m=(2.0, 2.8), trunk_m=(0.08, 0.13), bare_m=(1.2, 1.6), branches=7, twigs=2,
        rise=(0.2, 0.8), shape="round", leaf_m=0.17, density=2.5, tint=(235, 240, 200), clumps=60,
    ),
    "autumn": TreeForm(
        height_m=(7.0, 10.0), crown_m=(4.5, 6.0), trunk_m=(0.22, 0.32), bare_m=(2.2, 2.8), branches=9,
        twigs=3,
        rise=(0.35, 0.85), shape="round", leaf_m=0.25, density=2.1, tint=(255, 140, 80), clumps=105,
    ),
}  # fmt: skip
"""All kinds of trees."""

_LOW_SHARE = 9.0
"""How many times fewer leaves low detail has."""


def tree(kind: str = "plane", seed: int = 0, detail: str = "high") -> Mesh:
    """Tree with its foot at the origin.

    Args:
        kind: A key of `FORMS`.
        seed: Chooses size and branching; the same tree at both levels of detail.
        detail: ``high`` (1–3 k triangles) or ``low`` (a tenth, same leaf area).

    Raises:
        ConfigError: unknown kind or detail.
    """
    if kind not in FORMS:
        raise ConfigError(unknown_name("tree", kind, FORMS))
    if detail not in ("high", "low"):
        raise ConfigError(unknown_name("level of detail", detail, ("high", "low")))
    form, rng = FORMS[kind], stream(seed, f"tree/{kind}")
    height, crown, trunk, bare = (
        float(rng.uniform(*bounds)) for bounds in (form.height_m, form.crown_m, form.trunk_m, form.bare_m)
    )
    wood, tips = _skeleton(form, rng, height, crown, trunk, bare, detail)
    middle = np.array([0.0, 0.0, bare + 0.45 * (height - bare)])
    points, spread = _foliage_points(form, rng, tips, height, crown, bare)
    area = form.density * np.pi * (0.5 * crown) ** 2
    leaves = _leaves(form, rng, points, spread, middle, area, detail)
    return merge([*wood, leaves])


def hedge(
    length_m: float = 3.0, height_m: float = 1.3, width_m: float = 0.6, seed: int = 0, detail: str = "high"
) -> Mesh:
    """Clipped hedge along +x from the origin."""
    rng = stream(seed, "hedge")
    core = Look(Material.LEAF, Tag.VEGETATION, (70, 80, 60))
    inner = box(
        core,
        (length_m - 0.04, width_m - 0.14, height_m - 0.08),
        (0.5 * length_m, 0.0, 0.5 * (height_m - 0.08)),
    )
    size = 0.11 if detail == "high" else 0.3
    area = 1.1 * (2 * length_m * height_m + length_m * width_m)
    count = int(area / (0.43 * size**2))
    side = rng.uniform(0, 1, count)
    share = 2 * height_m / (2 * height_m + width_m)
    on_side = side < share
    y = np.where(on_side, np.where(side < 0.5 * share, -0.5, 0.5), rng.uniform(-0.5, 0.5, count)) * (
        width_m - 0.06
    )
    z = np.where(on_side, rng.uniform(0.02, 1, count), 1.0) * (height_m - 0.05)
    x = rng.uniform(0.0, length_m, count)
    points = np.stack([x, y, z], -1) + rng.normal(0, 0.02, (count, 3))
    out = np.stack([np.zeros(count), np.where(on_side, np.sign(y), 0.0), np.where(on_side, 0.2, 1.0)], -1)
    return merge([inner, _triangles(rng, points, out, np.full(count, size), (200, 215, 180))])


def shrub(seed: int = 0, detail: str = "high") -> Mesh:
    """Round shrub of about 1.2 m."""
    rng = stream(seed, "shrub")
    radius, height = rng.uniform(0.5, 0.75), rng.uniform(0.9, 1.4)
    size = 0.12 if detail == "high" else 0.34
    count = int(5.5 * radius * height / (0.43 * size**2))
    direction = _directions(rng, count)
    direction[:, 2] = np.abs(direction[:, 2])
    points = direction * np.array([radius, radius, height]) * rng.uniform(0.55, 1.0, (count, 1)) + (
        0,
        0,
        0.05,
    )
    stems = [
        tube(
            Look(Material.BARK, Tag.VEGETATION),
            [(0, 0, 0), (0.4 * radius * np.cos(a), 0.4 * radius * np.sin(a), 0.6 * height)],
            [0.03, 0.01],
            4,
        )
        for a in 2 * np.pi * np.arange(5) / 5
    ]
    return merge([*stems, _triangles(rng, points, direction, np.full(count, size), (215, 225, 190))])


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
    bark = Look(Material.BARK, Tag.VEGETATION, (235, 235, 235))
    high = detail == "high"
    lean = rng.normal(0, 0.015 * height, (4, 2))
    lean[0] = 0
    top = height * (0.97 if form.shape == "cone" else 0.80)
    levels = np.array([0.0, 0.35, 0.7, 1.0]) * top
    axis = np.concatenate([np.cumsum(lean, axis=0), levels[:, None]], axis=-1)
    radius = 0.5 * trunk
    base = np.concatenate([axis[:1], [[0, 0, 0.35]], axis[1:]])
    radii = np.array([1.35, 1.0, 0.85, 0.55, 0.12]) * radius
    wood = [tube(bark, base, radii, 8 if high else 4, crease_deg=70.0)]
    tips = [axis[-1]]
    turn = rng.uniform(0, 2 * np.pi)
    for k in range(form.branches):
        share = (k + rng.uniform(0.1, 0.9)) / form.branches
        turn += 2.4 + rng.normal(0, 0.25)
        z = bare + share * (top * 0.96 - bare)
        start = np.array([np.interp(z, axis[:, 2], axis[:, i]) for i in range(3)])
        reach = _reach(form.shape, share) * 0.5 * crown * rng.uniform(0.8, 1.0)
        slope = form.rise[0] + share * (form.rise[1] - form.rise[0])
        end = start + reach * np.array([np.cos(turn), np.sin(turn), slope])
        bend = 0.5 * (start + end) + np.array([0, 0, -0.06 * reach if form.shape == "cone" else 0.08 * reach])
        r0 = radius * (0.32 if form.shape == "cone" else 0.5) * (1 - 0.6 * share)
        if k % 4 == 0 or (high and (form.shape != "cone" or k % 2 == 0)):
            wood.append(
                tube(
                    bark,
                    [start, bend, end],
                    [r0, 0.7 * r0, 0.2 * r0],
                    (3 if form.shape == "cone" else 5) if high else 3,
                    caps=False,
                    crease_deg=80.0,
                )
            )
        tips += (
            [end, bend + 0.4 * (end - bend)]
            if form.shape != "cone"
            else list(start + np.linspace(0.15, 1, 6)[:, None] * (end - start))
        )
        for _ in range(form.twigs):
            at = bend + rng.uniform(0.0, 0.8) * (end - bend)
            tip = (
                at
                + 0.45 * reach * _directions(rng, 1)[0] * np.array([1, 1, 0.6])
                + np.array([0, 0, 0.2 * reach])
            )
            r1 = r0 * 0.7 * max(form.twigs, 1) ** (-1 / 2.3)
            if high:
                wood.append(tube(bark, [at, tip], [r1, 0.3 * r1], 3, caps=False, crease_deg=80.0))
            tips.append(tip)
    return wood, np.array(tips)


def _reach(shape: str, share: float) -> float:
    """Length of a branch at a share of the crown's height, relative to the crown's radius."""
    if shape == "cone":
        return 1.02 - 0.97 * share
    middle = 0.35 if shape == "round" else 0.30
    return float(
        np.sqrt(max(1.0 - ((share - middle) / (1.08 - middle if share > middle else 0.75)) ** 2, 0.05))
    )


def _foliage_points(
    form: TreeForm, rng: np.random.Generator, tips: Array, height: float, crown: float, bare: float
) -> tuple[Array, Array]:
    """Centres of leaf clumps (K, 3) and their radii (K,)."""
    if form.shape == "cone":
        return tips, np.full(len(tips), 0.09 * crown)
    extra = max(form.clumps - len(tips), 0)
    direction = _directions(rng, extra) * rng.uniform(0.12, 0.98, (extra, 1)) ** 0.5
    half = 0.5 * (height - bare)
    spots = direction * np.array([0.47 * crown, 0.47 * crown, 0.96 * half]) + (0, 0, bare + half)
    points = np.concatenate([tips, spots])
    return points, rng.uniform(0.07, 0.13, len(points)) * crown


def _leaves(
    form: TreeForm,
    rng: np.random.Generator,
    centres: Array,
    spread: Array,
    middle: Array,
    area_m2: float,
    detail: str,
) -> Mesh:
    size = form.leaf_m * (1.0 if detail == "high" else np.sqrt(_LOW_SHARE))
    count = int(area_m2 / (0.433 * size**2))
    # Long boughs carry more needles than the leader.
    weight = (
        0.25 + np.sqrt(np.sum(centres[:, :2] ** 2, axis=-1))
        if form.shape == "cone"
        else np.ones(len(centres))
    )
    clump = np.searchsorted(np.cumsum(weight), rng.uniform(0, float(weight.sum()), count)).clip(
        0, len(centres) - 1
    )
    offset = _directions(rng, count) * spread[clump, None] * rng.uniform(0.3, 1.0, (count, 1))
    if form.shape == "cone":
        offset *= np.array([1.2, 1.2, 0.7])
    points = centres[clump] + offset
    points[:, 2] = np.maximum(points[:, 2], 0.3)
    out = points - middle
    out = out / np.maximum(np.sqrt(np.sum(out * out, axis=-1, keepdims=True)), 1e-6)
    return _triangles(rng, points, out, size * rng.uniform(0.75, 1.25, count), form.tint)


def _triangles(
    rng: np.random.Generator, points: Array, out: Array, size: Array, tint: tuple[int, int, int]
) -> Mesh:
    """One leaf triangle at each point, facing roughly outwards, with normals bent outwards."""
    count = len(points)
    normal = 0.7 * out + 0.9 * _directions(rng, count)
    normal = normal / np.sqrt(np.sum(normal * normal, axis=-1, keepdims=True))
    helper = _directions(rng, count)
    across = cross(normal, helper)
    across = across / np.maximum(np.sqrt(np.sum(across * across, axis=-1, keepdims=True)), 1e-6)
    other = cross(normal, across)
    angle = 2 * np.pi * np.arange(3) / 3
    corner = np.cos(angle)[None, :, None] * across[:, None] + np.sin(angle)[None, :, None] * other[:, None]
    vertices = points[:, None] + 0.577 * size[:, None, None] * corner
    shade = 0.3 * normal + 0.7 * out
    shade = shade / np.maximum(np.sqrt(np.sum(shade * shade, axis=-1, keepdims=True)), 1e-6)
    light = rng.uniform(0.72, 1.0, (count, 1)) * np.clip(rng.normal(1.0, 0.06, (count, 3)), 0.8, 1.2)
    colour = np.clip(np.array(tint) * light, 0, 255).astype(np.uint8)
    uv = rng.uniform(0, 1, (count, 1, 2)) + 0.5 * size[:, None, None] * np.stack(
        [np.cos(angle), np.sin(angle)], -1
    )
    return make_mesh(
        vertices.reshape(-1, 3),
        np.arange(3 * count).reshape(-1, 3),
        material=Material.LEAF,
        tag=Tag.VEGETATION,
        uv_m=uv.reshape(-1, 2),
        normals=np.repeat(shade, 3, axis=0),
        colour=np.repeat(colour, 3, axis=0),
    )


def _directions(rng: np.random.Generator, count: int) -> Array:
    vector = rng.normal(size=(count, 3))
    return np.asarray(vector / np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True)))
