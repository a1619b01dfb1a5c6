"""Decks, water, rails, wires and parked cars, on maps small enough to build in seconds."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.build import load_town
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.ground.grade_separation import find_levels
from carlaloc_env.town.ground.height_fields import EdgeField, GroundGrid, JunctionField
from carlaloc_env.town.ground.lane_strips import Strip, road_strips
from carlaloc_env.town.ground.paved_areas import lane_area, town_areas
from carlaloc_env.town.ground.terrain import LAP_M, Terrain, add_terrain, zone_areas
from carlaloc_env.town.lanes.build_network import build_network
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.meshing.mesh_builder import MeshBuilder
from carlaloc_env.town.meshing.polygons import strip_polygon
from carlaloc_env.town.roads.gore_hatching import gore_bars
from carlaloc_env.town.scenery import TownScenery, build_scenery
from carlaloc_env.town.sources import known_towns
from carlaloc_env.town.structures.overhead_lines import catenary_m

o3d = pytest.importorskip("open3d", reason="Open3D casts the rays of these tests")

EAST, NORTH, UP = np.eye(3)
FLAT = EAST + NORTH
STREET = (("driving", 3.5), ("driving", 3.5), ("sidewalk", 2.5))
LANE = (("driving", 3.5), ("sidewalk", 2.5))
MOTORWAY = (("median", 1.5), ("driving", 3.7), ("driving", 3.7), ("shoulder", 2.5))
RURAL = (("driving", 3.5), ("shoulder", 1.0))
KERBSIDE = (("driving", 3.5), ("parking", 2.2), ("sidewalk", 2.5))


def _climb(s: float, z0: float, z1: float, length: float) -> tuple[float, ...]:
    """One cubic with level ends."""
    rise = z1 - z0
    return (s, z0, 0.0, 3 * rise / length**2, -2 * rise / length**3)


def _road(
    number: int,
    start: tuple[float, float, float],
    length: float,
    elevation: tuple[tuple[float, ...], ...],
    lanes: tuple[tuple[str, float], ...],
    kmh: int = 50,
    links: tuple[int | None, int | None] = (None, None),
) -> str:
    """One straight road, the same on both sides."""

    def side(sign: int) -> str:
        found = [
            f'<lane id="{sign * (k + 1)}" type="{kind}" level="false">'
            f'<width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane>'
            for k, (kind, width) in enumerate(lanes)
        ]
        return "".join(found[::-sign])

    heights = "".join('<elevation s="{}" a="{}" b="{}" c="{}" d="{}"/>'.format(*e) for e in elevation)
    link = "".join(
        f'<{name} elementType="road" elementId="{other}" contactPoint="{contact}"/>'
        for name, other, contact in (("predecessor", links[0], "end"), ("successor", links[1], "start"))
        if other is not None
    )
    x, y, heading = start
    return (
        f'<road name="{number}" length="{length}" id="{number}" junction="-1"><link>{link}</link>'
        f'<type s="0" type="town"><speed max="{kmh}" unit="km/h"/></type><planView>'
        f'<geometry s="0" x="{x}" y="{y}" hdg="{heading}" length="{length}"><line/></geometry></planView>'
        f'<elevationProfile>{heights}</elevationProfile><lanes><laneSection s="0"><left>{side(1)}</left>'
        f'<center><lane id="0" type="none" level="false"/></center><right>{side(-1)}</right>'
        "</laneSection></lanes></road>"
    )


@dataclass(frozen=True)
class Built:
    """A map and its scenery."""

    network: LaneNetwork
    scenery: TownScenery | None
    mesh: Mesh

    def scene(self, *tags: Tag) -> o3d.t.geometry.RaycastingScene:
        """Triangles of some tags; of all when left out."""
        triangles = self.mesh.triangles
        if tags:
            triangles = triangles[np.isin(self.mesh.tag[triangles[:, 0]], tags)]
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(
            o3d.core.Tensor(self.mesh.vertices_m), o3d.core.Tensor(triangles.astype(np.uint32))
        )
        return scene

    def corners(self, *tags: Tag) -> Array:
        """Corners of the triangles of some tags."""
        triangles = self.mesh.triangles[np.isin(self.mesh.tag[self.mesh.triangles[:, 0]], tags)]
        return self.mesh.vertices_m[triangles].reshape(-1, 3).astype(np.float64)

    def lane_area(self, *kinds: str) -> shapely.Geometry:
        """Plan-view area of all lanes of some types."""
        strips = road_strips(self.network.xodr.roads, self.network.surface)
        parts = []
        for strip in strips:
            for lane in range(len(strip.lanes)):
                if strip.lanes[lane].type in kinds:
                    left, right = strip.lane_edges(lane)
                    parts.append(shapely.Polygon(np.concatenate([left[:, :2], right[::-1, :2]])))
        return shapely.union_all(parts)

    def lanes(self, only: list[int] | None = None) -> Array:
        """Points (M, 3) of driving lanes at the middle and near both edges, every metre."""
        found = []
        for lane in self.network.lanes:
            if lane.type == "driving" and lane.length_m > 1.5 and (only is None or lane.index in only):
                station = np.arange(0.5, lane.length_m - 0.4, 1.0)
                pose = self.network.pose([lane.index] * len(station), station)
                width = self.network.width_m([lane.index] * len(station), station)
                left = np.stack([-np.sin(pose.heading_rad), np.cos(pose.heading_rad), 0 * station], axis=-1)
                found += [pose.position_m + (share * width)[:, None] * left for share in (-0.45, 0.0, 0.45)]
        return np.concatenate(found)


def _build(folder: Path, roads: list[str], toml: str) -> Built:
    folder.mkdir(exist_ok=True)
    text = '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="7" name="small"/>'
    (folder / "town.xodr").write_text(text + "".join(roads) + "</OpenDRIVE>")
    (folder / "town.toml").write_text(toml)
    network = build_network(folder / "town.xodr")
    scenery = build_scenery(network, TownConfig.from_toml(folder / "town.toml"), 7)
    return Built(network, scenery, merge(scenery.chunks))


@pytest.fixture(scope="module")
def overpass(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """A street over two others: up on one road, along on the next, down on a third."""
    north = np.pi / 2
    roads = [
        _road(1, (0.0, -200.0, north), 100.0, (_climb(0, 0, 6.5, 100),), STREET, links=(None, 2)),
        _road(2, (0.0, -100.0, north), 160.0, ((0, 6.5, 0, 0, 0),), STREET, links=(1, 3)),
        _road(3, (0.0, 60.0, north), 100.0, (_climb(0, 6.5, 0, 100),), STREET, links=(2, None)),
        _road(4, (-120.0, -50.0, 0.0), 240.0, ((0, 0, 0, 0, 0),), LANE),
        _road(5, (-120.0, 30.0, 0.0), 240.0, ((0, 0, 0, 0, 0),), LANE),
    ]
    return _build(tmp_path_factory.mktemp("over"), roads, '[town]\ndefault_zone = "industrial"\n')


@pytest.fixture(scope="module")
def motorway(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """A motorway with a country road over it, on banks."""
    over = (_climb(0, 0, 6.8, 130), (130, 6.8, 0, 0, 0), _climb(190, 6.8, 0, 130))
    roads = [
        _road(1, (-200.0, 0.0, 0.0), 400.0, ((0, 0, 0, 0, 0),), MOTORWAY, kmh=120),
        _road(2, (20.0, -160.0, np.pi / 2), 320.0, over, RURAL, kmh=80),
    ]
    return _build(tmp_path_factory.mktemp("way"), roads, '[town]\ndefault_zone = "highway"\n')


@pytest.fixture(scope="module")
def river(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """A street over a river, and a quiet street with parking lanes."""
    roads = [
        _road(1, (-120.0, 0.0, 0.0), 240.0, ((0, 0.5, 0, 0, 0),), LANE),
        _road(2, (-120.0, -90.0, 0.0), 100.0, ((0, 0.5, 0, 0, 0),), KERBSIDE, kmh=30),
    ]
    toml = (
        '[town]\ndefault_zone = "residential"\n[[zone]]\nkind = "water"\n'
        "polygon = [[10, -400], [42, -400], [40, 0], [48, 400], [16, 400], [8, 0]]\n"
    )
    return _build(tmp_path_factory.mktemp("river"), roads, toml)


def _cast(scene: o3d.t.geometry.RaycastingScene, points: Array, direction: tuple[float, ...]) -> Array:
    rays = np.concatenate([points, np.tile(direction, (len(points), 1))], axis=1).astype(np.float32)
    return np.asarray(scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy(), dtype=np.float64)


@pytest.mark.parametrize("name", ["overpass", "motorway", "river"])
def test_every_lane_of_every_level_is_whole(name: str, request: pytest.FixtureRequest) -> None:
    built: Built = request.getfixturevalue(name)
    points = built.lanes()
    scene = built.scene(Tag.ROAD, Tag.BRIDGE, Tag.TERRAIN, Tag.GROUND, Tag.SIDEWALK, Tag.WATER)
    fall = _cast(scene, points + UP * 2.0, (0.0, 0.0, -1.0)) - 2.0
    assert np.isfinite(fall).all()
    assert np.abs(fall).max() < 0.02


@pytest.mark.parametrize("name", ["overpass", "motorway", "river"])
def test_wheels_stand_on_every_level(name: str, request: pytest.FixtureRequest) -> None:
    built: Built = request.getfixturevalue(name)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(built.scenery.collision_vertices_m.astype(np.float32)),
        o3d.core.Tensor(built.scenery.collision_triangles.astype(np.uint32)),
    )
    fall = _cast(scene, built.lanes() + UP * 2.0, (0.0, 0.0, -1.0)) - 2.0
    assert np.abs(fall).max() < 0.02


def test_decks_close_above_the_streets_and_leave_room(overpass: Built) -> None:
    points = overpass.lanes()
    street = points[points[:, 2] < 0.5]
    under = street[np.abs(street[:, 0]) < 9.0]
    under = under[np.abs(under[:, 1]) < 60.0]
    assert len(under) > 100
    solid = overpass.scene(Tag.BRIDGE, Tag.ROAD, Tag.SIDEWALK, Tag.WALL)
    free = _cast(solid, under + UP * 0.1, (0.0, 0.0, 1.0)) + 0.1
    assert np.isfinite(free).all()
    assert free.min() >= 4.5
    deck = _cast(overpass.scene(Tag.BRIDGE), under + UP * 0.1, (0.0, 0.0, 1.0)) + 0.1
    np.testing.assert_allclose(deck, free)


def test_raised_roads_have_parapets_on_both_sides(overpass: Built) -> None:
    points = overpass.lanes()
    high = points[points[:, 2] > 3.5]
    scene = overpass.scene(Tag.GUARD_RAIL)
    for direction in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)):
        gap = _cast(scene, high + UP * 0.5, direction)
        assert np.isfinite(gap).all()
        assert gap.max() < 2 * 9.5


def test_no_structure_stands_on_a_lane_or_sidewalk(overpass: Built, motorway: Built, river: Built) -> None:
    for built in (overpass, motorway, river):
        # Points all over the triangles: a column has corners at its foot and its head alone.
        corners = built.corners(Tag.BRIDGE, Tag.WALL, Tag.GUARD_RAIL, Tag.POLE).reshape(-1, 1, 3, 3)
        shares = np.random.default_rng(1).dirichlet((1.0, 1.0, 1.0), (len(corners), 40))
        low = np.sum(shares[..., None] * corners, axis=2).reshape(-1, 3)
        ground = built.lanes()[:, 2].min()
        low = low[(low[:, 2] > ground + 0.02) & (low[:, 2] < ground + 3.0)]
        strips = road_strips(built.network.xodr.roads, built.network.surface)
        on_ground = [s for s in strips if s.edges_m[:, :, 2].max() < ground + 0.5]
        paved = shapely.union_all([a for s in on_ground for a in lane_area(s, ("roadway",))])
        inner = shapely.buffer(paved, -0.05)
        assert not shapely.contains_xy(inner, low[:, 0], low[:, 1]).any()


def test_piers_carry_the_deck(overpass: Built) -> None:
    """Below the deck and beside the streets there are columns from the ground to its underside."""
    corners = overpass.corners(Tag.BRIDGE)
    feet = corners[(corners[:, 2] < 0.0) & (np.abs(corners[:, 0]) < 8.0)]
    feet = feet[np.abs(feet[:, 1]) < 60.0]
    places = np.unique(np.round(feet[:, 1] / 4.0))
    assert len(places) >= 4
    assert np.diff(np.sort(places)).max() * 4.0 < 45.0


def test_a_bank_carries_the_country_road_and_walls_stand_near_the_motorway(motorway: Built) -> None:
    """Far from the motorway the ground rises to the road's edge; under the deck it lies where it was."""
    y = np.array([-55.0, -45.0, 45.0, 55.0])
    terrain = motorway.scene(Tag.TERRAIN)
    beside = np.column_stack([np.full(4, 20.0 + 5.0), y, np.full(4, 30.0)])
    top = 30.0 - _cast(terrain, beside, (0.0, 0.0, -1.0))
    assert (top > 5.0).all()
    foot = beside + EAST * 14.0
    low = 30.0 - _cast(terrain, foot, (0.0, 0.0, -1.0))
    assert (low < 2.0).all()
    assert (low > -0.3).all()


def test_motorways_have_rails_on_their_right_and_a_barrier_on_their_left(motorway: Built) -> None:
    points = motorway.lanes()
    lane = points[(points[:, 2] < 0.5) & (np.abs(points[:, 0]) < 190.0)]
    lane = lane[np.abs(lane[:, 0] - 20.0) > 22.0]
    eye = lane + UP * 0.6
    out = np.sign(lane[:, 1])
    rails, barrier = motorway.scene(Tag.GUARD_RAIL), motorway.scene(Tag.WALL)
    for sign in (1.0, -1.0):
        own = eye[out == sign]
        edge = 1.5 + 2 * 3.7 + 2.5
        gap = _cast(rails, own, (0.0, sign, 0.0)) - (edge - np.abs(own[:, 1]))
        assert (gap > 0.3).all()
        assert np.median(gap) < 1.0
        assert np.isfinite(gap).mean() > 0.98
        gap = _cast(barrier, own, (0.0, -sign, 0.0))
        assert np.isfinite(gap).mean() > 0.98
        assert (gap < np.abs(own[:, 1])).mean() > 0.98


def test_water_lies_below_the_bridge_and_beside_it(river: Built) -> None:
    points = river.lanes()
    over = points[(points[:, 0] > 14.0) & (points[:, 0] < 36.0) & (np.abs(points[:, 1]) < 5.0)]
    deck = _cast(river.scene(Tag.BRIDGE), over * FLAT - UP * 1.5, (0.0, 0.0, 1.0)) - 1.5
    assert np.abs(deck - (0.5 - 0.9)).max() < 0.05
    every = river.scene()
    for start in (over * FLAT - UP, over + NORTH * 40.0 + UP):
        wet = _cast(river.scene(Tag.WATER), start, (0.0, 0.0, -1.0))
        assert np.isfinite(wet).all()
        level = start[:, 2] - wet
        assert np.ptp(level) < 0.01
        assert 2.0 < 0.5 - level[0] < 3.5
    first = _cast(every, over + NORTH * 40.0 + UP * 12.0, (0.0, 0.0, -1.0))
    assert (np.abs(first - wet - 11.0) < 0.01).mean() > 0.8


def test_the_banks_close_between_land_and_water(river: Built) -> None:
    """No ray from above falls through anything near the shore."""
    x, y = np.meshgrid(np.arange(0.0, 60.0, 0.7), np.arange(-80.0, 80.0, 1.1))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 60.0)])
    assert np.isfinite(_cast(river.scene(), points, (0.0, 0.0, -1.0))).all()


def test_parked_cars_stand_off_driving_lanes_and_sidewalks(river: Built) -> None:
    cars = river.corners(Tag.CAR, Tag.TRUCK)
    assert len(cars) > 1000
    busy = shapely.buffer(river.lane_area("driving", "sidewalk"), -0.02)
    shapely.prepare(busy)
    assert not shapely.contains_xy(busy, cars[:, 0], cars[:, 1]).any()
    parking = shapely.buffer(river.lane_area("parking"), 0.05)
    assert shapely.contains_xy(parking, cars[:, 0], cars[:, 1]).any()


@pytest.mark.soak
@pytest.mark.parametrize("name", sorted(known_towns()))
def test_every_lane_of_every_town_is_whole_and_free(name: str) -> None:
    """Outside junctions roads lie where the map says, on every level, and nothing hangs over any lane."""
    town = load_town(name)
    built = Built(town.network, None, merge(town.chunks))
    plain = [lane.index for lane in town.network.lanes if lane.junction_id is None]
    surface = built.scene(Tag.ROAD, Tag.BRIDGE, Tag.TERRAIN, Tag.GROUND, Tag.SIDEWALK, Tag.WATER)
    points = built.lanes(only=plain)
    fall = _cast(surface, points + UP * 2.0, (0.0, 0.0, -1.0)) - 2.0
    assert np.abs(fall).max() < 0.02
    free = _cast(built.scene(), built.lanes() + UP * 0.3, (0.0, 0.0, 1.0)) + 0.3
    leaves = _cast(built.scene(Tag.VEGETATION), built.lanes() + UP * 0.3, (0.0, 0.0, 1.0)) + 0.3
    assert free[free < leaves].min(initial=np.inf) >= 4.5


@pytest.mark.parametrize("name", ["Town03", "Town07"])
def test_surfaces_of_junctions_lie_on_their_lanes(name: str) -> None:
    """Along the lanes' middles: everywhere where connecting roads agree, 97 % of them on slopes."""
    network = build_network(known_towns()[name])
    groups: dict[str, list[Strip]] = {}
    for strip in road_strips(network.xodr.roads, network.surface):
        if strip.junction_id is not None:
            groups.setdefault(strip.junction_id, []).append(strip)
    off = []
    for junction, strips in groups.items():
        field = JunctionField(strips, network.surface)
        for lane in network.lanes:
            if lane.junction_id == junction and lane.type == "driving":
                station = np.arange(0.0, lane.length_m, 1.0)
                points = network.pose([lane.index] * len(station), station).position_m
                off.append(field.height(points) - points[:, 2])
    away = np.abs(np.concatenate(off))
    assert (away < 0.02).mean() > (0.97 if name == "Town07" else 0.9999)
    assert away.max() < 0.1


def test_no_grass_grows_along_kerbs() -> None:
    """Kerb lines of Town01 lie deep inside what is paved: no hairline parts roadway and sidewalk."""
    network = build_network(known_towns()["Town01"])
    strips = road_strips(network.xodr.roads, network.surface)
    zones = zone_areas(
        TownConfig.from_toml(known_towns()["Town01"].with_name("town.toml")),
        shapely.box(-400, -400, 400, 400),
    )
    levels = find_levels(strips, np.full(2, -400.0), np.full(2, 400.0), zones)
    assert levels.overhead()
    areas = town_areas(strips, network.xodr.roads, levels.overhead())
    paved = shapely.buffer(areas.low_paved, -LAP_M, join_style="mitre")
    overhead = shapely.union_all(list(levels.overhead().values()))
    shapely.prepare(paved)
    count = 0
    for strip in strips:
        kinds = [strip.kind(lane) for lane in range(len(strip.lanes))]
        for edge, pair in enumerate(pairwise(kinds), 1):
            if strip.junction_id is None and set(pair) == {"roadway", "walkway"}:
                inner = strip.edges_m[edge, 1:-1, :2]
                inner = inner[shapely.distance(overhead, shapely.points(inner)) > 1.0]
                assert shapely.contains_xy(paved, inner[:, 0], inner[:, 1]).all(), strip.road_id
                count += len(inner)
    assert count > 500


def test_no_ground_shows_in_hairlines_of_what_is_paved() -> None:
    paved = shapely.MultiPolygon(
        [shapely.box(0.0, 0.0, 50.0, 20.0), shapely.box(50.0 + 1e-9, 0.0, 90.0, 20.0)]
    )
    line = EdgeField([np.array([[0.0, 0.0, 0.0], [90.0, 0.0, 0.0]])])
    grid = GroundGrid(line.points_m, np.full(2, -100.0), np.full(2, 200.0))
    bounds, out = shapely.box(-50.0, -50.0, 140.0, 70.0), MeshBuilder()
    add_terrain(out, bounds, paved, [("rural", bounds)], Terrain(edge=line, grid=grid))
    corners = out.build().vertices_m
    inside = shapely.contains_xy(shapely.box(1.0, 1.0, 89.0, 19.0), corners[:, 0], corners[:, 1])
    assert len(corners) > 100
    assert not inside.any()


def test_kerbs_drop_at_crosswalks(tmp_path: Path) -> None:
    """Two centimetres are left before a crosswalk, a whole kerb two metres beside it, and no steps."""
    outline = "".join(
        f'<cornerLocal u="{u}" v="{v}" z="0"/>' for u, v in ((-2, -7), (2, -7), (2, 7), (-2, 7))
    )
    walk = (
        '<objects><object id="9" type="crosswalk" name="Crosswalk" s="40" t="0" zOffset="0" hdg="0" '
        f'orientation="none" length="4" width="14" height="0"><outline>{outline}</outline></object></objects>'
    )
    road = _road(1, (0.0, 0.0, 0.0), 80.0, ((0, 0.5, 0, 0, 0),), STREET).replace("</road>", walk + "</road>")
    built = _build(tmp_path, [road], '[town]\ndefault_zone = "residential"\n')
    scene = built.scene(Tag.SIDEWALK)
    for side in (1.0, -1.0):
        x = np.arange(30.0, 50.01, 0.25)
        above = np.column_stack([x, np.full(len(x), side * 7.05), np.full(len(x), 3.0)])
        height = 2.5 - _cast(scene, above, (0.0, 0.0, -1.0))
        beside = np.abs(x - 40.0)
        np.testing.assert_allclose(height[beside < 1.9], 0.02, atol=0.006)
        np.testing.assert_allclose(height[beside > 3.0], 0.15, atol=0.002)
        above[:, 1] = side * 8.6
        np.testing.assert_allclose(2.5 - _cast(scene, above, (0.0, 0.0, -1.0)), 0.15, atol=0.002)


def test_gravel_is_drawn_and_bears_no_paint(tmp_path: Path) -> None:
    """Lanes whose material is gravel have no asphalt, and lines only where asphalt is."""
    material = '<material sOffset="0" surface="gravel" friction="0.5" roughness="0.05"/></lane>'
    mark = '<roadMark sOffset="0" type="solid" weight="standard" color="standard" width="0.12"/></lane>'
    lanes = (("driving", 3.5), ("shoulder", 0.6))
    roads = [
        _road(1, (0.0, 0.0, 0.0), 80.0, ((0, 0, 0, 0, 0),), lanes).replace("</lane>", mark),
        _road(2, (0.0, 40.0, 0.0), 80.0, ((0, 0, 0, 0, 0),), lanes).replace("</lane>", mark),
    ]
    roads[1] = roads[1].replace("</lane>", material).replace(mark, mark.replace("</lane>", "") + material)
    mesh = _build(tmp_path, roads, '[town]\ndefault_zone = "rural"\n').mesh
    material_of, y = mesh.material[mesh.triangles[:, 0]], mesh.vertices_m[mesh.triangles[:, 0], 1]
    x = mesh.vertices_m[mesh.triangles[:, 0], 0]
    asphalt = np.isin(material_of, (Material.ASPHALT, Material.ASPHALT_OLD))
    track = (np.abs(y - 40.0) < 4.0) & (x > -1.0) & (x < 81.0)
    road = (np.abs(y) < 4.0) & (x > -1.0) & (x < 81.0)
    assert asphalt[road].any()
    assert not asphalt[track].any()
    assert (material_of[track] == Material.GRAVEL).sum() > 50
    paint = material_of == Material.ROAD_PAINT_WHITE
    assert paint[road].any()
    assert not paint[track].any()


def test_plates_of_parked_cars_differ(river: Built) -> None:
    mesh = river.mesh
    plate = (mesh.material == Material.PLATE) & np.isin(mesh.tag, (Tag.CAR, Tag.TRUCK))
    first = {
        int(i): mesh.uv_m[np.flatnonzero(plate & (mesh.instance == i))[0]]
        for i in np.unique(mesh.instance[plate])
    }
    assert len(first) > 8
    assert len({tuple(np.round(uv, 4)) for uv in first.values()}) > 0.6 * min(len(first), 64)


def test_one_looks_through_the_railings_of_a_bridge_over_water(river: Built) -> None:
    """From a driver's eye most rays below the horizon pass the rails and meet the water or the far bank."""
    eye = np.array([[25.0, -1.75, 0.5 + 1.3]])
    turn = np.radians(np.linspace(-5.0, -9.0, 41))
    rays = np.repeat(eye, len(turn), axis=0)
    direction = np.column_stack([np.zeros(len(turn)), -np.cos(turn), np.sin(turn)])
    cast = np.concatenate([rays, direction], axis=1).astype(np.float32)
    rail = river.scene(Tag.GUARD_RAIL, Tag.BRIDGE).cast_rays(o3d.core.Tensor(cast))["t_hit"].numpy()
    assert np.isinf(rail).mean() > 0.6
    assert np.isfinite(rail).any()


@pytest.mark.parametrize(("name", "exits"), [("Town04", 8), ("Town06", 3)])
def test_wedges_at_exits_are_hatched_and_lanes_are_not(name: str, exits: int) -> None:
    network = build_network(known_towns()[name])
    strips = road_strips(network.xodr.roads, network.surface)
    driven = shapely.union_all([shapely.union_all(_driving(strip)) for strip in strips])
    found = gore_bars(strips, network.xodr.roads)
    assert len(found) >= exits
    for _, bars in found:
        assert bars.area > 3.0
        assert shapely.distance(bars, driven) > 0.05


def _driving(strip: Strip) -> list[shapely.Geometry]:
    return [
        strip_polygon(*strip.lane_edges(lane))
        for lane in range(len(strip.lanes))
        if strip.lanes[lane].type == "driving"
    ]


def test_wires_hang_as_catenaries() -> None:
    """z = c·cosh(x/c): a level span sags by c·(cosh(L/2c) − 1), and z″ = √(1 + z′²)/c on any span."""
    c, length = 210.0, 40.0
    x = np.linspace(0.0, 1.0, 2001)
    level = catenary_m(length, 0.0, c, x)
    assert level[0] == pytest.approx(0.0, abs=1e-9)
    assert level[-1] == pytest.approx(0.0, abs=1e-9)
    assert -level.min() == pytest.approx(c * (np.cosh(length / 2 / c) - 1.0), rel=1e-9)
    rising = catenary_m(length, 3.0, c, x)
    assert rising[-1] == pytest.approx(3.0, rel=1e-9)
    h = length / 2000
    first, second = np.gradient(rising, h)[2:-2], np.gradient(np.gradient(rising, h), h)[2:-2]
    np.testing.assert_allclose(second * c, np.sqrt(1.0 + first**2), rtol=1e-4)
