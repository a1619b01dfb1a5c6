"""Coats, panes and leaves against the distributions they are drawn from."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest
from shared_fixtures.readings.lidar_scans import MOUNT, sweep

from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.sensors.lidar_config import LidarConfig

pytest.importorskip("open3d", reason="open3d is not installed")

details = pytest.importorskip("carlaloc_env.sensors.lidar.surface_details")
raycast = pytest.importorskip("carlaloc_env.raycast")
reflection = pytest.importorskip("carlaloc_env.sensors.lidar.reflection")


def places(count: int, size_m: float = 4000.0) -> Array:
    return np.random.default_rng(4).uniform(-0.5 * size_m, 0.5 * size_m, (count, 3))


def met(at_m: Array, material: Material, instance: Any, eye_m: tuple[float, float, float]) -> Any:
    """Hits at places seen from an eye: their rows, reflectances, heights and cosines."""
    away = at_m - np.array(eye_m)
    r = np.linalg.norm(away, axis=1)
    rays = np.concatenate([np.zeros_like(away), away / r[:, None]], axis=1)
    hits = raycast.Hits.none(len(at_m))
    hits.range_m[:], hits.material[:], hits.instance[:], hits.cos_incidence[:] = r, material, instance, 0.25
    return *details.surface_details(rays, hits, np.array(eye_m)), hits.cos_incidence


def coat_of(share: F32, material: Material) -> Array:
    return np.asarray(share * reflection.reflection_table().diffuse[material])


def test_coats_are_even_in_their_logarithm() -> None:
    """One for each thing and material, up to white; the ground, which has no number, keeps its mean."""
    things = np.arange(1, 6001)
    _, share, height_m, cosine = met(places(6000), Material.RUBBER, things, (0.0, 0.0, 0.0))
    span = np.log(details.PALEST / details.DARKEST)
    assert kstest(np.log(share / details.DARKEST) / span, "uniform").pvalue > 0.01
    assert np.all(height_m == 0)
    assert np.all(cosine == 0.25)
    _, white, _, _ = met(places(6000), Material.PLASTER, things, (0.0, 0.0, 0.0))
    assert coat_of(white, Material.PLASTER).max() == pytest.approx(details.WHITEST)
    assert abs(np.corrcoef(np.log(white), np.log(share))[0, 1]) < 0.05
    _, one, _, _ = met(places(500), Material.RUBBER, 7, (0.0, 0.0, 0.0))
    assert np.all(one == share[6])
    rows, *_ = met(places(500), Material.PAVEMENT, 0, (0.0, 0.0, 0.0))
    assert len(rows) == 0


def test_leaves_hang_at_all_angles() -> None:
    """Cosines on leaves have the distribution c² and the mean 2/3."""
    *_, cosine = met(places(20_000), Material.LEAF, 3, (0.0, 0.0, 0.0))
    assert kstest(cosine**2, "uniform").pvalue > 0.01
    assert cosine.mean() == pytest.approx(2 / 3, abs=0.01)


@pytest.mark.parametrize("material", [Material.WINDOW, Material.SHOP_FRONT, Material.CURTAIN_WALL])
def test_panes_are_frames_things_and_holes(material: Material) -> None:
    """Shares and reflectances are the table's; depths behind the glass are exponential."""
    frames, things, seen, deep_m = details.PANES[material]
    _, share, height_m, _ = met(places(40_000), material, 3, (0.0, 0.0, 0.0))
    level = coat_of(share, material)
    for expected, value in ((frames, details.FRAME), (things, seen), (1 - frames - things, details.DUST)):
        assert np.mean(np.isclose(level, value, rtol=1e-4)) == pytest.approx(expected, abs=0.01)
    behind = np.isclose(level, seen, rtol=1e-4)
    assert np.all(height_m[~behind] == 0)
    assert kstest(-height_m[behind], "expon", args=(0, deep_m)).pvalue > 0.01


def test_places_look_the_same_from_everywhere() -> None:
    """The middles of cells have the same details from two eyes."""
    # Middles of the turned lattice's cells, which single precision of far rays does not leave.
    cell = np.random.default_rng(5).integers(-200, 200, (3000, 3)) + 0.5
    u, v, z = 0.25 * cell.T
    turned = np.stack([0.8290 * u + 0.5592 * v, -0.5592 * u + 0.8290 * v, z], axis=1)
    one = met(turned, Material.SHOP_FRONT, 3, (10.0, -5.0, 1.8))
    two = met(turned, Material.SHOP_FRONT, 3, (-60.0, 40.0, 2.0))
    same = np.isclose(one[1], two[1]) & np.isclose(one[2], two[2])
    assert same.mean() > 0.995


def test_glass_fronts_answer_in_part(scenery: Any) -> None:
    """Of a glass front 20 m ahead frames and dark panels return: half of all beams."""
    wall = scenery.box([21.2, -60, -60], [22.2, 60, 60], Material.CURTAIN_WALL, instance=9)
    values = {**LidarConfig.preset_values("hdl32e_road"), "dropoff_general": 0.0, "roof_rack": False}
    cloud, labelled = sweep(
        scenery.world([wall]), scenery.drive(scenery.straight(), 0.2), LidarConfig(mount=MOUNT, **values)
    )
    x, y, _ = cloud.points_xyz_m.T
    ahead = (np.abs(y) < 0.4 * x) & (labelled.instance == 9)
    beams = 32 * 1085 * 2 * np.arctan(0.4) / (2 * np.pi)
    frames, things, _, _ = details.PANES[Material.CURTAIN_WALL]
    assert np.count_nonzero(ahead) / beams == pytest.approx(frames + things, abs=0.06)
