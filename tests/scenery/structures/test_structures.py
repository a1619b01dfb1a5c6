"""Decks, water, rails and parked cars, on maps small enough to build in seconds."""

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.small_towns import Built, cast

from carlaloc_env.map.sources import known_towns
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.lane_strips import road_strips
from carlaloc_env.scenery.ground.paved_areas import lane_area
from carlaloc_env.town.build import load_town

o3d = pytest.importorskip("open3d", reason="Open3D casts the rays of these tests")
EAST, NORTH, UP = np.eye(3)
FLAT = EAST + NORTH


@pytest.mark.parametrize("name", ["overpass", "motorway", "river"])
def test_every_lane_of_every_level_is_whole(name: str, request: pytest.FixtureRequest) -> None:
    built: Built = request.getfixturevalue(name)
    points = built.lanes()
    scene = built.scene(Tag.ROAD, Tag.BRIDGE, Tag.TERRAIN, Tag.GROUND, Tag.SIDEWALK, Tag.WATER)
    fall = cast(scene, points + UP * 2.0, (0.0, 0.0, -1.0)) - 2.0
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
    fall = cast(scene, built.lanes() + UP * 2.0, (0.0, 0.0, -1.0)) - 2.0
    assert np.abs(fall).max() < 0.02


def test_decks_close_above_the_streets_and_leave_room(overpass: Built) -> None:
    points = overpass.lanes()
    street = points[points[:, 2] < 0.5]
    under = street[np.abs(street[:, 0]) < 9.0]
    under = under[np.abs(under[:, 1]) < 60.0]
    assert len(under) > 100
    solid = overpass.scene(Tag.BRIDGE, Tag.ROAD, Tag.SIDEWALK, Tag.WALL)
    free = cast(solid, under + UP * 0.1, (0.0, 0.0, 1.0)) + 0.1
    assert np.isfinite(free).all()
    assert free.min() >= 4.5
    deck = cast(overpass.scene(Tag.BRIDGE), under + UP * 0.1, (0.0, 0.0, 1.0)) + 0.1
    np.testing.assert_allclose(deck, free)


def test_raised_roads_have_parapets_on_both_sides(overpass: Built) -> None:
    points = overpass.lanes()
    high = points[points[:, 2] > 3.5]
    scene = overpass.scene(Tag.GUARD_RAIL)
    for direction in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)):
        gap = cast(scene, high + UP * 0.5, direction)
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
    top = 30.0 - cast(terrain, beside, (0.0, 0.0, -1.0))
    assert (top > 5.0).all()
    foot = beside + EAST * 14.0
    low = 30.0 - cast(terrain, foot, (0.0, 0.0, -1.0))
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
        gap = cast(rails, own, (0.0, sign, 0.0)) - (edge - np.abs(own[:, 1]))
        assert (gap > 0.3).all()
        assert np.median(gap) < 1.0
        assert np.isfinite(gap).mean() > 0.98
        gap = cast(barrier, own, (0.0, -sign, 0.0))
        assert np.isfinite(gap).mean() > 0.98
        assert (gap < np.abs(own[:, 1])).mean() > 0.98


def test_water_lies_below_the_bridge_and_beside_it(river: Built) -> None:
    points = river.lanes()
    over = points[(points[:, 0] > 14.0) & (points[:, 0] < 36.0) & (np.abs(points[:, 1]) < 5.0)]
    deck = cast(river.scene(Tag.BRIDGE), over * FLAT - UP * 1.5, (0.0, 0.0, 1.0)) - 1.5
    # Below the deck's 0.9 m a pier has a crosshead of 0.7 m.
    at_pier = np.abs(deck - (0.5 - 0.9 - 0.7)) < 0.05
    assert np.abs(deck - (0.5 - 0.9))[~at_pier].max() < 0.05
    assert at_pier.mean() < 0.2
    every = river.scene()
    for start in (over * FLAT - UP, over + NORTH * 40.0 + UP):
        wet = cast(river.scene(Tag.WATER), start, (0.0, 0.0, -1.0))
        assert np.isfinite(wet).all()
        level = start[:, 2] - wet
        assert np.ptp(level) < 0.01
        assert 2.0 < 0.5 - level[0] < 3.5
    first = cast(every, over + NORTH * 40.0 + UP * 12.0, (0.0, 0.0, -1.0))
    assert (np.abs(first - wet - 11.0) < 0.01).mean() > 0.8


def test_the_banks_close_between_land_and_water(river: Built) -> None:
    """No ray from above falls through anything near the shore."""
    x, y = np.meshgrid(np.arange(0.0, 60.0, 0.7), np.arange(-80.0, 80.0, 1.1))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 60.0)])
    assert np.isfinite(cast(river.scene(), points, (0.0, 0.0, -1.0))).all()


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
    fall = cast(surface, points + UP * 2.0, (0.0, 0.0, -1.0)) - 2.0
    assert np.abs(fall).max() < 0.02
    free = cast(built.scene(), built.lanes() + UP * 0.3, (0.0, 0.0, 1.0)) + 0.3
    leaves = cast(built.scene(Tag.VEGETATION), built.lanes() + UP * 0.3, (0.0, 0.0, 1.0)) + 0.3
    assert free[free < leaves].min(initial=np.inf) >= 4.5


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
