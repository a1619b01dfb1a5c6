"""Ground tables, traffic tables and models from the cache are those made anew, to the last bit."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.equality import assert_same
from shared_fixtures.worlds.maps import CROSSING

from carlaloc_env.assets import model_library
from carlaloc_env.assets.model_library import build_library
from carlaloc_env.core.files.shared_arrays import SHARED_FROM_BYTES
from carlaloc_env.physics.ground_heights import ground_arrays, ground_table, kept_ground
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.standing_traffic import TrafficTables, kept_tables

Made = Callable[[], Any]
"""Makes or fetches something to compare."""


def waves(count: int) -> tuple[Any, Any]:
    """A square of waves, of so many squares a side, beside one large triangle."""
    x, y = np.meshgrid(np.arange(count + 1.0), np.arange(count + 1.0), indexing="ij")
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    halves = [[first, first + count + 1, first + 1], [first + 1, first + count + 1, first + count + 2]]
    vertices = np.stack([x, y, np.sin(0.3 * x) * np.cos(0.2 * y)], axis=-1).reshape(-1, 3)
    triangles = np.concatenate([np.stack(half, axis=-1) for half in halves])
    far = np.array([[-50.0, 0.0, 1.0], [-10.0, 0.0, 1.0], [-10.0, 40.0, 2.0]])
    return np.concatenate([vertices, far]), np.concatenate([triangles, len(vertices) + np.arange(3)[None]])


def frozen(arrays: dict[str, Any]) -> list[Any]:
    """Arrays by name, as they are compared: whether they can be written to does not count."""
    copies = {name: value.copy() for name, value in arrays.items()}
    return [*copies, *copies.values()]


def small_models() -> dict[str, Mesh]:
    look = {"material": Material.GLASS, "tag": Tag.CAR, "instance": 3}
    empty = make_mesh(np.zeros((0, 3)), np.zeros((0, 3)), material=Material.PLAIN, tag=Tag.ROAD)
    return {"one/low": make_mesh([[0, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2]], **look), "none": empty}  # type: ignore[arg-type]


def arrays_of(models: dict[str, Mesh]) -> list[Any]:
    fields = ("vertices_m", "triangles", "normals", "uv_m", "colour", "material", "tag", "instance")
    return [frozen({name: getattr(mesh, name) for name in fields}) for mesh in models.values()]


def library_again() -> list[Any]:
    build_library.cache_clear()
    library = build_library()
    return arrays_of(dict(zip(library.names, library.meshes, strict=True)))


def traffic_of(tables: TrafficTables) -> list[Any]:
    parts = [getattr(tables, name) for name in ("roads", "walker_network", "cells", "overlaps")]
    return [*parts, tables.starting_positions(5, np.zeros((0, 3)))]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path))
    return tmp_path


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Town:
    """A crossing with lights, crosswalks and a route."""
    return load_town(CROSSING, cache_dir=tmp_path_factory.mktemp("town"))


@pytest.fixture
def makers(town: Town, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, tuple[Made, Made]]]:
    """By the kind of a file: makes something anew, and fetches the same through the cache."""
    mesh = waves(150)
    monkeypatch.setattr(model_library, "make_models", small_models)
    yield {
        "ground": (
            lambda: frozen(ground_arrays(ground_table(*mesh))),
            lambda: frozen(ground_arrays(kept_ground(*mesh))),
        ),
        "traffic": (
            lambda: traffic_of(TrafficTables(town.network, town.route)),
            lambda: traffic_of(kept_tables(town)),
        ),
        "models": (lambda: arrays_of(small_models()), library_again),
    }
    build_library.cache_clear()


@pytest.mark.parametrize("kind", ["ground", "traffic", "models"])
def test_it_is_the_same_when_made_kept_and_made_again_of_a_damaged_file(
    kind: str, makers: dict[str, tuple[Made, Made]], cache: Path
) -> None:
    make, fetched = makers[kind]
    anew = make()
    for _ in range(2):
        assert_same(fetched(), anew)
        (file,) = cache.glob(f"*.{kind}")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x40
    file.write_bytes(content)
    assert_same(fetched(), anew)
    assert file.read_bytes() != content


def test_small_grounds_are_not_kept_and_moved_ones_apart(cache: Path) -> None:
    small, large = waves(20), waves(150)
    assert small[0].nbytes + small[1].nbytes < SHARED_FROM_BYTES < large[0].nbytes + large[1].nbytes
    for vertices_m, triangles in (small, large, (large[0] + [0.0, 0.0, 1e-9], large[1])):
        kept_ground(vertices_m, triangles)
    assert not kept_ground(*large).triangle.flags.writeable
    assert len(list(cache.glob("ground-*.ground"))) == 2


def test_another_route_has_other_traffic_tables(town: Town, cache: Path) -> None:
    """Also under the same name: the file is named after all that its tables come from."""
    other = replace(town, roads=replace(town.roads, route=None))
    first, second = kept_tables(town), kept_tables(other)
    assert not np.array_equal(first.roads.lane.demand, second.roads.lane.demand)
    assert_same(traffic_of(second), traffic_of(TrafficTables(town.network)))
    assert len(list(cache.glob("*.traffic"))) == 2
