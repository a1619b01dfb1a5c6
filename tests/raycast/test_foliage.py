"""Rays in foliage: Beer and Lambert's law, and what they meet instead where leaves end or a wall stands."""

from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag

pytest.importorskip("open3d", reason="open3d is not installed")
from carlaloc_env.raycast import Hits
from carlaloc_env.raycast.foliage import CELL_M, DEEPEST_M, FREE_PATH_M, GAP_M, leaf_depths


def depths(entry_m: F32, origin_m: Array | None = None) -> Array:
    out = np.empty(len(entry_m))
    leaf_depths(entry_m, np.zeros(3) if origin_m is None else origin_m, out)
    return out


def places(count: int, seed: int = 1) -> F32:
    return np.random.default_rng(seed).uniform(-200.0, 200.0, (count, 3)).astype(np.float32)


def within(depth_m: float) -> float:
    """Share of the rays that meet a leaf before a depth, of those that get no farther than the deepest."""
    return float((1 - np.exp(-depth_m / FREE_PATH_M)) / (1 - np.exp(-DEEPEST_M / FREE_PATH_M)))


def test_depths_follow_beer_and_lambert() -> None:
    found = depths(places(40_000))
    for depth_m in (0.1, FREE_PATH_M, 2 * FREE_PATH_M):
        assert np.mean(found < depth_m) == pytest.approx(within(depth_m), abs=0.008)
    assert found.min() >= 0.0
    assert found.max() <= DEEPEST_M


def test_depths_belong_to_places_of_the_world() -> None:
    """The same from another origin, alike within a cell, and unlike in the next one."""
    entry = np.round(places(2000) / CELL_M) * CELL_M + 0.5 * CELL_M
    moved = np.array([12.0, -7.0, 3.0])
    assert np.array_equal(depths((entry - moved).astype(np.float32), moved), depths(entry.astype(np.float32)))
    near = (entry + 0.2 * CELL_M).astype(np.float32)
    assert np.array_equal(depths(near), depths(entry.astype(np.float32)))
    beside = depths((entry + np.array([CELL_M, 0.0, 0.0])).astype(np.float32))
    assert abs(np.corrcoef(beside, depths(entry.astype(np.float32)))[0, 1]) < 0.1


def cast(scenery: Any, *boxes: Any) -> Hits:
    """Rays along x from a square at x = 0."""
    world = scenery.world(list(boxes))
    side = np.random.default_rng(4).uniform(-3.0, 3.0, (6000, 2)) + np.array([0.0, 4.0])
    origins = np.column_stack([np.zeros(6000), side])
    ahead = np.broadcast_to([1.0, 0.0, 0.0], (6000, 3))
    found: Hits = world.rays().cast(
        origins, ahead, np.zeros(6000, np.int64), scenery.drive(scenery.straight(), 0.1), 100.0
    )
    return found


def leaves(scenery: Any, near_m: float, far_m: float) -> Any:
    return scenery.box([near_m, -9, -9], [far_m, 9, 12], Material.LEAF, Tag.VEGETATION)


def test_rays_end_between_the_surfaces_of_a_crown_or_leave_it_at_the_last(scenery: Any) -> None:
    """A hedge of 0.6 m: those that would get deeper end at its back."""
    hits = cast(scenery, leaves(scenery, 10.0, 10.6))
    assert np.all(hits.material == Material.LEAF)
    assert hits.range_m.min() >= 10.0 - 1e-4
    assert hits.range_m.max() == pytest.approx(10.6, abs=1e-3)
    assert np.mean(hits.range_m < 10.3) == pytest.approx(within(0.3), abs=0.02)
    assert np.mean(hits.range_m > 10.599) == pytest.approx(1 - within(0.6), abs=0.02)


def test_a_wall_behind_leaves_is_met_as_often_as_rays_get_there(scenery: Any) -> None:
    ivy, wall = leaves(scenery, 10.0, 10.2), scenery.box([10.3, -9, -9], [11, 9, 12], Material.BRICK_RED)
    hits = cast(scenery, ivy, wall)
    through = hits.material == Material.BRICK_RED
    assert np.mean(through) == pytest.approx(1 - within(0.3), abs=0.02)
    assert np.abs(hits.range_m[through] - 10.3).max() < 1e-3
    assert np.all(hits.tag[through] == Tag.BUILDING)
    assert hits.range_m[~through].max() < 10.3


def test_crowns_far_behind_one_another_are_two(scenery: Any) -> None:
    gap_m = GAP_M + 0.2
    hits = cast(scenery, leaves(scenery, 10.0, 10.1), leaves(scenery, 10.1 + gap_m, 13.0))
    assert hits.range_m.max() < 10.1 + 1e-3
