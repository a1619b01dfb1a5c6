"""The making of walkers: a skin of rings round a skeleton in the posture of rest, and its clothes."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.primitives import Look, circle, ellipsoid, grid_triangles, rings, surface
from carlaloc_env.assets.walkers.gait import standing
from carlaloc_env.assets.walkers.skeleton import (
    BONES,
    Joints,
    Skin,
    shoe_sole,
)
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour, Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

Hang = tuple[str, str, float]
"""Two bones and the share of the first."""
Level = tuple[Array, float, float, Hang]
"""Elliptic level ring: centre [m], half depth, half width [m], bones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """Stature, girth and clothes of a figure."""

    stature_m: float = 1.75
    girth: float = 1.0
    """Radii as a multiple of an average man's."""
    hips: float = 1.0
    belly: float = 1.0
    skin: Colour = (150, 92, 62)
    hair: Colour = (12, 8, 5)
    upper: Colour = (255, 255, 255)
    """White takes the instance's tint."""
    lower: Colour = (16, 22, 42)
    shoes: Colour = (14, 12, 11)
    inner: Colour | None = None
    """Shirt under an open jacket."""
    coat: bool = False
    """Whether the upper clothes reach to the knee."""
    short_sleeves: bool = False
    skirt: bool = False
    shorts: bool = False
    long_hair: bool = False
    bald: bool = False
    beard: bool = False
    hat: Colour | None = None
    backpack: Colour | None = None
    handbag: Colour | None = None
    carrier: Colour | None = None
    """Shopping bag in the right hand."""
    stick: bool = False
    """Walking stick in the right hand."""
    helmet: Colour | None = None


@dataclass(slots=True)
class SkinBuilder:
    """Collects the parts of one figure in the posture of rest."""

    build: Build
    tag: Tag
    low: bool
    rest: Joints = field(init=False)
    parts: list[tuple[Mesh, NDArray[np.intp], Array]] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.rest = standing(self.build.stature_m, stoop_deg=0.0)

    def finish(self) -> Skin:
        """All parts in one skin."""
        meshes, bones, weights = zip(*self.parts, strict=True)
        return Skin(
            mesh=merge(meshes), bones=np.concatenate(bones), weight=np.concatenate(weights), rest=self.rest
        )

    def look(self, colour: Colour, material: Material = Material.CLOTH) -> Look:
        """Look of a part of this colour."""
        return Look(material, self.tag, colour)

    @property
    def size(self) -> float:
        """Radii against an average man's."""
        return self.build.girth * self.build.stature_m / 1.75

    def hung(self, mesh: Mesh, bone: str) -> None:
        """Add a part that hangs on one bone."""
        count = len(mesh.vertices_m)
        self.parts.append((mesh, np.full((count, 2), BONES.index(bone)), np.ones(count)))

    def loft(self, look: Look, levels: list[Level], *, sides: int, caps: bool = True) -> None:
        """Skin over elliptic level rings (centre, half depth, half width, bones), from the bottom up."""
        sides = max(4, sides // 2) if self.low else sides
        ring = np.insert(circle(sides, 0.5), 2, 0.0, axis=1)
        grid = np.stack([c + ring * (d, w, 0.0) for c, d, w, _ in levels])
        self._hang(rings(look, grid, caps=caps, crease_deg=80.0), levels)

    def torso(self) -> None:
        """Hips in the lower clothes, waist to neck in the upper ones."""
        b, s, j = self.build, self.size, self.rest
        hips, waist, chest, neck = j["pelvis"], 0.5 * (j["pelvis"] + j["chest"]), j["chest"], j["neck"]
        reach = 0.5 * float(np.abs(j["shoulder_l"][1] - j["shoulder_r"][1]))
        seat: Hang = ("pelvis", "pelvis", 1.0)
        middle: Hang = ("pelvis", "chest", 0.5)
        upper: Hang = ("chest", "chest", 1.0)
        lower = [
            (hips - up(0.115 * s), 0.075 * s, 0.10 * s * b.hips, seat),
            (hips - up(0.05 * s), 0.112 * s, 0.165 * s * b.hips, seat),
            (hips + up(0.04 * s), 0.118 * s, 0.168 * s * b.hips, seat),
        ]
        self.loft(self.look(b.upper if b.coat else b.lower), lower, sides=12)
        hem = 0.03 if not b.coat else 0.09
        levels = [
            (hips - up(hem * s), 0.126 * s * math.sqrt(b.belly), 0.182 * s * b.hips, seat),
            (waist, 0.112 * s * b.belly, 0.152 * s * math.sqrt(b.belly), middle),
            (chest, 0.118 * s, 0.168 * s, upper),
            (chest + 0.45 * (neck - chest), 0.112 * s, 0.95 * reach, upper),
            (chest + 0.74 * (neck - chest), 0.092 * s, reach, upper),
            (chest + 0.90 * (neck - chest), 0.072 * s, 0.66 * reach, upper),
            (neck - up(0.004), 0.058 * s, 0.064 * s, upper),
        ]
        self.loft(self.look(b.upper), levels, sides=14)
        if b.inner is not None and not self.low:
            self._shirt_front(self.look(b.inner), levels)

    def _shirt_front(self, look: Look, levels: list[Level]) -> None:
        """Strip of another colour down the front between the halves of an open jacket."""
        grid = []
        halves = (0.05, 0.055, 0.06, 0.06, 0.05, 0.04, 0.03)
        for (centre, depth, width, _), half in zip(levels, halves, strict=True):
            y = np.array([-half, -0.4 * half, 0.4 * half, half]) * self.size
            x = depth * np.sqrt(np.maximum(1 - (y / width) ** 2, 0.0)) + 0.004
            grid.append(np.stack([centre[0] + x, y, np.full(4, centre[2])], axis=-1))
        triangles = grid_triangles(len(levels), 4)
        self._hang(surface(look, np.concatenate(grid), triangles, crease_deg=80.0), levels)

    def _hang(self, mesh: Mesh, levels: list[Level]) -> None:
        """Add a part whose vertices hang on the bones of the level that is nearest in height."""
        heights = np.array([centre[2] for centre, *_ in levels])
        row = np.argmin(np.abs(mesh.vertices_m[:, 2:] - heights), axis=1)
        bones = np.array([[BONES.index(name) for name in hang[:2]] for *_, hang in levels])
        self.parts.append((mesh, bones[row], np.array([hang[2] for *_, hang in levels])[row]))

    def leg(self, side: str) -> None:
        """Leg and shoe of one side, ``_l`` or ``_r``."""
        b, s, j = self.build, self.size, self.rest
        hip, knee, ankle = (j[name + side] for name in ("hip", "knee", "ankle"))
        thigh, shank = "thigh" + side, "shank" + side
        bare = b.skirt or b.shorts
        cloth, skin = self.look(b.lower), self.look(b.skin, Material.SKIN)

        def at(a: Array, c: Array, t: float) -> Array:
            return a + t * (c - a)

        upper = [
            (at(hip, knee, 1.0), 0.060 * s, 0.057 * s, (thigh, shank, 0.5)),
            (at(hip, knee, 0.86), 0.064 * s, 0.061 * s, (thigh, shank, 0.9)),
            (at(hip, knee, 0.45), 0.078 * s, 0.074 * s, (thigh, thigh, 1.0)),
            (at(hip, knee, 0.10), 0.092 * s, 0.084 * s * math.sqrt(b.hips), (thigh, "pelvis", 0.8)),
            (at(hip, knee, -0.12), 0.088 * s, 0.078 * s * math.sqrt(b.hips), (thigh, "pelvis", 0.45)),
        ]
        loose = 1.0 if bare else 1.12
        lower = [
            (ankle + up(0.01), 0.038 * s * loose**2, 0.036 * s * loose**2, (shank, "foot" + side, 0.85)),
            (at(knee, ankle, 0.70), 0.042 * s * loose, 0.041 * s * loose, (shank, shank, 1.0)),
            (at(knee, ankle, 0.32) - by(0.008, 0, 0), 0.058 * s, 0.054 * s, (shank, shank, 1.0)),
            (at(knee, ankle, 0.10), 0.056 * s, 0.053 * s, (shank, thigh, 0.85)),
            (knee, 0.060 * s, 0.057 * s, (shank, thigh, 0.5)),
        ]
        if self.low:
            upper, lower = upper[::2], lower[::2]
        if b.coat:
            # Covered by it, and of its colour, so that a fold of it is all that may show.
            middle = len(upper) // 2
            self.loft(self.look(b.upper), upper[middle:], sides=8)
            upper = upper[: middle + 1]
        self._limb(cloth, skin if bare else cloth, upper, lower)
        self._shoe(side)

    def _limb(self, upper_look: Look, lower_look: Look, upper: list[Level], lower: list[Level]) -> None:
        """Upper and lower half of a limb, in one skin where both wear the same."""
        if upper_look == lower_look:
            self.loft(upper_look, lower[:-1] + upper, sides=8)
            return
        self.loft(upper_look, upper, sides=8)
        self.loft(lower_look, lower, sides=8)

    def _shoe(self, side: str) -> None:
        """Shoe from heel to toe tip, a little wider than the foot, its sole on the ground."""
        s, j = self.size, self.rest
        ankle, toe = j["ankle" + side], j["toe" + side]
        heel, ball, tip = shoe_sole(ankle, toe)
        middle = 0.5 * (heel + ball)
        levels = [
            (heel, 0.028, 0.050), (heel + 0.1 * (ball - heel), 0.036, 0.078), (middle, 0.038, 0.085),
            (ball, 0.046, 0.055), (ball + 0.6 * (tip - ball), 0.042, 0.042), (tip, 0.022, 0.026),
        ]  # fmt: skip
        if self.low:
            levels = [levels[k] for k in (0, 2, 5)]
        # Across the shoe: share of its half width, share of its height.
        outline = ((-1, 0), (1, 0), (0.85, 0.7), (0.4, 1), (-0.4, 1), (-0.85, 0.7))
        grid = [[c + by(0.0, a * w * s, b * h) for a, b in outline] for c, w, h in levels]
        self.hung(rings(self.look(self.build.shoes), np.array(grid), crease_deg=60.0), "foot" + side)

    def arm(self, side: str) -> None:
        """Arm and hand of one side, ``_l`` or ``_r``."""
        b, s, j = self.build, self.size, self.rest
        shoulder, elbow, hand = (j[name + side] for name in ("shoulder", "elbow", "hand"))
        arm, fore = "arm" + side, "fore" + side
        wrist = elbow + 0.66 * (hand - elbow)
        cloth, skin = self.look(b.upper), self.look(b.skin, Material.SKIN)
        inward = np.array([0.0, -0.012 if side == "_l" else 0.012, 0.0]) * s
        upper = [
            (elbow, 0.043 * s, 0.040 * s, (arm, fore, 0.5)),
            (elbow + 0.15 * (shoulder - elbow), 0.046 * s, 0.043 * s, (arm, fore, 0.9)),
            (elbow + 0.60 * (shoulder - elbow), 0.052 * s, 0.048 * s, (arm, arm, 1.0)),
            (shoulder - up(0.02 * s) + inward, 0.060 * s, 0.050 * s, (arm, "chest", 0.7)),
            (shoulder + up(0.020 * s) + 2.0 * inward, 0.040 * s, 0.034 * s, ("chest", arm, 0.7)),
        ]
        lower = [
            (wrist, 0.030 * s, 0.026 * s, (fore, fore, 1.0)),
            (elbow + 0.30 * (wrist - elbow), 0.043 * s, 0.039 * s, (fore, fore, 1.0)),
            (elbow + 0.02 * (wrist - elbow), 0.043 * s, 0.040 * s, (fore, arm, 0.55)),
        ]
        if self.low:
            upper, lower = upper[::2], lower[::2]
        self._limb(cloth, skin if b.short_sleeves else cloth, upper, lower)
        if self.low:
            return
        palm = wrist + 0.50 * (hand - wrist)
        self.hung(ellipsoid(skin, palm, (0.036 * s, 0.020 * s, 0.062 * s), 5, 7), fore)
        thumb = palm + by(0.034 * s, 0.0, 0.012)
        self.hung(ellipsoid(skin, thumb, (0.013 * s, 0.013 * s, 0.034 * s), 4, 5), fore)

    @property
    def head_size(self) -> float:
        """Size of the head: a man's is 1."""
        return 0.50 + 0.50 * self.build.stature_m / 1.75


def up(z_m: float) -> Array:
    """Offset upwards [m]."""
    return np.array([0.0, 0.0, z_m])


def by(x_m: float, y_m: float, z_m: float) -> Array:
    """Offset ahead, to the left and upwards [m]."""
    return np.array([x_m, y_m, z_m])
