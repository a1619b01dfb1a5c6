"""What wheels feel of a road lies where pictures show it."""

import numpy as np
import pytest
from shared_fixtures.worlds.small_towns import Built, cast

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.roads.road_events import HEIGHT_M

o3d = pytest.importorskip("open3d")

DOWN = (0.0, 0.0, -1.0)


def seen_lift(built: Built, xy: Array) -> Array:
    """Height of what is seen of the road above the lane below it [m]."""
    eye = np.column_stack([xy, np.full(len(xy), 3.0)])
    solid = o3d.t.geometry.RaycastingScene()
    solid.add_triangles(
        o3d.core.Tensor(built.scenery.collision_vertices_m.astype(np.float32)),
        o3d.core.Tensor(built.scenery.collision_triangles.astype(np.uint32)),
    )
    lift: Array = cast(solid, eye, DOWN) - cast(built.scene(Tag.ROAD), eye, DOWN)
    return lift


def test_every_event_is_seen(river: Built) -> None:
    """At the middle of each a thin plate lies on the road; most of the road has none."""
    events = river.scenery.road_events
    assert len(events) > 12
    lift = seen_lift(river, events[:, :2])
    assert np.mean((lift > 0.0005) & (lift < 0.006)) > 0.97
    assert np.median(np.abs(seen_lift(river, river.lanes()[:, :2]))) < 5e-4
    lowest, highest = (pick(v for pair in HEIGHT_M.values() for v in pair) for pick in (min, max))
    assert (events[:, 6] >= lowest).all()
    assert (events[:, 6] <= highest).all()


def test_a_bridge_has_a_joint_at_both_ends(river: Built) -> None:
    """Across the whole carriageway, and lower than the road."""
    wide = river.scenery.road_events
    joints = wide[(wide[:, 5] > 2.0) & (np.abs(wide[:, 4] - 0.05) < 1e-6)]
    assert len(joints) == 2
    assert (joints[:, 6] < -0.003).all()
    assert abs(joints[0, 0] - joints[1, 0]) > 10.0
