"""Houses on given outlines: facades along their edges, courtyards, shared walls, passages, any roof."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area, polygons_of, rings, without
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour, Mesh
from carlaloc_env.scenery.buildings.buildings import FOUNDATION_M, draw_appearance
from carlaloc_env.scenery.buildings.facades import facade
from carlaloc_env.scenery.buildings.footprint_roofs import (
    PARAPET_M,
    USUAL_PITCH_DEG,
    add_footprint_roof,
    add_level,
    downhill,
    roof_rise,
    towards,
    upright,
)
from carlaloc_env.scenery.buildings.palettes import SLATES, TILES
from carlaloc_env.scenery.buildings.shell import Appearance, Shell
from carlaloc_env.scenery.buildings.styles import STYLES, ZONE_STYLES, Style
from carlaloc_env.scenery.buildings.walls import Wall
from carlaloc_env.scenery.ground.terrain import Terrain, Zones
from carlaloc_env.scenery.mapped import MappedFeature
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import InstanceIds

STREET_M = 16.0
"""Walls that look onto something paved so near are fronts [m]."""
SHORT_M = 1.6
"""Shorter walls have no windows [m]."""
SHARED_M = 0.35
"""A wall with another house this near before it is shared [m]."""
PASSAGE_M = 4.9
"""Free height of a passage through a house [m]."""
CLEAR_M = 0.15
"""Distance of houses from carriageways [m]."""
PASSAGE_M2 = 12.0
"""Houses over more of a carriageway than this have a passage; others are cut [m²]."""
DETAIL_M = 8.0
"""Above this height windows are flush with their wall: cities have many [m]."""
LEAST_M2 = 4.0
"""Smaller remains are left out [m²]."""
PLINTH_M = 1.5
"""On sloping land a floor is level with the highest ground at its walls, but at most so far above the lowest
[m]."""
STYLE_OF_USE = {
    "house": ("house", "villa", "clapboard"), "detached": ("house", "villa", "clapboard"),
    "semidetached_house": ("terrace", "house"), "terrace": ("terrace", "townhouse"),
    "bungalow": ("bungalow",),
    "apartments": ("flats", "brick_walkup", "european", "slab"), "residential": ("brick_walkup", "european"),
    "garage": ("depot",), "garages": ("depot",), "shed": ("barn",), "hut": ("barn",), "barn": ("barn",),
    "farm": ("farmhouse",), "farm_auxiliary": ("barn",), "industrial": ("warehouse", "factory", "depot"),
    "warehouse": ("warehouse", "depot"), "retail": ("shop_row", "pavilion"), "supermarket": ("pavilion",),
    "commercial": ("office", "ribbon", "shop_row"), "office": ("office", "ribbon"),
    "hotel": ("european", "deco"),
    "church": ("civic",), "cathedral": ("civic",), "chapel": ("civic",), "school": ("civic", "flats"),
    "university": ("civic",), "public": ("civic",), "civic": ("civic",), "hospital": ("slab", "office"),
    "train_station": ("civic",), "government": ("civic",),
}  # fmt: skip
"""Styles of houses whose use is tagged."""
MATERIALS = {
    "brick": Material.BRICK_RED, "bricks": Material.BRICK_RED, "plaster": Material.PLASTER,
    "stucco": Material.PLASTER, "stone": Material.ASHLAR, "sandstone": Material.ASHLAR,
    "limestone": Material.ASHLAR, "granite": Material.ASHLAR, "marble": Material.ASHLAR,
    "concrete": Material.CONCRETE_PANEL, "cement_block": Material.CONCRETE_PANEL, "wood": Material.WOOD,
    "timber_framing": Material.PLASTER, "glass": Material.CURTAIN_WALL, "mirror": Material.CURTAIN_WALL,
    "metal": Material.METAL_PAINTED, "steel": Material.METAL_PAINTED, "vinyl": Material.SIDING,
}  # fmt: skip
"""Wall materials by `building:material`."""
ROOFS = {
    "gabled": "gable", "hipped": "hip", "half-hipped": "hip", "pyramidal": "pyramidal", "mansard": "hip",
    "gambrel": "gable", "saltbox": "gable", "skillion": "skillion", "flat": "flat", "dome": "dome",
    "onion": "onion",
    "round": "round", "cone": "cone", "quadruple_saltbox": "hip", "side_hipped": "hip", "sawtooth": "flat",
}  # fmt: skip
"""Roofs that are built by `roof:shape`."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class House:
    """One house, or one part of it, with its place."""

    name: str
    ground: Area
    """Outline where it stands."""
    whole: Area
    """Outline above `open_m`; wider over a passage."""
    look: Appearance
    levels_m: Array
    """Heights of the storeys' lower edges and of the eaves above the base [m]."""
    open_m: float
    """Free height below the whole outline [m]; 0 for none."""
    roof: str
    rise_m: float
    fall: Array
    """Direction (2,) in which a roof of one slope falls."""
    base_m: float
    """Height of its floor [m]."""
    foot_m: float
    """Lowest ground at its walls below the floor [m]."""
    low_m: float
    """Where its walls begin above the base [m]."""

    @property
    def top_m(self) -> float:
        """Height of its walls above the base [m]."""
        return float(self.levels_m[-1]) + (PARAPET_M if self.roof == "flat" else 0.0)


class Houses:
    """All houses of a town."""

    def __init__(
        self,
        features: Sequence[MappedFeature],
        zones: Zones,
        roadway: Area,
        paved: Area,
        ground: Terrain,
        seed: int,
    ) -> None:
        self._paved, self._seed = paved, seed
        self._houses = shapely.STRtree([f.shape for f in features if f.kind == "building"])
        shapely.prepare(roadway)
        shapely.prepare(paved)
        self.all: list[House] = []
        self.left_out: list[str] = []
        """Ids of houses that stand on a carriageway altogether."""
        for feature in features:
            for part in polygons_of(shapely.orient_polygons(shapely.make_valid(feature.shape))):
                self._place(feature, part, zones, roadway, ground)
        self._tree = shapely.STRtree([house.whole for house in self.all])

    def footprints(self) -> list[Area]:
        """Ground under each house that stands on it."""
        return [house.ground for house in self.all if house.low_m < 2.0]

    def boxes(self) -> Array:
        """Walls as coarse faces, shape (N, 4, 3)."""
        faces = [np.zeros((0, 4, 3))]
        for house in self.all:
            for outline, low, high in _masses(house):
                foot = house.base_m + (low if low > 0.0 else -house.foot_m - 1.0)
                for line in rings(outline):
                    faces.append(upright(line[:-1], line[1:], foot, house.base_m + high))
        return np.concatenate(faces)

    def meshes(self, ids: InstanceIds) -> list[Mesh]:
        """Meshes of all houses, with an instance id each."""
        meshes = []
        for number, house in enumerate(self.all):
            moved = np.eye(4)
            moved[2, 3] = house.base_m
            meshes.append(self._mesh(number, house).with_instance(ids.take()).transformed(moved))
        return meshes

    def _place(
        self, feature: MappedFeature, outline: Area, zones: Zones, roadway: Area, ground: Terrain
    ) -> None:
        low = feature.number("min_height_m", 0.0)
        over = shapely.intersection(outline, roadway) if shapely.intersects(outline, roadway) else None
        parts, open_m = [outline], 0.0
        if over is not None and low < PASSAGE_M:
            near = shapely.intersection(roadway, shapely.box(*shapely.buffer(outline, 2.0).bounds))
            parts = polygons_of(without(outline, shapely.buffer(near, CLEAR_M)))
            if over.area > PASSAGE_M2 and feature.number("height_m", 0.0) > PASSAGE_M + 1.5:
                open_m = PASSAGE_M
        parts = [part for part in parts if part.area >= LEAST_M2]
        if not parts and not open_m:
            self.left_out.append(feature.id)
            return
        stands = shapely.MultiPolygon(parts)
        whole = shapely.MultiPolygon([outline]) if open_m else stands
        draw = clock.stream(self._seed, f"house/{feature.id}/{outline.bounds[0]:.2f}")
        style = _style(feature, outline, zones, draw)
        look = _look(feature, style, draw)
        roof = _roof(feature, style, outline)
        height = max(feature.number("height_m", 4.0), 2.2)
        fall = downhill(outline, feature.number("roof_direction_deg", np.nan))
        tagged = feature.number("roof_m", 0.0)
        if roof == "skillion" and tagged == 0.0:
            pitch = np.radians(feature.number("roof_angle_deg", USUAL_PITCH_DEG))
            grade = float(elementary.sin(pitch) / elementary.cos(pitch))
            tagged = grade * float(np.ptp(towards(shapely.get_coordinates(outline), fall)))
        rise = min(roof_rise(outline, roof, tagged), 0.6 * height)
        base, lowest = self._floor(feature, whole, ground)
        self.all.append(
            House(
                name=f"house/{feature.id}", ground=stands, whole=whole, look=look,
                levels_m=_levels(style, height - rise, int(feature.number("levels", 1.0)), low),
                open_m=open_m, roof=roof, rise_m=rise, fall=fall, low_m=low,
                base_m=base, foot_m=base - lowest,
            )
        )  # fmt: skip

    def _floor(self, feature: MappedFeature, whole: Area, ground: Terrain) -> tuple[float, float]:
        """Heights of the floor and of the lowest ground [m]; parts have the floor of their house."""
        around = whole
        if ground.sloping and feature.kind == "part":
            below = self._houses.query(whole.representative_point(), predicate="intersects")
            around = self._houses.geometries[below[0]] if len(below) else whole
        z = ground.height(shapely.get_coordinates(around))
        low, high = round(float(z.min()), 4), round(float(z.max()), 4)
        return (min(high, low + PLINTH_M) if ground.sloping else low), low

    def _mesh(self, number: int, house: House) -> Mesh:
        draw = clock.stream(self._seed, house.name, index=1)
        shell = Shell(out=MeshBuilder(), look=house.look)
        for outline, low, high in _masses(house):
            levels = house.levels_m[(house.levels_m > low + 0.5) & (house.levels_m < high - 0.5)]
            levels = np.concatenate([[low], levels, [high]])
            for line in rings(outline):
                for a, b in itertools.pairwise(line):
                    self._wall(shell, number, a, b, levels, draw)
                if low == 0.0:
                    shell.trim(upright(line[:-1], line[1:], -FOUNDATION_M - house.foot_m, 0.0))
        if house.open_m:
            under = shapely.difference(house.whole, house.ground)
            add_level(shell, under, house.open_m, Material.CONCRETE_PANEL, (214, 212, 206), down=True)
        if house.low_m > 0.0:
            add_level(shell, house.whole, house.low_m, house.look.material, house.look.tint, down=True)
        for part in polygons_of(house.whole):
            z = float(house.levels_m[-1])
            add_footprint_roof(shell, part, z, house.roof, house.rise_m, draw, house.fall)
        return shell.out.build()

    def _wall(
        self, shell: Shell, number: int, a: Array, b: Array, levels: Array, draw: np.random.Generator
    ) -> None:
        length = float(np.hypot(*(b - a)))
        if length < 0.02:
            return
        along = (b - a) / length
        out = np.array([along[1], -along[0]])
        hidden = self._hidden(number, a, b, out)
        top = float(levels[-1])
        if hidden >= top - 0.2:
            return
        wall = Wall(origin_m=np.array([*a, 0.0]), along=np.array([*along, 0.0]), width_m=length)
        if hidden > levels[0] + 1.0:
            # A wall that shows above a lower neighbour has no windows.
            shell.wall(wall.front(0.0, length, hidden, top))
            return
        if length < SHORT_M or top - levels[0] < 2.0:
            shell.wall(wall.front(0.0, length, levels[0], top))
            return
        middle = shapely.Point((a + b) / 2 + out)
        if levels[0] == 0.0 and length > 3.0 and shapely.dwithin(self._paved, middle, STREET_M):
            facade(shell, wall, levels, draw, front=True)
        else:
            _plain(shell, wall, levels, draw)

    def _hidden(self, number: int, a: Array, b: Array, out: Array) -> float:
        """Height up to which other houses stand before a wall [m]."""
        points = shapely.points([a + share * (b - a) + SHARED_M * out for share in (0.2, 0.5, 0.8)])
        own = self.all[number]
        heights = np.full(3, 0.0)
        for at, other in zip(*self._tree.query(points, predicate="intersects"), strict=True):
            if other != number:
                house = self.all[other]
                if house.low_m < 0.5 and not house.open_m:
                    heights[at] = max(heights[at], house.base_m + float(house.levels_m[-1]) - own.base_m)
        return float(heights.min())


def _masses(house: House) -> list[tuple[Area, float, float]]:
    """Outlines with the heights between which their walls stand."""
    top = float(house.levels_m[-1])
    if house.open_m:
        return [(house.ground, 0.0, house.open_m), (house.whole, house.open_m, top)]
    return [(house.whole, house.low_m, top)]


def _plain(shell: Shell, wall: Wall, levels: Array, draw: np.random.Generator) -> None:
    """A wall that is seen from afar: windows are flush with it."""
    style = shell.look.style
    shell.wall(wall.front(0.0, wall.width_m, levels[0], levels[-1]))
    bays = max(1, round((wall.width_m - 0.8) / style.bay_m))
    pitch = (wall.width_m - 0.8) / bays
    width = min(style.window_m[0], pitch - 0.3)
    if width < 0.4:
        return
    centre = 0.4 + pitch * (np.arange(bays) + 0.5)
    sill = levels[:-1] + style.sill_m
    head = np.minimum(sill + style.window_m[1], levels[1:] - 0.15)
    fits = head - sill > 0.5
    a, low = (grid.ravel() for grid in np.meshgrid(centre, sill[fits]))
    _, high = (grid.ravel() for grid in np.meshgrid(centre, head[fits]))
    if len(a):
        glass = Material.WINDOW_WIDE if style.wide else Material.WINDOW
        panes = wall.front(a - width / 2, a + width / 2, low, high, 0.02)
        shell.pictures(panes, glass, draw.integers(0, 1 << 16, len(a)))


def _style(feature: MappedFeature, outline: Area, zones: Zones, draw: np.random.Generator) -> Style:
    """A style that suits use, zone and number of storeys."""
    levels = feature.number("levels", 2.0)
    names = STYLE_OF_USE.get(str(feature.properties.get("use", "")), ())
    if names:
        options = [(name, 1.0) for name in names]
    else:
        place = np.asarray(outline.representative_point().coords[0])
        options = list(ZONE_STYLES[zones.kind_at(place, zones.default)]) or list(ZONE_STYLES["small_town"])
    fits = [
        (name, weight) for name, weight in options
        if STYLES[name].storeys[0] - 1 <= levels <= STYLES[name].storeys[1] + 2
    ]  # fmt: skip
    if not fits and not names:
        fits = [("office", 1.0), ("slab", 1.0)] if levels > 6 else [("european", 1.0), ("townhouse", 1.0)]
    chosen = fits or options
    weights = np.array([weight for _, weight in chosen])
    style = STYLES[chosen[int(draw.choice(len(chosen), p=weights / weights.sum()))][0]]
    if feature.properties.get("shop") and style.ground == "dwelling":
        style = replace(style, ground="shop")
    # What stands out of a rectangle's front would hang over the corners of other outlines.
    kept = tuple(o for o in style.ornaments if o in ("shutters", "plinth", "bands", "spandrels", "quoins"))
    reach = (min(style.cornice_m[0], 0.12), style.cornice_m[1])
    return replace(style, ornaments=kept, cornice_m=reach, balconies=0.4 * style.balconies, detail_m=DETAIL_M)


def _look(feature: MappedFeature, style: Style, draw: np.random.Generator) -> Appearance:
    look = draw_appearance(style, draw)
    properties = feature.properties
    material = MATERIALS.get(str(properties.get("material", "")))
    if material is not None:
        tint: Colour = (235, 228, 218) if material != look.material else look.tint
        look = replace(look, material=material, tint=tint)
    if "colour" in properties:
        look = replace(look, tint=_linear(str(properties["colour"])))
        if material is None and look.material in (Material.BRICK_RED, Material.BRICK_BROWN):
            look = replace(look, material=Material.PLASTER)
    covers = {"slate": SLATES[0], "roof_tiles": TILES[0], "tile": TILES[0], "tiles": TILES[0]}
    covers |= {
        "metal": (Material.SHEET_METAL, (205, 205, 208)),
        "copper": (Material.SHEET_METAL, (120, 190, 165)),
    }
    roof = covers.get(str(properties.get("roof_material", "")), look.roof)
    if "roof_colour" in properties:
        roof = (roof[0], _linear(str(properties["roof_colour"])))
    return replace(look, roof=roof)


def _linear(colour: str) -> Colour:
    """Linear tint of six hexadecimal digits of sRGB, about: squared, and brightened for our textures."""
    parts = (int(colour[k : k + 2], 16) / 255.0 for k in (0, 2, 4))
    r, g, b = (int(min(255, 40 + 235 * part * part)) for part in parts)
    return r, g, b


def _roof(feature: MappedFeature, style: Style, outline: Area) -> str:
    tagged = str(feature.properties.get("roof", ""))
    if tagged in ROOFS:
        return ROOFS[tagged]
    if feature.kind == "part" or outline.area > 1500.0 or style.roof in ("flat", "sawtooth"):
        return "flat"
    return {"mansard": "hip", "front_gable": "gable"}.get(style.roof, style.roof)


def _levels(style: Style, eaves_m: float, count: int, low_m: float) -> Array:
    """Edges of the storeys between the foot and the eaves, the ground floor as high as the style has it."""
    height = max(eaves_m - low_m, 2.0)
    count = min(count, max(1, int(height / 2.3)))
    weights = np.full(count, style.storey_m)
    if low_m == 0.0:
        weights[0] = style.ground_m
    steps = np.cumsum(weights) * (height / float(weights.sum()))
    return np.round(np.concatenate([[low_m], low_m + steps]), 4)
