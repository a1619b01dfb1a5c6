"""One wall of a building in its own coordinates, and the shapes that facades are made of.

The look of one building, chosen from its style, and faces in its materials.

Ground floors of glass: shops with signs and awnings, and lobbies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import WHITE, Colour
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.styles import Style
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, cell_uv


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """A vertical rectangle: a runs along it, b out of it, z up.

    Every shape is given by arrays of its limits (N,) or numbers, and comes back as quads (M, 4, 3) in the
    building's frame, anticlockwise seen from where they can be seen.
    """

    origin_m: Array
    """Foot of the wall's left end, seen from outside [m], shape (3,)."""
    along: Array
    """Unit vector along a, horizontal, shape (3,)."""
    width_m: float
    """Length of the wall [m]."""

    def moved(self, shift_m: tuple[float, float, float]) -> Wall:
        """The same wall somewhere else."""
        return replace(self, origin_m=self.origin_m + np.array(shift_m))

    def points(self, a: ArrayLike, b: ArrayLike, z: ArrayLike) -> Array:
        """Points [m] of wall coordinates, shape (..., 3)."""
        a, b, z = (np.asarray(x, dtype=np.float64) for x in (a, b, z))
        c, s = float(self.along[0]), float(self.along[1])
        points = np.empty((*np.broadcast(a, b, z).shape, 3))
        points[..., 0] = self.origin_m[0] + a * c + b * s
        points[..., 1] = self.origin_m[1] + a * s - b * c
        points[..., 2] = self.origin_m[2] + z
        return points

    def front(self, a0: ArrayLike, a1: ArrayLike, z0: ArrayLike, z1: ArrayLike, b: ArrayLike = 0.0) -> Array:
        """Faces that look outwards."""
        return self._faces(_FRONT, a0, a1, b, b, z0, z1)

    def top(self, a0: ArrayLike, a1: ArrayLike, b0: ArrayLike, b1: ArrayLike, z: ArrayLike) -> Array:
        """Faces that look up."""
        return self._faces(_TOP, a0, a1, b0, b1, z, z)

    def left_side(self, a: ArrayLike, b0: ArrayLike, b1: ArrayLike, z0: ArrayLike, z1: ArrayLike) -> Array:
        """Faces that look against a."""
        return self._faces(_LEFT, a, a, b0, b1, z0, z1)

    def right_side(self, a: ArrayLike, b0: ArrayLike, b1: ArrayLike, z0: ArrayLike, z1: ArrayLike) -> Array:
        """Faces that look along a."""
        return self._faces(_RIGHT, a, a, b0, b1, z0, z1)

    def box(
        self,
        a0: ArrayLike,
        a1: ArrayLike,
        z0: ArrayLike,
        z1: ArrayLike,
        out: ArrayLike,
        inner: ArrayLike = 0.0,
    ) -> Array:
        """Boxes that stand out of the wall from `inner` to `out` [m], without their backs."""
        return self._faces(_BOX, a0, a1, inner, out, z0, z1)

    def reveal(self, a0: ArrayLike, a1: ArrayLike, z0: ArrayLike, z1: ArrayLike, depth: ArrayLike) -> Array:
        """The four inner faces of openings that go `depth` [m] into the wall."""
        return self._faces(_REVEAL, a0, a1, -np.asarray(depth, dtype=np.float64), 0.0, z0, z1)

    def _faces(self, table: NDArray[np.int64], *limits: ArrayLike) -> Array:
        """Quads of a table of faces, one face after the other for all N shapes, (F · N, 4, 3).

        Args:
            table: Number of the limit of each corner along a, b and z, shape (3, F, 4).
            limits: Least and largest a, b and z [m], (N,) or numbers.
        """
        sizes = [np.size(limit) for limit in limits]
        count = max(sizes) if all(sizes) else 0
        if count == 0:
            return np.zeros((0, 4, 3))
        values = np.empty((6, count))
        for k, limit in enumerate(limits):
            values[k] = limit
        a, b, z = values[table]
        c, s = float(self.along[0]), float(self.along[1])
        quads = np.empty((a.shape[0], count, 4, 3))
        x, y, up = np.moveaxis(quads, (3, 0, 2, 1), (0, 1, 2, 3))
        np.add(self.origin_m[0] + a * c, b * s, out=x)
        np.subtract(self.origin_m[1] + a * s, b * c, out=y)
        np.add(self.origin_m[2], z, out=up)
        return quads.reshape(-1, 4, 3)


def _table(*faces: str) -> NDArray[np.int64]:
    """Faces from their corners: least (0) or largest (1) a, b and z of each, for instance 000 100 101."""
    numbers = np.array([[[int(c) for c in corner] for corner in face.split()] for face in faces])
    return np.moveaxis(numbers + np.array([0, 2, 4]), 2, 0)


_OUTER, _TOP, _BOTTOM = _table("010 110 111 011"), _table("001 011 111 101"), _table("000 100 110 010")
_FRONT, _LEFT, _RIGHT = _table("000 100 101 001"), _table("000 010 011 001"), _table("110 100 101 111")
_BOX = np.concatenate([_OUTER, _LEFT, _RIGHT, _TOP, _BOTTOM], axis=1)
_REVEAL = _table("010 000 001 011", "100 110 111 101", "000 010 110 100", "001 101 111 011")


def around(width_m: float, depth_m: float, base_m: float = 0.0) -> list[Wall]:
    """Walls of a rectangle whose front runs from (0, 0) to (width, 0): front, right, back, left."""
    corners = np.array([(0, 0), (width_m, 0), (width_m, depth_m), (0, depth_m)], dtype=np.float64)
    walls = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        along = np.append((end - start) / length, 0.0)
        walls.append(Wall(origin_m=np.append(start, base_m), along=along, width_m=length))
    return walls


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """The look of one building, chosen from its style."""

    style: Style
    """The style."""
    material: Material
    """Material of the walls."""
    tint: Colour
    """Linear tint of the walls."""
    trim: Colour
    """Linear tint of sills, cornices and frames."""
    sign: Colour
    """Linear tint of shop signs and awnings."""
    accent: Colour = (60, 64, 66)
    """Linear tint of shutters, rails, doors' canopies and timber."""
    roof: tuple[Material, Colour] = (Material.ROOF_TILE, (255, 235, 220))
    """Material of a pitched roof with its linear tint."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shell:
    """The faces of one building in the making."""

    out: MeshBuilder
    """Where they go, in the building's frame."""
    look: Appearance
    """Materials and tints."""

    def faces(
        self, quads: Array, material: Material, colour: ArrayLike = WHITE, *, uv_m: Array | None = None
    ) -> None:
        """Add faces of any material."""
        self.out.quads(quads, material=material, tag=Tag.BUILDING, colour=colour, uv_m=uv_m)

    def pictures(
        self, quads: Array, material: Material, cell: NDArray[np.integer], aspect: float = 1.0
    ) -> None:
        """Add upright faces that each show one picture of a material, as `cell_uv` counts them."""
        self.faces(quads, material, uv_m=cell_uv(material, cell, aspect))

    def wall(self, quads: Array) -> None:
        """Add faces in the building's wall material."""
        self.faces(quads, self.look.material, self.look.tint)

    def trim(self, quads: Array, material: Material = Material.CONCRETE) -> None:
        """Add faces in the colour of its sills and cornices."""
        self.faces(quads, material, self.look.trim)

    def accent(self, quads: Array, material: Material) -> None:
        """Add faces in the colour of its shutters and rails."""
        self.faces(quads, material, self.look.accent)

    def roof(self, quads: Array) -> None:
        """Add faces in the material of its pitched roof."""
        self.faces(quads, *self.look.roof)


GARAGE_DOOR = 3
"""The door picture that is a garage's; those before it are for people."""


def street_storey(
    shell: Shell,
    wall: Wall,
    centre: Array,
    pitch: float,
    z0: float,
    z1: float,
    rng: np.random.Generator,
) -> None:
    """Ground floor of glass between piers: shops with sign bands and awnings, or a lobby."""
    shop = shell.look.style.ground == "shop"
    group = max(1, round((4.2 if shop else 3.2) / pitch))
    edges = np.append(np.arange(0, len(centre), group), len(centre)) * pitch + 0.4
    pier = 0.28
    a0, a1 = edges[:-1] + pier, edges[1:] - pier
    riser, head = z0 + (0.4 if shop else 0.15), z1 - (0.95 if shop else 0.6)
    recess = 0.25
    door = int(rng.integers(0, len(a0)))
    low = np.full(len(a0), riser)
    low[door] = z0
    shell.wall(wall.front(0.0, wall.width_m, head, z1))
    ends0, ends1 = np.append(0.0, a1), np.append(a0, wall.width_m)
    shell.wall(wall.front(ends0, ends1, z0, head))
    others = np.arange(len(a0)) != door
    shell.trim(wall.front(a0[others], a1[others], z0, riser))
    shell.wall(wall.front(0.0, wall.width_m, z0, z1, -recess - 0.05))
    shell.trim(wall.reveal(a0, a1, low, head, recess))
    pane = wall.front(a0[others], a1[others], riser, head, -recess)
    pick = rng.integers(0, 1 << 16, int(others.sum()))
    if shop:
        for material, rows in (
            (Material.SHOP_FRONT, pick % 2 == 0),
            (Material.SHOP_FRONT_B, pick % 2 == 1),
        ):
            shell.pictures(pane[rows], material, pick[rows] // 2)
    else:
        shell.faces(pane, Material.CURTAIN_WALL)
    _door_bay(shell, wall, float(a0[door]), float(a1[door]), z0, head, recess, rng)
    if shop:
        _shop_signs(shell, wall, a0, a1, head, rng)


def _door_bay(
    shell: Shell,
    wall: Wall,
    a0: float,
    a1: float,
    z0: float,
    head: float,
    recess: float,
    rng: np.random.Generator,
) -> None:
    middle, half = (a0 + a1) / 2, min(0.55, (a1 - a0) / 2 - 0.05)
    top = min(z0 + 2.25, head)
    door = wall.front(middle - half, middle + half, z0, top, -recess)
    shell.pictures(door, Material.DOOR, rng.integers(0, GARAGE_DOOR, 1))
    sides = wall.front(
        np.array([a0, middle + half, middle - half]),
        np.array([middle - half, a1, middle + half]),
        np.array([z0, z0, top]),
        np.array([head, head, head]),
        -recess,
    )
    shell.pictures(sides, Material.WINDOW, rng.integers(0, 1 << 16, 3))
    shell.trim(wall.box(middle - half - 0.08, middle + half + 0.08, top, top + 0.1, -recess + 0.1, -recess))


def _shop_signs(
    shell: Shell,
    wall: Wall,
    a0: Array,
    a1: Array,
    head: float,
    rng: np.random.Generator,
) -> None:
    band = wall.box(a0, a1, head + 0.08, head + 0.78, 0.12)
    shell.faces(band, Material.METAL_PAINTED, shell.look.sign)
    plate = wall.front(a0 + 0.08, a1 - 0.08, head + 0.14, head + 0.72, 0.13)
    pick = rng.integers(0, 1 << 16, len(a0))
    shell.pictures(plate, Material.SHOP_SIGN, pick)
    _blades(shell, wall, a1[pick % 3 == 0] - 0.1, head, pick[pick % 3 == 0])
    awned = rng.random(len(a0)) < 0.45
    if awned.any():
        left, right = a0[awned], a1[awned]
        low, high, depth = head - 0.45, head + 0.05, 1.15
        slope = np.stack(
            [
                wall.points(left, depth, low),
                wall.points(right, depth, low),
                wall.points(right, 0.02, high),
                wall.points(left, 0.02, high),
            ],
            axis=1,
        )
        valance = wall.front(left, right, low - 0.2, low, depth)
        both = np.concatenate([slope, slope[:, ::-1], valance, valance[:, ::-1]])
        shell.faces(both, Material.CLOTH, tuple(max(1, c - 20) for c in shell.look.sign))


def _blades(shell: Shell, wall: Wall, a: Array, head: float, pick: NDArray[np.int64]) -> None:
    """Small signs that stand out of the wall, readable along the sidewalk from both sides."""
    if not len(a):
        return
    low, high = head + 0.95, head + 1.65
    arm = wall.box(a - 0.02, a + 0.02, high + 0.02, high + 0.06, 0.85)
    shell.faces(arm, Material.METAL_PAINTED, (30, 30, 32))
    left = wall.left_side(a - 0.03, 0.15, 0.85, low, high)
    right = wall.right_side(a + 0.03, 0.15, 0.85, low, high)
    for side in (left, right):
        shell.pictures(side, Material.POSTER, pick, aspect=1.4)
