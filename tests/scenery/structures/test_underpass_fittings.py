"""Fittings of a straight underpass of 60 m: inside its walls, above the clear height, facing inwards."""

import numpy as np
import pytest

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.ground.grade_levels import Stretch
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.structures.underpass_fittings import (
    LAMP_ROWS,
    STATION_M,
    STATION_STEP_M,
    TRAY_WIDTH_M,
    Wall,
    add_fittings,
)

HALF_M, ROOF_M, LENGTH = 10.0, 5.4, 61


def fitted(length: int = LENGTH) -> tuple[Mesh, Array]:
    """Fittings of an underpass along +x, 20 m wide, and their lamps."""
    x = np.arange(float(length))
    left, right = (np.column_stack([x, np.full(length, y), 0 * x]) for y in (HALF_M, -HALF_M))
    stretch = Stretch(
        left_m=left,
        right_m=right,
        left_top_m=left + np.array([0.0, 0.0, 6.0]),
        right_top_m=right + np.array([0.0, 0.0, 6.0]),
        detached=np.ones(length, dtype=bool),
    )
    out = MeshBuilder()
    outward = np.tile([0.0, 1.0, 0.0], (length, 1))
    lamps = add_fittings(
        out, stretch, np.full(length, ROOF_M), slice(0, length), outward, np.arange(3, length - 1, 6)
    )
    return out.build(), lamps


@pytest.mark.parametrize("inward", [1.0, -1.0])
@pytest.mark.parametrize("along", [1.0, -1.0])
def test_blocks_on_a_wall_face_outwards(inward: float, along: float) -> None:
    """With its missing back a block encloses length × depth × height."""
    x = along * np.arange(10.0)
    wall = Wall(
        foot_m=np.column_stack([x, 0 * x, 0 * x]),
        inward=np.tile([0.0, inward, 0.0], (10, 1)),
        roof_m=np.full(10, 5.0),
    )
    faces = wall.block(2.0, 4.0, 0.3, wall.above_foot(2.0, 4.0, 1.0), wall.below_roof(2.0, 4.0, 1.0))
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 1])
    # The back lies in y = 0 and adds nothing.
    volume = np.sum(faces.mean(axis=1) * normals) / 3.0
    np.testing.assert_allclose(volume, 2.0 * 0.3 * 3.0)


def test_all_lies_within_the_walls_and_leaves_the_road_its_height() -> None:
    mesh, _ = fitted()
    points = mesh.vertices_m.astype(np.float64)
    assert np.abs(points[:, 1]).max() <= HALF_M + 1e-6
    assert points[:, 2].max() < ROOF_M
    assert points[:, 0].min() > -0.2
    assert points[:, 0].max() < LENGTH - 1 + 0.2
    reach = HALF_M - np.abs(points[:, 1])
    assert points[reach > TRAY_WIDTH_M + 0.3, 2].min() > 4.5
    # Lower down nothing stands out farther than a station on the sidewalk; signs hang above heads.
    low = points[:, 2] < 2.2
    assert reach[low].max() <= STATION_M[1] + 1e-6


def test_lamps_shine_in_two_rows_below_the_roof() -> None:
    mesh, lamps = fitted()
    np.testing.assert_allclose(
        np.unique(lamps[:, 1].round(6)), [HALF_M * (1 - 2 * s) for s in LAMP_ROWS[::-1]]
    )
    assert (lamps[:, 2] < ROOF_M).all()
    assert lamps[:, 2].min() > 4.5
    glow = mesh.triangles[mesh.material[mesh.triangles[:, 0]] == Material.LAMP_WHITE]
    a, b, c = (mesh.vertices_m[glow[:, k]].astype(np.float64) for k in range(3))
    assert len(glow) == 2 * len(lamps)
    assert (np.cross(b - a, c - a)[:, 2] < 0.0).all()


def test_emergency_stations_stand_no_farther_apart_than_the_directive_says() -> None:
    mesh, _ = fitted(401)
    points = mesh.vertices_m.astype(np.float64)
    reach = HALF_M - points[:, 1]
    low = (points[:, 2] < 2.2) & (np.abs(reach - STATION_M[1]) < 1e-6)
    places = np.unique(np.round(points[low, 0]))
    assert np.diff(np.concatenate([[0.0], places, [400.0]])).max() <= STATION_STEP_M
    assert len(fitted(4)[1]) == 0
