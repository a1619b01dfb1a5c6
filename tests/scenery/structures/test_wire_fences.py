"""Wire fences beside fast roads: where they stand, and where they make room."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import State
from carlaloc_env.scenery.ground.height_fields import EdgeField, GroundGrid
from carlaloc_env.scenery.ground.road_edges import RoadEdge, Waysides
from carlaloc_env.scenery.ground.terrain import Terrain, Zones
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.structures.wire_fences import CLEAR_M, FENCE_AWAY_M, POST_M, add_wire_fences

LENGTH = 200
LINE = np.column_stack([np.arange(LENGTH + 1.0), np.zeros(LENGTH + 1), np.full(LENGTH + 1, 2.0)])
EDGE = RoadEdge(
    name="test",
    strip=None,  # type: ignore[arg-type]
    line_m=LINE,
    right=np.tile([0.0, -1.0], (LENGTH + 1, 1)),
    state=np.zeros(LENGTH + 1, dtype=np.int8),
    lift_m=np.zeros(LENGTH + 1),
    sidewalk=False,
    limit_mps=80.0 / 3.6,
    road_type="motorway",
)
ROAD = shapely.box(0.0, 0.0, LENGTH, 14.0)
COUNTRY = Zones([("highway", shapely.box(-50.0, -100.0, 300.0, 100.0))])


@pytest.fixture(scope="module")
def ground() -> Terrain:
    field = EdgeField([LINE])
    return Terrain(edge=field, grid=GroundGrid(field.points_m, np.array([-50.0, -50]), np.array([250.0, 50])))


def built(
    edge: RoadEdge, blocked: shapely.Geometry, ground: Terrain, zones: Zones
) -> tuple[Mesh, Mesh, shapely.Geometry]:
    out, solid = MeshBuilder(), MeshBuilder()
    ways = Waysides(edges=[edge], zones=zones, ground=ground, seed=0)
    taken = add_wire_fences(out, solid, ways, blocked)
    return out.build(), solid.build(), taken


def test_a_fence_runs_beside_the_whole_road_on_the_ground(ground: Terrain) -> None:
    seen, solid, taken = built(EDGE, ROAD, ground, COUNTRY)
    assert set(seen.tag.tolist()) == {Tag.FENCE}
    along, across, height = seen.vertices_m.T
    assert along.min() < 0.1
    assert along.max() > LENGTH - 0.1
    np.testing.assert_allclose(across, -FENCE_AWAY_M, atol=0.06)
    assert height.max() == pytest.approx(2.0 + POST_M, abs=0.01)
    assert height.min() < 2.0
    assert solid.vertices_m[:, 2].max() == pytest.approx(2.0 + POST_M, abs=0.01)
    assert taken.area == pytest.approx(1.6 * LENGTH, rel=0.02)


def test_it_leaves_room_for_what_stands_there(ground: Terrain) -> None:
    barn = shapely.box(90.0, -20.0, 110.0, -8.0)
    seen, _, _ = built(EDGE, shapely.union(ROAD, barn), ground, COUNTRY)
    points: NDArray[np.float64] = seen.vertices_m[:, :2].astype(np.float64)
    assert shapely.distance(barn, shapely.points(points)).min() > CLEAR_M - 0.1
    assert np.ptp(points[:, 0]) > 0.9 * LENGTH


@pytest.mark.parametrize("why", ["slow", "sidewalk", "bridge", "town"])
def test_streets_and_bridges_have_none(why: str, ground: Terrain) -> None:
    edge = {
        "slow": replace(EDGE, limit_mps=50.0 / 3.6),
        "sidewalk": replace(EDGE, sidewalk=True),
        "bridge": replace(EDGE, state=np.full(LENGTH + 1, State.OPEN, dtype=np.int8)),
        "town": EDGE,
    }[why]
    zones = Zones([("downtown", COUNTRY[0][1])]) if why == "town" else COUNTRY
    seen, solid, taken = built(edge, ROAD, ground, zones)
    assert len(seen.triangles) == len(solid.triangles) == 0
    assert taken.is_empty
