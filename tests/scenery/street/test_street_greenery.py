"""Green close to the road: on sidewalks, medians and façades, and never where somebody drives."""

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.assets.plants import bed, climber
from carlaloc_env.core.areas import strip_polygon
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.sources import identify_town
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.building_lots import Lot
from carlaloc_env.scenery.ground.ground_plan import Groundwork, lay_groundwork
from carlaloc_env.scenery.ground.land import Land, Raster
from carlaloc_env.scenery.meshing.props import InstanceIds, PropField
from carlaloc_env.scenery.street.site_plan import place_plots
from carlaloc_env.scenery.street.street_greenery import POST_CLEAR_M, add_street_greenery


@pytest.fixture(scope="module")
def ground() -> tuple[Groundwork, Land, TownConfig]:
    toml = identify_town("Town03").toml
    assert toml is not None
    config = TownConfig.from_toml(toml)
    work = lay_groundwork(town_network("Town03"), config)
    land = Land(
        bounds=work.bounds, zones=work.zones, ground=work.ground, strips=work.strips,
        roads=Raster(work.bounds, [work.areas.paved]), taken=Raster(work.bounds, [work.areas.paved]),
        route=None, seed=1,
    )  # fmt: skip
    return work, land, config


def planted(land: Land, lots: list[Lot], posts_m: Array) -> tuple[PropField, Mesh]:
    props = PropField()
    add_street_greenery(props, land, lots, posts_m)
    return props, merge(props.meshes(InstanceIds()))


def test_beds_lie_beside_the_roadway_away_from_posts(ground: tuple[Groundwork, Land, TownConfig]) -> None:
    work, land, _ = ground
    props, first = planted(land, [], np.zeros((0, 2)))
    bases_m = props.bases_m(lambda key: True)
    assert len(bases_m) > 100
    roadway = shapely.union_all(
        [
            strip_polygon(strip.edges_m[lane], strip.edges_m[lane + 1])
            for strip in work.strips
            for lane in range(len(strip.lanes))
            if strip.kind(lane) == "roadway" and strip.junction_id is None
        ]
    )
    inside = shapely.contains_xy(shapely.buffer(roadway, -0.6), *first.vertices_m[:, :2].T.astype(float))
    # One road crosses another on a bridge.
    assert inside.mean() < 0.02
    # Where posts stand at every third bed, none of these is left.
    posts_m = bases_m[::3, :2]
    kept = planted(land, [], posts_m)[0].bases_m(lambda key: True)
    assert len(kept) < len(bases_m)
    reach = cKDTree(posts_m).query(kept[:, :2])[0]
    assert reach.min() > POST_CLEAR_M - 1.6
    assert set(np.unique(first.material)) == {Material.LEAF}
    assert set(np.unique(first.tag)) == {Tag.VEGETATION}


def test_the_same_seed_plants_the_same_and_another_one_does_not(
    ground: tuple[Groundwork, Land, TownConfig],
) -> None:
    work, land, config = ground
    lots = list(place_plots(work, config, 1).lots)[:40]
    one, again = (planted(land, lots, np.zeros((0, 2)))[1] for _ in range(2))
    assert np.array_equal(one.vertices_m, again.vertices_m)
    assert len(one.triangles) > len(planted(land, [], np.zeros((0, 2)))[1].triangles)


def test_plants_have_the_size_that_their_places_have_room_for() -> None:
    for seed in range(4):
        low, high = bed(seed).bounds_m
        assert low[0] > -0.4
        assert high[0] < 3.4
        assert max(-low[1], high[1]) < 0.9
        assert 0.6 < high[2] < 1.4
        low, high = climber(seed).bounds_m
        # Leaves stick into the wall by their own size at most, and out of it by half a metre.
        assert high[1] < 0.2
        assert low[1] > -0.55
        assert 2.5 < high[2] < 3.6
