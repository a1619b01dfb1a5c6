"""The LiDAR against closed forms, and against what SLAM front-ends expect of it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.readings.lidar_scans import HDL32E, HEIGHT, paper, sweep

from carlaloc_env.core.array_types import Array
from carlaloc_env.samples import PointCloud
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag

pytest.importorskip("open3d", reason="open3d is not installed")

lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")


def directions(cloud: PointCloud) -> Array:
    p = cloud.points_xyz_m.astype(np.float64)
    return p / np.linalg.norm(p, axis=-1, keepdims=True)


def test_room_of_four_walls(scenery: Any) -> None:
    """Every range in a room equals the closed form; every ray returns; 32 elevations, full circle."""
    room = [
        scenery.ground(50),
        scenery.box([20, -50, -1], [21, 50, 60]),
        scenery.box([-31, -50, -1], [-30, 50, 60]),
        scenery.box([-50, 15, -1], [50, 16, 60]),
        scenery.box([-50, -26, -1], [50, -25, 60]),
    ]
    cloud, _ = sweep(scenery.world(room), scenery.drive(scenery.straight(), 0.2), paper(range_noise_m=0.0))
    assert len(cloud.points_xyz_m) == 2078 * 32
    d = directions(cloud)
    with np.errstate(divide="ignore"):
        walls = [
            np.where(d[:, 0] > 0, 18.8 / d[:, 0], -31.2 / d[:, 0]),
            np.where(d[:, 1] > 0, 15 / d[:, 1], -25 / d[:, 1]),
            np.where(d[:, 2] < 0, -HEIGHT / d[:, 2], np.inf),
        ]
    r = np.linalg.norm(cloud.points_xyz_m.astype(np.float64), axis=-1)
    assert np.abs(r - np.min(walls, axis=0)).max() < 5e-4
    elevation = np.degrees(np.arcsin(d[:, 2]))
    for ring in range(32):
        assert np.allclose(elevation[cloud.ring == ring], -30 + 40 * ring / 31, atol=1e-4)
    assert cloud.offset_ns.max() == pytest.approx(50e6 * 2077 / 2078, abs=1)
    assert np.all(np.diff(cloud.offset_ns.astype(np.int64)) >= 0)
    azimuth = np.unwrap(np.arctan2(d[cloud.ring == 16, 1], d[cloud.ring == 16, 0]))
    assert np.all(np.diff(azimuth) < 0), "clockwise seen from above"
    assert azimuth[0] - azimuth[-1] == pytest.approx(2 * np.pi * 2077 / 2078, abs=1e-6)


def aloam_ring(cloud: PointCloud) -> NDArray[np.int64]:
    """Ring that A-LOAM computes from a 32-beam cloud, in its own float arithmetic."""
    x, y, z = cloud.points_xyz_m.T
    angle = (np.arctan(z / np.sqrt(x * x + y * y)) * np.float32(180 / np.pi)).astype(np.float32)
    return np.trunc((angle + np.float32(92.0 / 3.0)) * np.float32(3.0 / 4.0)).astype(np.int64)


def test_aloam_ring_formula(scenery: Any) -> None:
    """With +0.02° A-LOAM recovers every ring despite range noise; the bare angles lie on its bin edges."""
    world = scenery.world([scenery.ground(), scenery.box([30, -60, -1], [31, 60, 60])])
    drive = scenery.drive(scenery.straight(8.0), 0.2)
    cloud, _ = sweep(world, drive, paper(**HDL32E, elevation_offset_deg=0.02))
    assert len(np.unique(cloud.ring)) == 32
    assert np.array_equal(aloam_ring(cloud), cloud.ring)
    bare, _ = sweep(world, drive, paper(**HDL32E))
    assert np.mean(aloam_ring(bare) != bare.ring) > 0.05
    even, _ = sweep(world, drive, paper())
    assert len(np.unique(aloam_ring(even))) == 31, "the paper's angles share a bin: beams 15 and 16"


def test_hdl32e_timing(scenery: Any) -> None:
    """Firing order and 1.152 µs steps of the manual; azimuth goes on turning within a column."""
    walls = [scenery.box([-40, -40, -50], [-39, 40, 50]), scenery.box([39, -40, -50], [40, 40, 50])]
    world = scenery.world([*walls, scenery.box([-40, -40, -50], [40, 40, -49])])
    cloud, _ = sweep(world, scenery.drive(scenery.straight(), 0.2), paper(**HDL32E, range_noise_m=0.0))
    offset = cloud.offset_ns.astype(np.int64)
    assert np.all(np.diff(offset) >= 0)
    column = np.searchsorted(np.round(np.arange(1085) * 50e6 / 1085), offset, side="right") - 1
    within = offset - np.round(column * 50e6 / 1085).astype(np.int64)
    firing_order = [0, 16, 1, 17, 2, 18, 3]
    for place, ring in enumerate(firing_order):
        assert np.all(within[cloud.ring == ring] == 1152 * place)
    d = directions(cloud)
    turned = np.pi - np.unwrap(np.arctan2(d[:, 1], d[:, 0])) - np.pi / 1085
    assert np.abs(np.angle(np.exp(1j * (turned - 2 * np.pi * offset / 50e6)))).max() < 2e-5


def test_range_noise_along_the_ray(scenery: Any) -> None:
    """σ = 0.02 m ± 2 %, normal, along the ray: elevation and azimuth stay exact."""
    world = scenery.world([scenery.ground(), scenery.box([20, -90, -1], [21, 90, 60])])
    drive = scenery.drive(scenery.straight(5.0), 0.3)
    clean, noisy = [], []
    for stamp in (0, 50_000_000, 100_000_000):
        clean.append(sweep(world, drive, paper(range_noise_m=0.0), stamp)[0])
        noisy.append(sweep(world, drive, paper(), stamp)[0])
    error = np.concatenate(
        [
            np.linalg.norm(b.points_xyz_m.astype(float), axis=1)
            - np.linalg.norm(a.points_xyz_m.astype(float), axis=1)
            for a, b in zip(clean, noisy, strict=True)
        ]
    )
    assert error.std() == pytest.approx(0.02, rel=0.02)
    assert abs(error.mean()) < 4 * 0.02 / np.sqrt(len(error))
    assert np.mean(np.abs(error) < 0.02) == pytest.approx(0.6827, abs=0.01)
    assert np.abs(directions(clean[0]) - directions(noisy[0])).max() < 1e-6


def test_both_clouds_share_every_coordinate(scenery: Any) -> None:
    """The semantic cloud is the plain cloud with labels, to the byte."""
    world = scenery.world([scenery.ground(), scenery.box([20, -9, 0], [21, 9, 9], instance=5)])
    plain, labelled = sweep(world, scenery.drive(scenery.straight(5.0), 0.2), paper())
    assert (plain.sensor, labelled.sensor) == ("lidar", "lidar_semantic")
    for name in ("points_xyz_m", "intensity", "ring", "offset_ns"):
        assert getattr(plain, name).tobytes() == getattr(labelled, name).tobytes()
    assert plain.tag is None
    assert labelled.tag is not None
    assert labelled.instance is not None
    wall = labelled.points_xyz_m[:, 2] > 0
    assert np.all(labelled.tag[wall] == Tag.BUILDING)
    assert np.all(labelled.instance[wall] == 5)


def test_roof_shadows_the_ground(scenery: Any, box_range: Callable[..., Array]) -> None:
    """No ground point lies behind the own body, all others are there; own hits stay out of the cloud."""
    low, high = np.array([-0.95, -0.92, 0.2]), np.array([3.75, 0.92, 1.45])
    body = scenery.box(low, high, Material.CAR_PAINT, Tag.CAR)
    world = scenery.world([scenery.ground()], {"ego": body})
    drive = scenery.drive(scenery.weaving, 0.3)
    config = paper(range_noise_m=0.0)
    cloud, labelled = sweep(world, drive, config, 100_000_000)
    bare, _ = sweep(scenery.world([scenery.ground()]), drive, config, 100_000_000)
    d = directions(bare)
    shadowed = np.isfinite(box_range(np.broadcast_to([1.2, 0, HEIGHT], d.shape), d, low, high))
    assert np.count_nonzero(shadowed) > 5000
    assert len(cloud.points_xyz_m) == np.count_nonzero(~shadowed)
    assert cloud.points_xyz_m.tobytes() == bare.points_xyz_m[~shadowed].tobytes()
    assert labelled.instance is not None
    assert not np.any(labelled.instance == EGO_INSTANCE)
    own, labels = sweep(
        world, drive, paper(range_noise_m=0.0, ego_returns=True, range_min_m=0.1), 100_000_000
    )
    assert labels.instance is not None
    mine = labels.instance == EGO_INSTANCE
    assert np.abs(own.points_xyz_m[mine, 2].max() - (1.45 - HEIGHT)) < 1e-5
