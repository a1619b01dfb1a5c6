"""What stands in towns of every zone: nothing on lanes or sidewalks, neighbours that differ, right tags."""

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.assets.model_library import build_library
from carlaloc_env.map.sources import known_towns
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.building_lots import place_lots
from carlaloc_env.scenery.ground.land import LAND_CELL_M, Raster
from carlaloc_env.scenery.ground.lane_strips import road_strips
from carlaloc_env.scenery.ground.paved_areas import town_areas
from carlaloc_env.scenery.ground.terrain import zone_areas
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town

WALLS = (
    Material.BRICK_RED, Material.BRICK_BROWN, Material.PLASTER, Material.ASHLAR, Material.CONCRETE_PANEL,
    Material.CURTAIN_WALL, Material.SIDING, Material.RUBBLE, Material.WOOD,
)  # fmt: skip
"""Materials of houses; silos, which come in like pairs, are of sheet metal."""
HALF_M, LOW_M, HIGH_M = 1.15, 0.2, 2.1
"""The tunnel along each lane that stays free: half its width, and from where to where above the road [m]."""
SOLID = (
    Tag.BUILDING, Tag.WALL, Tag.FENCE, Tag.POLE, Tag.VEGETATION, Tag.STATIC, Tag.TRAFFIC_SIGN, Tag.GUARD_RAIL,
    Tag.TERRAIN, Tag.GROUND, Tag.OTHER, Tag.WATER,
)  # fmt: skip
ROAD = """<road name="r{id}" length="160" id="{id}" junction="-1"><link/>
<type s="0" type="{type}"><speed max="{limit}" unit="km/h"/></type>
<planView><geometry s="0" x="0" y="{y}" hdg="0" length="100"><line/></geometry>
<geometry s="100" x="100" y="{y}" hdg="0" length="60"><arc curvature="0.012"/></geometry></planView>
<elevationProfile><elevation s="0" a="0" b="0.02" c="0" d="0"/></elevationProfile>
<lanes><laneSection s="0"><left>{left}</left><center><lane id="0" type="none" level="false"/></center>
<right>{right}</right></laneSection></lanes></road>"""
LANE = '<lane id="{id}" type="{type}" level="false"><width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane>'
KINDS = (("town", 50, True), ("rural", 70, False), ("motorway", 120, False))
ZONES = ("small_town", "rural", "highway")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Town:
    """Three bent, sloping roads with their zones."""
    folder = tmp_path_factory.mktemp("zones")
    roads, toml = [], '[town]\nname = "zones"\ndefault_zone = "residential"\n'
    for number, (kind, limit, walk) in enumerate(KINDS):
        y = 170.0 * number
        sides = []
        for sign in (1, -1):
            lanes = [LANE.format(id=sign, type="driving", width=3.5)]
            lanes += [LANE.format(id=2 * sign, type="sidewalk", width=2.5)] if walk else []
            sides.append("".join(lanes[::-1] if sign > 0 else lanes))
        roads.append(ROAD.format(id=number + 1, type=kind, limit=limit, y=y, left=sides[0], right=sides[1]))
        ring = [[-90.0, y - 85.0], [260.0, y - 85.0], [260.0, y + 85.0], [-90.0, y + 85.0]]
        toml += f'[[zone]]\nkind = "{ZONES[number]}"\npolygon = {ring}\n'
    toml += '[[feature]]\nkind = "farm"\nposition = [60.0, 215.0]\nheading_deg = -90.0\n'
    toml += '[[feature]]\nkind = "billboard"\nposition = [60.0, 150.0]\n'
    header = '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="7"/>'
    (folder / "town.xodr").write_text(header + "".join(roads) + "</OpenDRIVE>")
    (folder / "town.toml").write_text(toml)
    return load_town(folder / "town.xodr", cache_dir=folder / "cache")


def standing_on_lanes(town: Town) -> dict[str, NDArray[np.float64]]:
    """Corners of solid things inside the free tunnel of any driving lane, by tag [m]."""
    lanes = [lane.index for lane in town.network.lanes if lane.type == "driving"]
    tables = town.network.tables
    owner = np.repeat(np.arange(len(tables.count)), tables.count)
    centre = tables.position_m[np.isin(owner, lanes)]
    scale = np.array([HALF_M, HALF_M, (HIGH_M - LOW_M) / 2])
    lift = np.array([0.0, 0.0, (HIGH_M + LOW_M) / 2])
    tree = cKDTree((centre + lift) / scale)
    found = {}
    for tag in SOLID:
        corners = np.concatenate([_corners(chunk, tag) for chunk in town.chunks])
        # A box is the ball of the largest norm.
        reach, _ = tree.query(corners / scale, p=np.inf, distance_upper_bound=1.0)
        hit = corners[np.isfinite(reach)]
        if len(hit):
            found[tag.name] = hit
    return found


def _corners(mesh: Mesh, tag: Tag) -> NDArray[np.float64]:
    """Corners and middles of the triangles with a tag."""
    rows = mesh.triangles[mesh.tag[mesh.triangles[:, 0]] == tag]
    corners = mesh.vertices_m[rows].astype(np.float64)
    return np.concatenate([corners.reshape(-1, 3), corners.mean(axis=1)])


def test_nothing_stands_on_the_lanes_of_a_small_town(small: Town) -> None:
    assert standing_on_lanes(small) == {}


@pytest.mark.soak
@pytest.mark.parametrize("name", known_towns())
def test_nothing_stands_on_the_lanes_of_any_town(name: str) -> None:
    assert {tag: hit[:3].tolist() for tag, hit in standing_on_lanes(load_town(name)).items()} == {}


def test_houses_and_fences_keep_off_sidewalks(small: Town) -> None:
    roads = small.network.xodr.roads
    walked = shapely.buffer(town_areas(road_strips(roads, small.network.surface), roads).raised, -0.4)
    shapely.prepare(walked)
    mesh = merge(small.chunks)
    for tag in (Tag.FENCE, Tag.WALL):
        corners = _corners(mesh, tag)
        assert len(corners)
        assert not shapely.contains_xy(walked, corners[:, 0], corners[:, 1]).any(), tag.name


def test_every_zone_has_what_it_is_known_by(small: Town) -> None:
    mesh = merge(small.chunks)
    material, y = mesh.material[mesh.triangles[:, 0]], mesh.vertices_m[mesh.triangles[:, 0], 1]
    rural = np.abs(y - 170.0) < 85.0
    crops = (material == Material.CROP) | (material == Material.FURROWS)
    assert (crops & rural).sum() > 100
    assert not (crops & (np.abs(y) < 60.0)).any()
    assert (material == Material.BILLBOARD).any()
    assert (material == Material.SHOP_SIGN).any() or (material == Material.SIDING).any()
    tags = set(np.unique(mesh.tag).tolist())
    assert {Tag.ROAD, Tag.SIDEWALK, Tag.BUILDING, Tag.VEGETATION, Tag.TERRAIN, Tag.FENCE} <= tags


@pytest.mark.parametrize("name", ["Town03"])
def test_no_two_neighbours_look_alike(name: str) -> None:
    """Buildings side by side differ in style, or in material or colour of their walls."""
    town = load_town(name)
    roads = town.network.xodr.roads
    strips = road_strips(roads, town.network.surface)
    areas = town_areas(strips, roads)
    bounds = shapely.box(*shapely.bounds(shapely.buffer(areas.roadway, 90.0)))
    lots = place_lots(strips, areas.paved, zone_areas(town.config, bounds), 7)
    middle = np.array([lot.footprint().centroid.coords[0] for lot in lots])
    pairs = cKDTree(middle).query_pairs(22.0)
    assert len(pairs) > 60
    same = 0
    for a, b in pairs:
        one, other = lots[a].plan.appearance, lots[b].plan.appearance
        same += (one.style.name, one.material, one.tint) == (other.style.name, other.material, other.tint)
    assert same == 0
    assert len({lot.plan.appearance.style.name for lot in lots}) >= 12


@pytest.mark.soak
@pytest.mark.parametrize("name", known_towns())
def test_houses_as_they_stand_differ_from_the_next(name: str) -> None:
    """In the finished scenery: walls of buildings at most 22 m apart differ in material or colour."""
    mesh = merge(load_town(name).chunks)
    corner = mesh.triangles[:, 0]
    upright = (mesh.tag == Tag.BUILDING) & (np.abs(mesh.normals[:, 2]) < 0.1) & (mesh.instance > 0)
    rows = np.flatnonzero((np.isin(mesh.material, WALLS) & upright)[corner])
    a, b, c = (mesh.vertices_m[mesh.triangles[rows, k]].astype(np.float64) for k in range(3))
    size = np.sqrt(np.sum(np.cross(b - a, c - a) ** 2, axis=1))
    corner = corner[rows]
    owner, paint = mesh.instance[corner], np.column_stack([mesh.material[corner], mesh.colour[corner]])
    looks, middles = [], []
    for house in np.unique(owner):
        own = owner == house
        kinds, number = np.unique(paint[own], axis=0, return_inverse=True)
        looks.append(tuple(kinds[np.argmax(np.bincount(number.ravel(), size[own]))].tolist()))
        middles.append(0.5 * (a[own, :2].min(axis=0) + a[own, :2].max(axis=0)))
    pairs = cKDTree(np.array(middles)).query_pairs(22.0)
    assert len(pairs) > 8
    assert [looks[one] for one, other in pairs if looks[one] == looks[other]] == []


@pytest.mark.soak
def test_all_tags_that_apply_occur_over_the_towns() -> None:
    """CARLA's tags besides nothing, the sky that no mesh has, and trains."""
    found = {int(tag) for mesh in build_library().meshes for tag in np.unique(mesh.tag)}
    for name in known_towns():
        found |= {int(tag) for chunk in load_town(name).chunks for tag in np.unique(chunk.tag)}
    missing = {Tag.UNLABELED, Tag.SKY, Tag.TRAIN}
    assert set(Tag) - {Tag(tag) for tag in found} == missing


def test_raster_distances_never_exceed_the_true_ones() -> None:
    """Against shapely: at most the true distance, and within three cells of it."""
    bounds = shapely.box(0.0, 0.0, 60.0, 40.0)
    ring = shapely.buffer(shapely.Point(30.0, 20.0), 12.0)
    shape = shapely.difference(ring, shapely.buffer(shapely.Point(30.0, 20.0), 6.0))
    xy = np.random.default_rng(3).uniform([1.0, 1.0], [59.0, 39.0], (4000, 2))
    found = Raster(bounds, [shape]).distance_m(xy)
    truth = shapely.distance(shape, shapely.points(xy))
    outside = truth > 2.0 * LAND_CELL_M
    assert (found[outside] <= truth[outside]).all()
    assert (found[outside] > truth[outside] - 3.0 * LAND_CELL_M).all()
    inside = shapely.contains_xy(shapely.buffer(shape, -LAND_CELL_M), xy[:, 0], xy[:, 1])
    assert (found[inside] < 0.0).all()
    assert Raster(bounds, [shape]).distance_m(np.array([[-1.0, 5.0], [61.0, 5.0]])).max() < 0.0
