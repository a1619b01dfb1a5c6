"""Clusters of scenery: every triangle in one of them, each small, and boxed tightly."""

import numpy as np
import pytest

from carlaloc_env.render.geometry.clusters import (
    CLUSTER_TRIANGLES,
    SIZES_M,
    cut,
    in_order,
)
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, make_mesh
from carlaloc_env.scene.semantic_tags import Tag


@pytest.fixture(scope="module")
def crowd() -> Mesh:
    """Triangles of all sizes, scattered over 60 m; neighbours share no vertex."""
    draw = np.random.default_rng(4)
    middle = draw.uniform(0.0, 60.0, (5000, 1, 3))
    size = 10.0 ** draw.uniform(-1.5, 1.3, (5000, 1, 1))
    corners = middle + size * draw.uniform(-0.5, 0.5, (5000, 3, 3))
    triangles = draw.permutation(15000).reshape(-1, 3)
    place = np.empty((15000, 3))
    place[triangles.reshape(-1)] = corners.reshape(-1, 3)
    return make_mesh(place, triangles, material=Material.PLASTER, tag=Tag.WALL)


def test_clusters_hold_every_triangle_once_and_lie_within_their_boxes(crowd: Mesh) -> None:
    group = np.random.default_rng(5).integers(0, 7, len(crowd.triangles))
    found = cut(crowd, group)
    np.testing.assert_array_equal(np.sort(found.order), np.arange(len(crowd.triangles)))
    assert found.count.sum() == len(crowd.triangles)
    assert found.count.max() == CLUSTER_TRIANGLES
    assert (np.diff(found.group) >= 0).all()
    owner = np.repeat(np.arange(len(found.count)), found.count)
    np.testing.assert_array_equal(group[found.order], found.group[owner])
    corners = crowd.vertices_m[crowd.triangles[found.order]].astype(np.float64)
    for k in range(len(found.count)):
        own = corners[owner == k]
        np.testing.assert_array_equal(found.low_m[k], own.min(axis=(0, 1)))
        np.testing.assert_array_equal(found.high_m[k], own.max(axis=(0, 1)))
        edge = (own.max(axis=1) - own.min(axis=1)).max(axis=1)
        assert (edge >= SIZES_M[-1]).all() if found.large[k] else (edge <= SIZES_M[-1]).all()


def test_clusters_are_compact() -> None:
    """A mesh of 60 m in 75 clusters and more: most boxes have a few percent of its volume."""
    draw = np.random.default_rng(7)
    corners = draw.uniform((-30, -30, 0), (30, 30, 9), (12000, 3))[:, None] + draw.uniform(
        -0.1, 0.1, (1, 3, 3)
    )
    triangles = np.arange(36000).reshape(-1, 3)
    mesh = make_mesh(corners.reshape(-1, 3), triangles, material=Material.PLASTER, tag=Tag.WALL)
    found = cut(mesh, np.zeros(12000, np.intp))
    assert len(found.count) == 75
    assert np.median(np.prod(found.high_m - found.low_m, axis=1)) < 0.05 * 60 * 60 * 9


def test_triangles_in_order_are_the_same_triangles(crowd: Mesh) -> None:
    order = np.random.default_rng(6).permutation(len(crowd.triangles))[:800]
    some = in_order(crowd, order)
    np.testing.assert_array_equal(some.vertices_m[some.triangles], crowd.vertices_m[crowd.triangles[order]])
    np.testing.assert_array_equal(some.triangles.reshape(-1), np.arange(2400))


def test_nothing_is_cut_into_nothing() -> None:
    empty = make_mesh(np.zeros((0, 3)), np.zeros((0, 3)), material=Material.PLAIN, tag=Tag.ROAD)
    assert len(cut(empty, np.zeros(0, np.intp)).count) == 0
