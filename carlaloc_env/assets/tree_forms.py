"""Kinds of trees: their sizes, branching and leaves."""

import math
from collections.abc import Callable
from dataclasses import dataclass


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
