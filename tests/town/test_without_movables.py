"""Towns without parked cars: nothing movable is left to be seen or hit, and all else is as it was."""

import numpy as np
import pytest
from shared_fixtures.worlds.small_towns import Built

from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.roads import TownRoads
from carlaloc_env.scene.mesh import merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.town import MOVABLE, Town, without_movables

pytest.importorskip("open3d", reason="Open3D casts the rays of these tests")


def town_of(built: Built) -> Town:
    """A finished town of a small map."""
    scenery = built.scenery
    assert scenery is not None
    return Town(
        name="small",
        config=TownConfig(),
        roads=TownRoads(network=built.network, geo=GeoReference(latitude_deg=0.0, longitude_deg=0.0)),
        outline=scenery,
        scenery=lambda: scenery.chunks,
    )


def test_nothing_movable_is_left(river: Built) -> None:
    town = town_of(river)
    empty = without_movables(town)
    before, after = merge(town.chunks), merge(empty.chunks)
    movable = np.isin(before.tag[before.triangles[:, 0]], MOVABLE)
    assert movable.sum() > 1000
    assert not np.isin(after.tag, MOVABLE).any()
    assert len(after.triangles) == np.count_nonzero(~movable)
    kept = before.vertices_m[before.triangles[~movable]]
    np.testing.assert_array_equal(after.vertices_m[after.triangles], kept)


def test_what_stood_there_is_not_hit_either(river: Built) -> None:
    """Every removed solid triangle is a car's; the rest is the same in the same order."""
    town = town_of(river)
    empty = without_movables(town)
    cars = town.outline.collision_tags == Tag.CAR
    assert cars.any()
    assert cars.sum() % 10 == 0  # boxes without floors
    np.testing.assert_array_equal(empty.outline.collision_triangles, town.outline.collision_triangles[~cars])
    assert len(empty.outline.collision_tags) == len(empty.outline.collision_triangles)
