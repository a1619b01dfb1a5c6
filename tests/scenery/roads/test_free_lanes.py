"""Lanes of the packaged towns are free: what wheels touch there is the road that is seen."""

import numpy as np
import pytest

import carlaloc_env
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.town.build import load_town

o3d = pytest.importorskip("open3d")

ACROSS = (-0.4, -0.2, 0.0, 0.2, 0.4)
"""Shares of a lane's width at which it is looked at."""
EYE_M = 1.0
"""How far above the lane one looks down from; cars are that high everywhere [m]."""


@pytest.mark.soak
@pytest.mark.parametrize("name", carlaloc_env.TOWNS)
def test_solid_and_seen_lanes_agree(name: str) -> None:
    """Every half metre of every driving lane nothing stands on it, and what is seen is what is solid.

    Within 10 cm of the lane's middle, as roads lean, and within 3 cm of each other.
    """
    town = load_town(name)
    points = _lane_points(town.network)
    vertices = np.concatenate([chunk.vertices_m for chunk in town.chunks])
    first = np.cumsum([0, *(len(chunk.vertices_m) for chunk in town.chunks[:-1])])
    triangles = np.concatenate([c.triangles + np.uint32(n) for c, n in zip(town.chunks, first, strict=True)])
    seen = _heights(vertices, triangles, points)
    hit = town.outline
    solid = _heights(
        hit.collision_vertices_m.astype(np.float32), hit.collision_triangles.astype(np.uint32), points
    )
    off = np.abs(solid - points[:, 2])
    assert off.max() < 0.1, points[np.argmax(off)]
    gap = np.abs(solid - seen)
    assert gap.max() < 0.03, points[np.argmax(gap)]


def _lane_points(network: LaneNetwork) -> np.ndarray:
    """Points [m] on all driving lanes, (N, 3)."""
    found = []
    for lane in network.lanes:
        station = np.arange(0.25, lane.length_m, 0.5)
        if lane.type != "driving" or not len(station):
            continue
        number = np.full(len(station), lane.index)
        pose = network.pose(number, station)
        left = np.stack([-np.sin(pose.heading_rad), np.cos(pose.heading_rad)], axis=-1)
        width = network.width_m(number, station)
        for share in ACROSS:
            at = pose.position_m.copy()
            at[:, :2] += (share * width)[:, None] * left
            found.append(at)
    return np.concatenate(found)


def _heights(vertices_m: np.ndarray, triangles: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Height [m] of the first surface below `EYE_M` above points, (N,)."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.ascontiguousarray(vertices_m)), o3d.core.Tensor(np.ascontiguousarray(triangles))
    )
    rays = np.zeros((len(points_m), 6), np.float32)
    rays[:, :3], rays[:, 5] = points_m + np.array([0.0, 0.0, EYE_M]), -1.0
    heights: np.ndarray = points_m[:, 2] + EYE_M - scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    return heights
