"""Fittings of underpasses: cladding, cable trays, lamps, downpipes, emergency stations."""

import itertools
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import Stretch
from carlaloc_env.scenery.meshing.collision_mesh import posts
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder

LAMP_STEP_M, LAMP_ROWS = 9, (0.27, 0.73)
"""Distance of lamps along the roof [m], and shares of the width at which their rows hang."""
LAMP_M = (1.2, 0.34, 0.14)
"""Length, width and height of a lamp's housing [m]."""
PANEL_M, PANEL_GAP_M, PANEL_DEPTH_M, PANEL_Z_M = 2.4, 0.12, 0.06, (0.45, 3.1)
"""Length of a cladding panel, gap to the next, how far it stands out, lower and upper edge [m]."""
TRAY_DROP_M, TRAY_WIDTH_M, BRACKET_STEP_M = 0.75, 0.35, 1.5
"""Depth of cable trays below the roof, their width, and the distance of their brackets [m]."""
PIPE_BAYS, PIPE_M = 3, 0.07
"""Bays between buttresses to each downpipe, and its radius [m]."""
STATION_STEP_M, STATION_M = 150.0, (0.9, 0.3, 2.05)
"""Farthest distance of emergency stations (EU directive 2004/54/EC), and length, depth, height of one [m]."""
_PANEL = (196, 192, 178)
_ORANGE = (205, 62, 6)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """One side of a roofed run, a point per metre."""

    foot_m: Array
    """Foot of the wall [m], shape (N, 3)."""
    inward: Array
    """Unit vectors into the underpass, shape (N, 3)."""
    roof_m: Array
    """Height of the roof's underside [m], shape (N,)."""

    def block(self, begin: float, end: float, depth_m: float, low_m: Array, high_m: Array) -> Array:
        """A box on the wall without its back, shape (5, 4, 3).

        Args:
            begin: Where along the wall it begins [m].
            end: Where it ends, greater than `begin` [m].
            depth_m: How far it stands out [m].
            low_m: Heights of its lower edge at both ends [m], shape (2,).
            high_m: The same of its upper edge.
        """
        at = np.array([begin, end])
        rows = np.arange(float(len(self.foot_m)))
        base = interpolated(at, rows, self.foot_m)
        out = interpolated(at, rows, self.inward) * depth_m
        corners = np.zeros((2, 2, 2, 3))
        for z, heights in enumerate((low_m, high_m)):
            for front in (0, 1):
                corners[:, front, z] = base + front * out
                corners[:, front, z, 2] = heights
        # Seen from inside, the line runs to the right where the inward side lies on its left.
        step = base[1] - base[0]
        if step[0] * out[0, 1] - step[1] * out[0, 0] > 0.0:
            corners = corners[::-1]
        (a, b), (c, d) = corners[0], corners[1]
        face, sides = [b[0], d[0], d[1], b[1]], ([a[0], b[0], b[1], a[1]], [d[0], c[0], c[1], d[1]])
        top, bottom = [b[1], d[1], c[1], a[1]], [a[0], c[0], d[0], b[0]]
        return np.array([face, *sides, top, bottom])

    def above_foot(self, begin: float, end: float, height_m: float) -> Array:
        """Heights above the foot at two places [m], shape (2,)."""
        rows = np.arange(len(self.foot_m))
        heights: Array = np.interp([begin, end], rows, self.foot_m[:, 2]) + height_m
        return heights

    def below_roof(self, begin: float, end: float, drop_m: float) -> Array:
        """Heights below the roof at two places [m], shape (2,)."""
        rows = np.arange(len(self.foot_m))
        heights: Array = np.interp([begin, end], rows, self.roof_m) - drop_m
        return heights


def add_fittings(
    out: MeshBuilder, stretch: Stretch, roof_m: Array, rows: slice, outward: Array, buttresses: Index
) -> Array:
    """Fit out a roofed run; gives its lamps [m], shape (K, 3).

    Args:
        out: Where it goes.
        stretch: The sunken road.
        roof_m: Underside of the roof at each of its points [m].
        rows: Its points below the roof.
        outward: Unit vectors to the left at each of its points, shape (N, 3).
        buttresses: Points at which buttresses stand, between which the cladding lies.
    """
    between = buttresses[(buttresses >= rows.start) & (buttresses < rows.stop)] - rows.start
    for line, sign in ((stretch.left_m, -1.0), (stretch.right_m, 1.0)):
        wall = Wall(foot_m=line[rows], inward=sign * outward[rows], roof_m=roof_m[rows])
        stations = _stations(len(wall.foot_m), between)
        _cladding(out, wall, between, stations)
        for station in stations:
            _emergency_station(out, wall, station)
        _cable_tray(out, wall)
        _downpipes(out, wall, between)
    return _lamps(out, stretch, roof_m, rows, outward)


def _stations(length: int, buttresses: Index) -> list[float]:
    """Places of emergency stations: midway between buttresses, in the middle of each part of the run."""
    bays = 0.5 * (buttresses[:-1] + buttresses[1:])
    if not len(bays):
        return []
    count = max(int(np.ceil(length / STATION_STEP_M)), 1)
    wanted = (np.arange(count) + 0.5) * length / count
    return sorted({float(bays[np.argmin(np.abs(bays - place))]) for place in wanted})


def _cladding(out: MeshBuilder, wall: Wall, buttresses: Index, stations: list[float]) -> None:
    """Two panels in each bay between buttresses, but none behind an emergency station."""
    faces = []
    for bay in 0.5 * (buttresses[:-1] + buttresses[1:]):
        if bay in stations:
            continue
        for begin in (bay - PANEL_M - 0.5 * PANEL_GAP_M, bay + 0.5 * PANEL_GAP_M):
            end = begin + PANEL_M
            low, high = (wall.above_foot(begin, end, z) for z in PANEL_Z_M)
            faces.append(wall.block(begin, end, PANEL_DEPTH_M, low, high))
    _put(out, faces, Material.METAL_PAINTED, Tag.WALL, _PANEL)


def _emergency_station(out: MeshBuilder, wall: Wall, at: float) -> None:
    """A cabinet with telephone and extinguishers, and a sign above it that stands off the wall."""
    length, depth, height = STATION_M
    begin, end = at - 0.5 * length, at + 0.5 * length
    low, high = (wall.above_foot(begin, end, z) for z in (0.15, height))
    cabinet = wall.block(begin, end, depth, low, high)
    _put(out, [cabinet], Material.METAL_PAINTED, Tag.STATIC, _ORANGE)
    begin, end = at - 0.03, at + 0.03
    for drop, reach, colour in ((0.0, 0.62, (232, 232, 228)), (0.08, 0.56, _ORANGE)):
        low, high = (wall.above_foot(begin - drop / 8, end + drop / 8, z) for z in (2.5 + drop, 3.1 - drop))
        plate = wall.block(begin - drop / 8, end + drop / 8, reach, low, high)
        _put(out, [plate], Material.METAL_PAINTED, Tag.TRAFFIC_SIGN, colour)


def _cable_tray(out: MeshBuilder, wall: Wall) -> None:
    """A tray along the whole wall on brackets."""
    last = len(wall.foot_m) - 1
    ends = [*np.arange(0.0, last - 1.0, 3.0), float(last)]
    faces = []
    for begin, end in itertools.pairwise(ends):
        high = wall.below_roof(begin, end, TRAY_DROP_M)
        faces.append(wall.block(begin, end, TRAY_WIDTH_M, high - 0.06, high))
    for at in np.arange(0.5, last, BRACKET_STEP_M):
        high = wall.below_roof(at - 0.03, at + 0.03, TRAY_DROP_M + 0.06)
        faces.append(wall.block(at - 0.03, at + 0.03, TRAY_WIDTH_M - 0.04, high - 0.22, high))
    _put(out, faces, Material.METAL_GALVANISED, Tag.STATIC, (186, 188, 190))


def _downpipes(out: MeshBuilder, wall: Wall, buttresses: Index) -> None:
    """Pipes beside buttresses, from the tray to the ground."""
    places = buttresses[::PIPE_BAYS]
    along = np.gradient(wall.foot_m, axis=0)[places]
    bases_m = wall.foot_m[places] + 0.5 * along + 0.1 * wall.inward[places]
    bases_m[:, 2] -= 0.1
    height = wall.roof_m[places] - TRAY_DROP_M - bases_m[:, 2]
    faces = posts(bases_m, PIPE_M, height)
    out.quads(faces, material=Material.METAL_GALVANISED, tag=Tag.STATIC, colour=(150, 152, 150))


def _lamps(out: MeshBuilder, stretch: Stretch, roof_m: Array, rows: slice, outward: Array) -> Array:
    """Two rows of lamps below the roof; their sources [m], shape (K, 3)."""
    left, right = stretch.left_m[rows].copy(), stretch.right_m[rows].copy()
    left[:, 2] = right[:, 2] = roof_m[rows]
    at = np.arange(2, len(left) - 2, LAMP_STEP_M)
    length, width, height = LAMP_M
    sources = [np.zeros((0, 3))]
    for share in LAMP_ROWS:
        middle = (left + share * (right - left))[at]
        side = 0.5 * width * outward[rows][at]
        across = outward[rows][at]
        ahead = 0.5 * length * np.stack([across[:, 1], -across[:, 0], np.zeros(len(at))], axis=-1)
        # Anticlockwise seen from above; the left side lies on its left.
        corners = ((-1, 1), (-1, -1), (1, -1), (1, 1))
        ring = np.stack([middle + i * ahead + j * side for i, j in corners], axis=1)
        low = ring - np.array([0.0, 0.0, height + 0.1])
        high = ring - np.array([0.0, 0.0, 0.1])
        sides = np.stack([low, np.roll(low, -1, 1), np.roll(high, -1, 1), high], axis=2).reshape(-1, 4, 3)
        out.quads(sides, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=(120, 122, 124))
        out.quads(low[:, ::-1], material=Material.LAMP_WHITE, tag=Tag.STATIC)
        sources.append(middle - np.array([0.0, 0.0, height + 0.2]))
    return np.concatenate(sources)


def _put(
    out: MeshBuilder, faces: list[Array], material: Material, tag: Tag, colour: tuple[int, int, int]
) -> None:
    if faces:
        out.quads(np.concatenate(faces), material=material, tag=tag, colour=colour)
