"""A town's squares: those outside the picture are not drawn."""

import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation
from carlaloc_env.render.views import FAR_M, NEAR_M, CameraView
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.town.town import Town

CAMERA = Pinhole.from_fov(640, 360, 90.0)


@pytest.fixture(scope="module")
def chunks(town03: Town) -> tuple[Mesh, ...]:
    return town03.chunks


@pytest.fixture(scope="module")
def views(town03: Town) -> list[CameraView]:
    """A driver's eye at eight places along the route."""
    route = town03.route
    assert route is not None
    at = route.at(np.arange(8) / 8.0 * route.length_m)
    found = []
    for place, heading in zip(at.position_m, at.heading_rad, strict=True):
        c, s = np.cos(heading), np.sin(heading)
        R_world_flu = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        found.append(
            CameraView.of(
                CAMERA, from_rotation(R_world_flu @ R_FLU_OPTICAL, place + np.array([0.0, 0.0, 1.3]))
            )
        )
    return found


def _boxes(chunks: tuple[Mesh, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    bounds = np.array([chunk.bounds_m for chunk in chunks], dtype=np.float64)
    return bounds[:, 0], bounds[:, 1]


def test_only_squares_in_the_picture_are_drawn(chunks: tuple[Mesh, ...], views: list[CameraView]) -> None:
    """All that have a corner in it; none behind the eye; in the mean less than half of the triangles."""
    low, high = _boxes(chunks)
    count = np.array([len(chunk.triangles) for chunk in chunks])
    shares = []
    for view in views:
        kept, _ = view.visible(low, high)
        drawn = np.zeros(len(chunks), dtype=bool)
        drawn[kept] = True
        for chunk, seen in zip(chunks, drawn, strict=True):
            local = (chunk.vertices_m[::3].astype(np.float64) - view.position_m) @ view.R_camera_world.T
            ahead = local[:, 2] > 2.0 * NEAR_M
            uv = CAMERA.project(local[ahead])
            inside = ((uv > 0.0) & (uv < [639.0, 359.0])).all(axis=1)
            near = np.linalg.norm(local[ahead], axis=1) < 0.9 * FAR_M
            assert seen or not (inside & near).any()
        # The corner of a box that is farthest ahead lies behind the eye: so does all of the box.
        ahead_m = np.sum(np.where(view.R_camera_world[2] > 0, high, low) * view.R_camera_world[2], axis=1)
        behind = ahead_m < np.sum(view.R_camera_world[2] * view.position_m)
        assert behind.sum() > 10
        assert not drawn[behind].any()
        shares.append(count[drawn].sum() / count.sum())
    assert np.mean(shares) < 0.5
