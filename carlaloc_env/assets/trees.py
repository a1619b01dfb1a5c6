"""Trees with trunk, branches and crown, in three levels of detail.

Branch radii follow r_child = r_parent · n^(−1/2.3) (Weber & Penn, SIGGRAPH 1995); low detail keeps the total
leaf area with fewer, larger pieces, so that colour and LiDAR returns stay.
"""

import numpy as np

from carlaloc_env.assets.leaves import (
    CLUMP_AREA,
    TRIANGLE_AREA,
    clumps,
    directions,
    leaf_triangles,
    unit,
)
from carlaloc_env.assets.palms import palm
from carlaloc_env.assets.primitives import Look, tube
from carlaloc_env.assets.tree_forms import FORMS, TreeForm
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import stream
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, face_vectors, merge
from carlaloc_env.scene.semantic_tags import Tag

DETAILS = ("high", "low", "far")
"""Levels of detail: beside the ego's route, beside other roads, and farther off."""
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
