"""The roads of our towns as one surface: lanes that follow each other, and roads that cross in junctions."""

import collections
import pathlib

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scenery.ground.lane_strips import Strip, road_strips

MAPS = sorted((pathlib.Path(__file__).parents[2] / "maps").glob("*/town.xodr"))
STEEPEST = 0.08
"""Of roads, and so of junctions."""


@pytest.fixture(scope="module", params=MAPS, ids=[path.parent.name for path in MAPS])
def network(request: pytest.FixtureRequest) -> LaneNetwork:
    return town_network(request.param.parent.name)


def lane_ends(network: LaneNetwork, lanes: NDArray[np.int64], *, last: bool) -> list[NDArray[np.float64]]:
    """Position and slope in travel direction (M, 4) of both edges where traffic leaves or enters lanes."""
    surface, edges = network.surface, network.surface.edges
    records = [network.lanes[i] for i in lanes]
    road = np.array([network.road_index[record.road_id] for record in records])
    keys = zip(road, records, strict=True)
    number = np.array([edges.index[int(r), record.section, record.lane_id] for r, record in keys])
    s = network.s_m(lanes, network.tables.length_m[lanes] * last)
    found = []
    for edge in (edges.inner(number, s), edges.outer(number, s)):
        curve = surface.curve(road, s, edge)
        slope = np.where(network.forward[number], curve.slope, -curve.slope)
        found.append(np.column_stack([curve.position_m, slope]))
    return found


def test_edges_of_lanes_go_on_without_a_step(network: LaneNetwork) -> None:
    """At every link of two lanes, height and slope of both edges are the same on both sides.

    So are their places where traffic drives; the hard shoulder at the nose of an exit is a little wider.
    """
    links = [(a.index, b) for a in network.lanes for b in a.successors]
    assert len(links) > 100
    before, after = (np.array(column) for column in zip(*links, strict=True))
    driven = np.array([network.lanes[i].type == "driving" for i in before])
    for a, b in zip(
        lane_ends(network, before, last=True), lane_ends(network, after, last=False), strict=True
    ):
        np.testing.assert_allclose(a[driven, :2], b[driven, :2], atol=1e-3)
        np.testing.assert_allclose(a[:, 2], b[:, 2], atol=1e-3)
        np.testing.assert_allclose(a[:, 3], b[:, 3], atol=2e-3)


def test_roads_that_cross_in_a_junction_agree_in_height(network: LaneNetwork) -> None:
    """Two connecting roads leave no step where they overlap: wheels of both touch the same ground."""
    groups: dict[str, list[Strip]] = collections.defaultdict(list)
    for strip in road_strips(network.xodr.roads, network.surface):
        if strip.junction_id is not None:
            groups[strip.junction_id].append(strip)
    compared = 0
    for strips in groups.values():
        points = [_driven(strip) for strip in strips]
        owner = np.repeat(np.arange(len(points)), [len(p) for p in points])
        all_points = np.concatenate(points)
        pairs = cKDTree(all_points[:, :2]).query_pairs(0.15, output_type="ndarray")
        a, b = pairs[owner[pairs[:, 0]] != owner[pairs[:, 1]]].T
        gap = np.hypot(*(all_points[a] - all_points[b])[:, :2].T)
        step = np.abs(all_points[a, 2] - all_points[b, 2]) - STEEPEST * gap
        compared += len(step)
        assert step.max(initial=0.0) < 1e-3
    assert compared > 5000


def _driven(strip: Strip) -> NDArray[np.float64]:
    """Points (N, 3) of the driving lanes of a strip, about every half metre along and across."""
    shares = np.linspace(0.02, 0.98, 9)
    found = [np.zeros((0, 3))]
    for lane, record in enumerate(strip.lanes):
        if record.type == "driving":
            left, right = strip.lane_edges(lane)
            lines = left + shares[:, None, None] * (right - left)
            at = np.linspace(0.0, 1.0, max(2, 2 * int(strip.s_m[-1] - strip.s_m[0])))
            own = (strip.s_m - strip.s_m[0]) / (strip.s_m[-1] - strip.s_m[0])
            for line in lines:
                found.append(np.column_stack([np.interp(at, own, line[:, k]) for k in range(3)]))
    return np.concatenate(found)
