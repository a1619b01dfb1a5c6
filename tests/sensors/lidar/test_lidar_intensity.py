"""Intensity of LiDAR returns, and the range at which dark walls vanish."""

from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.lidar_scans import HEIGHT, paper, sweep

from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scene.semantic_tags import Tag

pytest.importorskip("open3d", reason="open3d is not installed")

lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")


def test_intensity(scenery: Any) -> None:
    """100·ρ·cosθ·exp(−a·R) for diffuse surfaces, above 100 for a retro-reflective sign face on."""
    world = scenery.world(
        [scenery.ground(), scenery.box([20, -2, 0], [20.1, 2, 4], Material.SIGN, Tag.TRAFFIC_SIGN)]
    )
    cloud, labelled = sweep(world, scenery.drive(scenery.straight(), 0.2), paper(range_noise_m=0.0))
    assert labelled.tag is not None
    assert labelled.cos_incidence is not None
    r = np.linalg.norm(cloud.points_xyz_m.astype(float), axis=-1)
    road = labelled.tag == Tag.ROAD
    expected = 100 * MATERIALS[Material.ASPHALT].reflectance * (HEIGHT / r) * np.exp(-0.004 * r)
    tone = cloud.intensity[road] / expected[road]
    assert tone.mean() == pytest.approx(1.0, abs=0.02)
    near = r[road] < 12.0
    assert 0.08 < tone[near].std() < 0.16
    assert np.abs(labelled.cos_incidence[road] - HEIGHT / r[road]).max() < 1e-4
    sign = labelled.tag == Tag.TRAFFIC_SIGN
    assert cloud.intensity[sign].min() > 150
    assert cloud.intensity.max() <= 255


def test_intensity_of_even_surfaces_is_the_formula_to_the_last_hundredth(scenery: Any) -> None:
    ground = scenery.ground()
    ground.material[:] = Material.PLAIN
    cloud, _ = sweep(
        scenery.world([ground]), scenery.drive(scenery.straight(), 0.2), paper(range_noise_m=0.0)
    )
    r = np.linalg.norm(cloud.points_xyz_m.astype(float), axis=-1)
    expected = 100 * MATERIALS[Material.PLAIN].reflectance * (HEIGHT / r) * np.exp(-0.004 * r)
    assert np.abs(cloud.intensity - expected).max() < 1e-2


@pytest.mark.parametrize(("material", "reach"), [(Material.RUBBER, 35.8), (Material.PLASTER, 93.8)])
def test_dark_walls_vanish_early_when_asked(scenery: Any, material: Material, reach: float) -> None:
    """Face-on reach √(ρ/0.9)·120 m of the LISA rule, against walls at 96 % and 104 % of it."""
    config = paper(range_noise_m=0.0, drop_weak=True)
    for share, seen in ((0.96, True), (1.04, False)):
        x = 1.2 + share * reach
        world = scenery.world([scenery.box([x, -30, -30], [x + 1, 30, 30], material)])
        cloud, _ = sweep(world, scenery.drive(scenery.straight(), 0.2), config)
        ahead = np.abs(cloud.points_xyz_m[:, 1]) < 1.0
        level = np.abs(cloud.points_xyz_m[:, 2]) < 2.0
        assert bool(np.any(ahead & level)) == seen
    assert reach == pytest.approx(120 * np.sqrt(MATERIALS[material].reflectance / 0.9), abs=0.1)
