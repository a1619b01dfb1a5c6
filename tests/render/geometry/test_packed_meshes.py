"""Meshes on their way to the graphics: what is let go, and which bodies are closed."""

import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from carlaloc_env.scene.mesh import Mesh

packed_meshes = pytest.importorskip("carlaloc_env.render.geometry.packed_meshes", reason="needs moderngl")


def test_meshes_of_an_iterator_are_let_go_as_soon_as_they_are_packed(scenery: Any) -> None:
    """Of a scene's levels of detail no more than one mesh is held beside what is packed."""
    held: list[weakref.ref[Any]] = []

    def boxes() -> Iterator[Mesh]:
        for x in range(4):
            assert sum(ref() is not None for ref in held) <= 1
            box = scenery.box([x, 0, 0], [x + 1, 1, 1])
            held.append(weakref.ref(box.normals))
            yield box

    vertices, triangles, count = packed_meshes._end_to_end(boxes())
    assert not any(ref() is not None for ref in held)
    assert count.tolist() == [12] * 4
    corners_m = vertices["position"][triangles]
    for x in range(4):
        own = corners_m[12 * x : 12 * (x + 1)]
        assert (own[..., 0].min(), own[..., 0].max()) == (x, x + 1)


def test_a_box_is_closed_until_a_side_is_missing(scenery: Any) -> None:
    box = scenery.box([0, 0, 0], [2, 1, 1])
    assert packed_meshes._is_closed(box.vertices_m, box.triangles)
    normal = box.normals[box.triangles[:, 0]]
    without_roof = box.triangles[np.sum(normal * [0, 0, 1], axis=1) < 0.5]
    assert len(without_roof) == 10
    assert not packed_meshes._is_closed(box.vertices_m, without_roof)


def test_kept_models_are_those_that_were_packed(
    scenery: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path))
    monkeypatch.setattr(packed_meshes, "SHARED_FROM_BYTES", 0)
    for size in (1, 2):
        boxes = [scenery.box([x, 0, 0], [x + size, 1, 1]) for x in range(3)]
        made, kept = packed_meshes.packed_models(boxes), packed_meshes.packed_models(boxes)
        assert made["vertices"].view(packed_meshes.VERTEX)["position"][:, 0].max() == 2 + size
        assert all(np.array_equal(made[name], kept[name]) for name in made)
    assert len(list(tmp_path.glob("*.packed"))) == 2
