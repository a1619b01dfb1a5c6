"""Vehicles against their sizes, their axles and the rays that meet them; number plates."""

import numpy as np
import pytest
from shared_fixtures.worlds.meshes import facing_away, model, signed_volume_m3

from carlaloc_env.assets.catalog import VEHICLES, WALKERS
from carlaloc_env.assets.number_plates import (
    PLATES,
    plate_of,
    plate_text,
    plate_uv,
)
from carlaloc_env.assets.vehicles.body import loft_body
from carlaloc_env.assets.vehicles.car_models import CARS
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag


@pytest.mark.parametrize("name", VEHICLES)
def test_vehicle_fills_its_box_and_stands_on_the_ground(library: ModelLibrary, name: str) -> None:
    mesh = model(library, name)
    low, high = mesh.bounds_m
    np.testing.assert_allclose(high - low, VEHICLES[name].size_m, rtol=0.02)
    np.testing.assert_allclose(0.5 * (low + high)[:2], 0.0, atol=0.012)
    assert abs(low[2]) < 1e-3
    assert signed_volume_m3(mesh) > 0
    assert 2000 < len(mesh.triangles) < 5000
    assert 300 < len(model(library, f"{name}/low").triangles) < 1100


@pytest.mark.parametrize(
    "name", [n for n, v in VEHICLES.items() if v.tag is Tag.CAR or n in ("van", "pickup")]
)
def test_four_wheels_touch_the_ground_at_the_axles(library: ModelLibrary, name: str) -> None:
    mesh = model(library, name)
    rubber = mesh.material == Material.RUBBER
    touching = mesh.vertices_m[rubber & (mesh.vertices_m[:, 2] < 1e-3)]
    axles = np.unique(np.round(touching[:, 0], 3))
    assert len(axles) == 2
    assert axles[1] - axles[0] == pytest.approx(VEHICLES[name].wheelbase_m, abs=0.01)
    for axle in axles:
        sides = touching[np.abs(touching[:, 0] - axle) < 1e-3, 1]
        assert sides.min() < -0.5 < 0.5 < sides.max()


@pytest.mark.parametrize("name", VEHICLES)
def test_car_shell_volume_is_a_large_part_of_its_box(library: ModelLibrary, name: str) -> None:
    if name not in CARS:
        pytest.skip("not a closed body")
    share = signed_volume_m3(loft_body(CARS[name].shape, Tag.CAR)) / np.prod(VEHICLES[name].size_m)
    assert 0.4 < share < 0.9


@pytest.mark.parametrize(
    "name", ["saloon", "pickup", "bus", "lorry", "motorcycle", "bicycle", "walker_woman/05", "ego"]
)
def test_models_show_their_outside(library: ModelLibrary, name: str) -> None:
    assert facing_away(model(library, name)) < 0.01


def test_riders_sit_on_cycles(library: ModelLibrary) -> None:
    for name in ("motorcycle", "bicycle"):
        mesh = model(library, name)
        assert set(np.unique(mesh.tag)) == {int(VEHICLES[name].tag), int(Tag.RIDER)}
        assert mesh.vertices_m[mesh.tag == Tag.RIDER, 2].max() > 1.5


def test_ego_spans_its_place_about_the_rear_axle(library: ModelLibrary) -> None:
    low, high = model(library, "ego").bounds_m
    np.testing.assert_allclose([low[0], high[0]], [-0.95, 3.75], atol=0.03)
    np.testing.assert_allclose(high - low, EGO_SIZE_M, rtol=0.02)
    mesh = model(library, "ego")
    rubber = mesh.vertices_m[(mesh.material == Material.RUBBER) & (mesh.vertices_m[:, 2] < 1e-3)]
    np.testing.assert_allclose(np.unique(np.round(rubber[:, 0], 3)), [0.0, 2.875], atol=2e-3)


def test_plates_read_differently_and_lie_apart() -> None:
    assert len({plate_text(k) for k in range(PLATES)}) == PLATES >= 64
    rects = np.array([plate_uv(k) for k in range(PLATES)])
    for k in range(PLATES):
        u0, v0, u1, v1 = rects[k]
        apart = (rects[:, 2] <= u0) | (rects[:, 0] >= u1) | (rects[:, 3] <= v0) | (rects[:, 1] >= v1)
        assert apart.sum() == PLATES - 1
    assert len(np.unique(plate_of(np.arange(300, dtype=np.uint32) + EGO_INSTANCE + 1))) > 55


def test_shares_of_families_and_colours_add_up() -> None:
    assert sum(v.weight for v in VEHICLES.values()) == pytest.approx(1.0)
    assert sum(w.weight for w in WALKERS.values()) == pytest.approx(1.0)
    for family in (*VEHICLES.values(), *WALKERS.values()):
        assert sum(share for _, share in family.tints) == pytest.approx(1.0)
