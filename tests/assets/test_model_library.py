"""Movable models kept on disk: all of them, the same as made anew, and made anew when the file is damaged."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.assets import model_library
from carlaloc_env.assets.catalog import VEHICLES, WALKERS
from carlaloc_env.assets.model_library import build_library
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, ModelLibrary, make_mesh, meshes_from_arrays, meshes_to_arrays
from carlaloc_env.scene.semantic_tags import Tag

FIELDS = ("vertices_m", "triangles", "normals", "uv_m", "colour", "material", "tag", "instance")


def small(x_m: float) -> Mesh:
    return make_mesh(
        [[x_m, 0, 0], [x_m, 1, 0], [x_m, 0, 1]], [[0, 1, 2]], material=Material.GLASS, tag=Tag.CAR, instance=3
    )


def assert_same(one: Mesh, other: Mesh) -> None:
    for name in FIELDS:
        assert getattr(one, name).dtype == getattr(other, name).dtype
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.fixture
def makes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[list[int]]:
    """An empty cache and two small models; counts how often these are made."""
    made: list[int] = []

    def make() -> dict[str, Mesh]:
        made.append(1)
        return {"one/low": small(0.0), "two": small(4.0)}

    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path))
    monkeypatch.setattr(model_library, "make_models", make)
    build_library.cache_clear()
    yield made
    build_library.cache_clear()


def again() -> ModelLibrary:
    build_library.cache_clear()
    return build_library()


def test_meshes_come_back_from_arrays_as_they_were() -> None:
    empty = make_mesh(np.zeros((0, 3)), np.zeros((0, 3)), material=Material.PLAIN, tag=Tag.ROAD)
    meshes = [small(1.0), empty, small(2.0)]
    for one, other in zip(meshes, meshes_from_arrays(meshes_to_arrays(meshes)), strict=True):
        assert_same(one, other)


def test_models_are_made_once_and_read_afterwards(makes: list[int]) -> None:
    first, second = again(), again()
    assert len(makes) == 1
    assert first.names == second.names == ("one/low", "two")
    for one, other in zip(first.meshes, second.meshes, strict=True):
        assert_same(one, other)


def test_a_damaged_file_is_made_anew(makes: list[int], tmp_path: Path) -> None:
    again()
    (stored,) = tmp_path.glob("*.models")
    content = bytearray(stored.read_bytes())
    content[-5] ^= 1
    stored.write_bytes(content)
    assert_same(again().meshes[0], small(0.0))
    assert len(makes) == 2


def test_files_of_earlier_versions_are_dropped(makes: list[int], tmp_path: Path) -> None:
    for number in range(5):
        (tmp_path / f"models-{number:032x}.models").write_bytes(b"")
    again()
    assert len(makes) == 1
    left = list(tmp_path.glob("*.models"))
    assert len(left) == model_library.KEPT_FILES
    assert max(path.stat().st_size for path in left) > 0


def test_a_cache_that_cannot_be_written_is_done_without(
    makes: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "file" / "cache"))
    # Neither can the folder among temporary files that stands in.
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    assert len(again()) == 2
    assert "cannot be cached" in caplog.text


def test_shares_of_families_and_colours_add_up() -> None:
    assert sum(v.weight for v in VEHICLES.values()) == pytest.approx(1.0)
    assert sum(w.weight for w in WALKERS.values()) == pytest.approx(1.0)
    for family in (*VEHICLES.values(), *WALKERS.values()):
        assert sum(share for _, share in family.tints) == pytest.approx(1.0)
