"""Ground tables that come from the cache are those sorted anew, to the last bit, and read-only."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.core.files.shared_arrays import SHARED_FROM_BYTES
from carlaloc_env.physics.ground_heights import ground_arrays, ground_table, highest_below, kept_ground
from carlaloc_env.town.town import Town

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


def waves(count: int) -> Mesh:
    """A square of waves, of so many squares a side, beside one large triangle."""
    x, y = np.meshgrid(np.arange(count + 1.0), np.arange(count + 1.0), indexing="ij")
    z = np.sin(0.3 * x) * np.cos(0.2 * y)
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    halves = [[first, first + count + 1, first + 1], [first + 1, first + count + 1, first + count + 2]]
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    triangles = np.concatenate([np.stack(half, axis=-1) for half in halves])
    far = np.array([[-50.0, 0.0, 1.0], [-10.0, 0.0, 1.0], [-10.0, 40.0, 2.0]])
    return np.concatenate([vertices, far]), np.concatenate([triangles, len(vertices) + np.arange(3)[None]])


def assert_kept(mesh: Mesh, folder: Path, files: int) -> None:
    """The table of a mesh is the same made anew, made and kept, and read again."""
    anew = ground_arrays(ground_table(*mesh))
    for _ in range(2):
        table = kept_ground(*mesh)
        found = ground_arrays(table)
        assert list(found) == list(anew)
        for name, value in found.items():
            assert value.dtype == anew[name].dtype, name
            assert value.tobytes() == anew[name].tobytes(), name
        for array in (table.triangle, table.normal, table.small.inside, table.large.first):
            assert not array.flags.writeable
        assert len(list(folder.glob("ground-*.ground"))) == files


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path))
    return tmp_path


def test_large_meshes_are_kept_and_small_ones_are_not(cache: Path) -> None:
    small, large = waves(20), waves(150)
    assert small[0].nbytes + small[1].nbytes < SHARED_FROM_BYTES < large[0].nbytes + large[1].nbytes
    assert_kept(small, cache, 0)
    assert_kept(large, cache, 1)
    assert highest_below(kept_ground(*large), 30.25, 40.25, 10.0, -10.0)[0] >= 0
    moved = large[0] + np.array([0.0, 0.0, 1e-9])
    assert_kept((moved, large[1]), cache, 2)


def test_the_ground_of_a_town_is_kept(town03: Town, cache: Path) -> None:
    solid = town03.outline
    assert_kept((solid.collision_vertices_m, solid.collision_triangles.astype(np.int64)), cache, 1)


def test_a_damaged_table_is_sorted_again(cache: Path) -> None:
    mesh = waves(150)
    kept_ground(*mesh)
    (file,) = cache.glob("*.ground")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x40
    file.write_bytes(content)
    assert_kept(mesh, cache, 1)
