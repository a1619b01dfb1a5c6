"""Distances of reflecting posts against the table of the German notes, on lines and along built roads."""

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.sources import find_town
from carlaloc_env.scenery.ground.ground_plan import Groundwork, lay_groundwork
from carlaloc_env.scenery.ground.road_edges import Waysides, road_edges
from carlaloc_env.scenery.structures.delineators import against_traffic, delineator_bases, spacing_m


def arc(radius_m: float, length_m: float = 200.0) -> Array:
    angle = np.arange(0.0, length_m) / radius_m
    return np.stack([radius_m * np.sin(angle), radius_m * (1 - np.cos(angle)), 0 * angle], axis=-1)


@pytest.mark.parametrize(("radius", "spacing"), [(20.0, 3.0), (100.0, 10.0), (300.0, 20.0), (2000.0, 50.0)])
def test_posts_stand_closer_in_tighter_bends(radius: float, spacing: float) -> None:
    found = spacing_m(arc(radius))
    np.testing.assert_allclose(found[15:-15], spacing, rtol=0.03)


def test_straights_have_fifty_metres_and_short_lines_do_not_break() -> None:
    line = np.column_stack([np.arange(0.0, 100.0), np.zeros(100), np.zeros(100)])
    np.testing.assert_allclose(spacing_m(line), 50.0)
    np.testing.assert_allclose(spacing_m(line[:3]), 50.0)


@pytest.fixture(scope="module")
def motorway_work() -> Groundwork:
    """Groundwork of Town04."""
    config = TownConfig.from_toml(find_town("Town04").with_name("town.toml"))
    return lay_groundwork(town_network("Town04"), config)


def test_along_the_motorway_they_stand_on_the_right_alone_as_far_apart_as_it_bends(
    motorway_work: Groundwork,
) -> None:
    work = motorway_work
    edges = [
        edge for edge in road_edges(work.strips, work.roads, work.levels) if edge.road_type == "motorway"
    ]
    assert any(against_traffic(edge) for edge in edges)
    assert all(edge.name.endswith("right") for edge in edges if not against_traffic(edge))
    ways = Waysides(edges=edges, zones=work.zones, ground=work.ground, seed=0)
    bases_m, yaws = delineator_bases(ways, work.areas.paved)
    assert len(bases_m) > 60
    assert shapely.distance(work.areas.paved, shapely.points(bases_m[:, :2])).min() > 0.5
    gap = np.hypot(*np.diff(bases_m[:, :2], axis=0).T)
    # The lobes bend with about 145 m: 12 m on their line, more outside of it.
    assert 9.0 < np.median(gap[gap < 60.0]) < 16.0
    own = town_network("Town04").nearest(bases_m)
    heading = town_network("Town04").pose(own.lane, own.station_m).heading_rad
    assert (np.cos(yaws - heading) > 0.9).mean() > 0.95
