"""Equal vertices become one, and the triangles stay what they are."""

import numpy as np

from carlaloc_env.render.geometry.unique_vertices import without_doubles

ROW = np.dtype([("position", "<f4", 3), ("id", "<u4")])


def test_triangles_keep_their_corners_and_no_two_vertices_are_equal() -> None:
    """10 000 vertices of 400 kinds: as many are left as numpy finds, in the order of their appearance."""
    draw = np.random.default_rng(3)
    kinds = np.zeros(400, ROW)
    kinds["position"] = draw.normal(size=(400, 3))
    kinds["id"] = draw.integers(0, 1 << 32, 400)
    vertices = kinds[draw.integers(0, 400, 10_000)]
    triangles = draw.integers(0, 10_000, (3000, 3)).astype(np.uint32)
    left, renamed = without_doubles(vertices, triangles)
    np.testing.assert_array_equal(left[renamed], vertices[triangles])
    _, first = np.unique(vertices, return_index=True)
    np.testing.assert_array_equal(left, vertices[np.sort(first)])


def test_what_differs_in_one_bit_stays_apart() -> None:
    """Zero and negative zero are equal numbers, and yet other bytes."""
    vertices = np.zeros(3, ROW)
    vertices["position"][1, 2] = -0.0
    vertices["id"][2] = 1
    left, renamed = without_doubles(vertices, np.array([[0, 1, 2]], np.uint32))
    assert len(left) == 3
    assert renamed.tolist() == [[0, 1, 2]]


def test_nothing_stays_nothing() -> None:
    """An empty scene has no vertices."""
    left, renamed = without_doubles(np.zeros(0, ROW), np.zeros((0, 3), np.uint32))
    assert len(left) == 0
    assert renamed.shape == (0, 3)
