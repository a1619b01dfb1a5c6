"""Walls, roofs and lamps of roads that run below the ground.

Fittings of underpasses: cladding, cable trays, lamps, downpipes, emergency stations.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_graph import grown, runs
from carlaloc_env.scenery.ground.grade_levels import ROOF_M, WALL_M, Levels, Stretch, rows_every
from carlaloc_env.scenery.meshing.collision_mesh import posts
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, extrude

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
    feet = wall.foot_m[places] + 0.5 * along + 0.1 * wall.inward[places]
    feet[:, 2] -= 0.1
    height = wall.roof_m[places] - TRAY_DROP_M - feet[:, 2]
    faces = posts(feet, PIPE_M, height)
    out.quads(faces, material=Material.METAL_GALVANISED, tag=Tag.STATIC, colour=(150, 152, 150))


def _lamps(out: MeshBuilder, stretch: Stretch, roof_m: Array, rows: slice, outward: Array) -> Array:
    """Two rows of lamps below the roof; their sources [m], shape (K, 3)."""
    left, right = stretch.left_m[rows].copy(), stretch.right_m[rows].copy()
    left[:, 2] = right[:, 2] = roof_m[rows]
    at = np.arange(2, len(left) - 2, LAMP_STEP_M)
    length, width, height = LAMP_M
    found = [np.zeros((0, 3))]
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
        found.append(middle - np.array([0.0, 0.0, height + 0.2]))
    return np.concatenate(found)


def _put(
    out: MeshBuilder, faces: list[Array], material: Material, tag: Tag, colour: tuple[int, int, int]
) -> None:
    if faces:
        out.quads(np.concatenate(faces), material=material, tag=tag, colour=colour)


PARAPET_M = 0.95
"""Height of walls and rails above the ground beside a cut [m]."""
BUTTRESS_STEP_M = 6.0
"""Distance of the buttresses of a retaining wall and of the beams of a roof [m]."""
_BUTTRESS_WIDTH_M, _BUTTRESS_DEPTH_M = 0.7, 0.3
_BEAM_WIDTH_M, _BEAM_DEPTH_M = 0.5, 0.3
_GREY = (228, 226, 220)


def add_underpasses(out: MeshBuilder, levels: Levels) -> Array:
    """Walls and roofs of all sunken stretches; gives the places of lamps under roofs [m], shape (K, 3)."""
    return np.concatenate([np.zeros((0, 3)), *(_underpass(out, stretch) for stretch in levels.stretches)])


def _underpass(out: MeshBuilder, stretch: Stretch) -> Array:
    down = np.array([0.0, 0.0, 0.35])
    up = np.array([0.0, 0.0, PARAPET_M])
    outward = _outward(stretch)
    roof_z = _roof_height(stretch)
    for edge, top, sign in (
        (stretch.left_m, stretch.left_top_m, 1.0),
        (stretch.right_m, stretch.right_top_m, -1.0),
    ):
        head = top.copy()
        head[:, 2] = np.where(stretch.detached, np.minimum(roof_z + 0.02, top[:, 2]), top[:, 2])
        _face(out, edge - down, head, sign, Material.CONCRETE_PANEL, Tag.WALL)
        _buttresses(out, stretch, edge - down, head, sign)
        open_cut = grown(~stretch.detached) & (top[:, 2] - edge[:, 2] > 0.3)
        for a, b in runs(open_cut):
            if b - a < 2:
                continue
            inner, outer = top[a:b], top[a:b] + sign * WALL_M * outward[a:b]
            _face(out, inner, inner + up, sign, Material.CONCRETE, Tag.WALL)
            _face(out, outer - 2 * down, outer + up, -sign, Material.CONCRETE, Tag.WALL)
            rows = (outer, inner) if sign > 0 else (inner, outer)
            out.grid(
                np.stack([rows[1] + up, rows[0] + up], axis=1),
                material=Material.CONCRETE,
                tag=Tag.WALL,
                colour=_GREY,
            )
    lamps = [np.zeros((0, 3))]
    for a, b in runs(stretch.detached):
        if b - a > 1:
            _roof(out, stretch, roof_z, a, b)
            at = rows_every(BUTTRESS_STEP_M, roof_z, 1)
            lamps.append(add_fittings(out, stretch, roof_z, slice(a, b), outward, at))
    return np.concatenate(lamps)


def _buttresses(out: MeshBuilder, stretch: Stretch, foot: Array, head: Array, sign: float) -> None:
    """Shallow buttresses before a retaining wall: what a LiDAR can hold on to along a smooth cut."""
    rows = rows_every(BUTTRESS_STEP_M, foot, 1)
    rows = rows[head[rows, 2] - foot[rows, 2] > 1.0]
    along = _ahead(stretch) * 0.5 * _BUTTRESS_WIDTH_M
    inward = -sign * _outward(stretch) * _BUTTRESS_DEPTH_M
    for row in rows:
        step, deep = along[row], inward[row]
        outline = np.array([-step, -step + deep, step + deep, step])
        low, high = foot[row] + outline, head[row] + outline
        _face(out, low, high, sign, Material.CONCRETE, Tag.WALL)
        lid = high if sign > 0 else high[::-1]
        out.quads(lid[None], material=Material.CONCRETE, tag=Tag.WALL, colour=_GREY)


def _beams(out: MeshBuilder, stretch: Stretch, left: Array, right: Array, a: int) -> None:
    """Beams across the underside of a roof."""
    rows = np.arange(int(BUTTRESS_STEP_M), len(left) - 2, int(BUTTRESS_STEP_M))
    if not len(rows):
        return
    step = _ahead(stretch)[a + rows] * 0.5 * _BEAM_WIDTH_M
    down = np.array([0.0, 0.0, _BEAM_DEPTH_M])
    high_l, high_r = left[rows], right[rows]
    low_l, low_r = high_l - down, high_r - down
    faces = [
        np.stack([low_l - step, low_r - step, high_r - step, high_l - step], axis=1),
        np.stack([low_r + step, low_l + step, high_l + step, high_r + step], axis=1),
        np.stack([low_l - step, low_l + step, low_r + step, low_r - step], axis=1),
    ]
    out.quads(np.concatenate(faces), material=Material.CONCRETE, tag=Tag.BRIDGE, colour=_GREY)


def _roof(out: MeshBuilder, stretch: Stretch, roof_z: Array, a: int, b: int) -> None:
    left, right = stretch.left_m[a:b].copy(), stretch.right_m[a:b].copy()
    left[:, 2], right[:, 2] = roof_z[a:b], roof_z[a:b]
    out.grid(
        np.stack([left, right], axis=1),
        material=Material.CONCRETE_PANEL,
        tag=Tag.BRIDGE,
        colour=_GREY,
    )
    _beams(out, stretch, left, right, a)
    for row, sign in ((a, -1.0), (b - 1, 1.0)):
        low_l, low_r = stretch.left_m[row].copy(), stretch.right_m[row].copy()
        low_l[2] = low_r[2] = roof_z[row] - 0.05
        high_l, high_r = stretch.left_top_m[row].copy(), stretch.right_top_m[row].copy()
        high_l[2] += PARAPET_M
        high_r[2] += PARAPET_M
        ahead = _ahead(stretch)[row] * 0.3 * sign
        front = np.array([low_l, low_r, high_r, high_l]) + ahead
        back = np.array([low_r, low_l, high_l, high_r]) - ahead
        lid = np.array([front[3], front[2], back[2], back[3]])
        soffit = np.array([front[1], front[0], back[1], back[0]])
        faces = np.stack([front, back, lid, soffit])
        faces = faces if sign < 0 else faces[:, ::-1]
        out.quads(faces, material=Material.CONCRETE, tag=Tag.BRIDGE, colour=_GREY)


def _face(out: MeshBuilder, low: Array, high: Array, sign: float, material: Material, tag: Tag) -> None:
    """Upright faces; +1 looks to the right of the line, −1 to the left."""
    line, top = (low, high) if sign > 0 else (low[::-1], high[::-1])
    corners, uv = extrude(line, top)
    out.quads(corners, uv_m=uv, material=material, tag=tag, colour=_GREY)


def _roof_height(stretch: Stretch) -> Array:
    """Underside of the roof [m], shape (N,)."""
    return np.minimum(stretch.left_top_m[:, 2], stretch.right_top_m[:, 2]) - ROOF_M


def _outward(stretch: Stretch) -> Array:
    """Unit vectors to the left of the stretch, shape (N, 3)."""
    across = stretch.left_m - stretch.right_m
    across[:, 2] = 0.0
    result: Array = across / np.sqrt(np.sum(across**2, axis=1, keepdims=True))
    return result


def _ahead(stretch: Stretch) -> Array:
    left = _outward(stretch)
    return np.stack([left[:, 1], -left[:, 0], np.zeros(len(left))], axis=-1)
