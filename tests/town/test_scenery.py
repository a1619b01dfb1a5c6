"""What stands in Town03, and that it stands where it should."""

import numpy as np
import pytest
import shapely

from carlaloc_env.assets.tree_forms import FORMS
from carlaloc_env.core.transforms import apply
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.styles import STYLES, ZONE_STYLES
from carlaloc_env.scenery.ground.lane_strips import road_strips
from carlaloc_env.scenery.ground.paved_areas import TownAreas, town_areas
from carlaloc_env.town.town import Town


@pytest.fixture(scope="module")
def areas(town03: Town) -> TownAreas:
    roads = town03.network.xodr.roads
    return town_areas(road_strips(roads, town03.network.surface), roads)


def _of_tag(mesh: Mesh, tag: Tag) -> np.ndarray[tuple[int, ...], np.dtype[np.uint32]]:
    return mesh.triangles[mesh.tag[mesh.triangles[:, 0]] == tag]


def test_everything_a_town_needs_is_there(town03_mesh: Mesh) -> None:
    for tag in (
        Tag.ROAD, Tag.ROAD_LINE, Tag.SIDEWALK, Tag.TERRAIN, Tag.BUILDING, Tag.VEGETATION, Tag.POLE,
        Tag.TRAFFIC_LIGHT, Tag.TRAFFIC_SIGN, Tag.WALL, Tag.BRIDGE, Tag.STATIC,
    ):  # fmt: skip
        assert len(_of_tag(town03_mesh, tag)) > 50, tag.name
    used = set(np.unique(town03_mesh.material))
    for material in (Material.WINDOW, Material.SHOP_FRONT, Material.DOOR, Material.KERB, Material.PAVEMENT):
        assert int(material) in used


def test_size_stays_within_budget(town03: Town) -> None:
    assert sum(len(chunk.triangles) for chunk in town03.chunks) < 3_000_000
    assert len(town03.outline.collision_triangles) < 400_000


def test_attributes_never_change_inside_a_triangle(town03_mesh: Mesh) -> None:
    for name in ("material", "tag", "instance"):
        values = getattr(town03_mesh, name)[town03_mesh.triangles]
        assert (values == values[:, :1]).all(), name


def test_normals_are_unit_vectors_and_nothing_is_infinite(town03_mesh: Mesh) -> None:
    np.testing.assert_allclose(np.linalg.norm(town03_mesh.normals.astype(np.float64), axis=1), 1.0, atol=2e-3)
    assert np.isfinite(town03_mesh.vertices_m).all()
    assert np.isfinite(town03_mesh.uv_m).all()
    assert int(town03_mesh.instance.max()) < EGO_INSTANCE


def test_chunks_are_small_squares(town03: Town) -> None:
    spans = np.array([np.ptp(chunk.bounds_m, axis=0)[:2].max() for chunk in town03.chunks])
    near = np.array([np.abs(chunk.bounds_m[:, :2].mean(axis=0)).max() < 250.0 for chunk in town03.chunks])
    assert (spans[near] > 121.0).sum() <= 1
    assert len(town03.chunks) < 300


def test_no_building_reaches_over_a_road_or_sidewalk(town03_mesh: Mesh, areas: TownAreas) -> None:
    """Nothing reaches over a road; over sidewalks only doorsteps, awnings and balconies do."""
    triangles = _of_tag(town03_mesh, Tag.BUILDING)
    centre = town03_mesh.vertices_m[triangles].astype(np.float64).mean(axis=1)
    paved = shapely.buffer(shapely.union(areas.roadway, areas.raised), -0.3)
    shapely.prepare(paved)
    down = np.abs(town03_mesh.normals[triangles[:, 0], 2]) < 0.5
    walls = centre[down & (town03_mesh.material[triangles[:, 0]] != Material.METAL_PAINTED)]
    hit = shapely.contains_xy(paved, walls[:, 0], walls[:, 1])
    road = shapely.buffer(areas.roadway, 0.2)
    shapely.prepare(road)
    assert not shapely.contains_xy(road, centre[:, 0], centre[:, 1]).any()
    assert hit.mean() < 0.01


def test_neighbouring_buildings_differ(town03_mesh: Mesh) -> None:
    """The colours and materials of 200 buildings and more form a large set."""
    triangles = _of_tag(town03_mesh, Tag.BUILDING)
    instances = np.unique(town03_mesh.instance[triangles])
    assert len(instances) > 150
    looks = set()
    first = {int(i): k for k, i in reversed(list(enumerate(town03_mesh.instance)))}
    for instance in instances:
        vertex = first[int(instance)]
        looks.add((int(town03_mesh.material[vertex]), *town03_mesh.colour[vertex].tolist()))
    assert len(looks) > 60


def test_styles_and_trees_are_many_and_every_zone_knows_its_own() -> None:
    assert len(STYLES) >= 12
    assert len(FORMS) >= 6
    for styles in ZONE_STYLES.values():
        for name, weight in styles:
            assert name in STYLES
            assert weight > 0.0


def test_lenses_face_the_drivers_who_must_stop(town03: Town) -> None:
    """A driver 25 m before the stop line sees each lens from its front, above the road."""
    lenses, network = town03.outline.lenses, town03.network
    assert set(np.unique(lenses.state)) == {1, 2, 3}
    assert set(np.unique(lenses.signal)) == set(range(len(network.signals)))
    checked = 0
    for T, signal in zip(lenses.T_world_lens, lenses.signal, strict=True):
        head = network.signals[signal]
        for lane, station in zip(head.lanes, head.stop_station_m, strict=True):
            if station < 26.0:
                continue
            eye = network.pose([lane], [station - 25.0]).position_m[0] + np.array([0.0, 0.0, 1.3])
            seen = apply(np.linalg.inv(T), eye)
            assert seen[0] > 15.0
            assert abs(np.arctan2(seen[1], seen[0])) < np.radians(35.0)
            assert 2.0 < T[2, 3] - eye[2] + 1.3 < 9.0
            checked += 1
    assert checked > 20


def test_red_lies_above_yellow_above_green(town03: Town) -> None:
    z = town03.outline.lenses.T_world_lens[:, 2, 3].reshape(-1, 3)
    assert (town03.outline.lenses.state.reshape(-1, 3) == [1, 2, 3]).all()
    assert (np.diff(z, axis=1) < -0.2).all()


def test_lamps_hang_over_streets(town03: Town, areas: TownAreas) -> None:
    distance = shapely.distance(areas.roadway, shapely.points(town03.outline.lamps_m[:, :2]))
    assert len(town03.outline.lamps_m) > 80
    assert (distance < 0.5).mean() > 0.95


def test_posts_do_not_stand_in_lanes(town03_mesh: Mesh, areas: TownAreas) -> None:
    triangles = _of_tag(town03_mesh, Tag.POLE)
    corners = town03_mesh.vertices_m[triangles].reshape(-1, 3).astype(np.float64)
    instance = np.repeat(town03_mesh.instance[triangles[:, 0]], 3)
    lowest = np.full(int(instance.max()) + 1, np.inf)
    np.minimum.at(lowest, instance, corners[:, 2])
    feet = corners[corners[:, 2] < lowest[instance] + 0.05]
    road = shapely.buffer(areas.roadway, -0.05)
    shapely.prepare(road)
    assert not shapely.contains_xy(road, feet[:, 0], feet[:, 1]).any()
