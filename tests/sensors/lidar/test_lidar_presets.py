"""LiDARs by name: points a second, times, rings and places of beams against the makers' figures."""

from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.lidar_scans import HEIGHT, MOUNT, sweep

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.lidar.sweep_rays import RayPattern
from carlaloc_env.sensors.lidar_config import LAYOUTS, LidarConfig

POINTS_S = {
    "vlp16": (289_352, 289_352),
    "hdl32e": (694_444, 694_444),
    "hdl64e": (1_333_333, 1_333_333),
    "os1_32": (32 * 1024 * 10, 32 * 1024 * 20),
    "os1_64": (64 * 1024 * 10, 64 * 1024 * 20),
    "os1_128": (128 * 1024 * 10, 128 * 1024 * 20),
    "pandar_xt32": (640_000, 640_000),
    "helios_32": (575_954, 575_954),
    "mid360": (200_000, 200_000),
    "avia": (240_000, 240_000),
    "aeries2": (1_000_000, 2_000_000),
}
"""Points a second at 10 and 20 Hz by manuals and drivers; columns of an Ouster belong to its mode."""


def preset(name: str, **changes: Any) -> LidarConfig:
    return LidarConfig(**{**LidarConfig.preset_values(name), "mount": MOUNT, **changes})


def second_of(config: LidarConfig, sweeps: int | None = None) -> tuple[Array, Array, Array]:
    """Time since the beginning [ns], ring and direction of all rays of a second."""
    rays, parts = RayPattern(config), []
    for stamp in range(0, (sweeps or round(config.rate_hz)) * config.sweep_ns, config.sweep_ns):
        one = rays.sweep(stamp, 0)
        parts.append((stamp + one.offset_ns.astype(np.int64), one.ring, one.turned(one.directions)))
    times, rings, directions = (np.concatenate(part) for part in zip(*parts, strict=True))
    return times, rings, directions


@pytest.mark.parametrize("name", POINTS_S)
@pytest.mark.parametrize("rate_hz", [10.0, 20.0])
def test_points_a_second_and_per_ring_are_the_makers(name: str, rate_hz: float) -> None:
    config = preset(name, rate_hz=rate_hz)
    _, rings, _ = second_of(config)
    expected = POINTS_S[name][rate_hz == 20.0]
    counts = np.bincount(rings)
    assert len(rings) == pytest.approx(expected, abs=1e-4 * expected)
    assert len(counts) == config.rings
    assert set(counts.tolist()) == {len(rings) // config.rings}
    assert config.layout is None or config.layout in LAYOUTS


def test_every_preset_is_compared() -> None:
    assert set(LidarConfig.presets) - set(POINTS_S) == {"paper", "hdl32e_road"}


@pytest.mark.parametrize("name", ["vlp16", "hdl64e", "helios_32"])
def test_the_phase_goes_on_from_sweep_to_sweep(name: str) -> None:
    """Each beam fires once a cycle for ever, and turns evenly: sweeps only cut this into parts."""
    config = preset(name)
    times, rings, directions = second_of(config, 7)
    for ring in (0, config.rings - 1):
        mine = np.flatnonzero(rings == ring)
        assert np.abs(np.diff(times[mine]) - config.cycle_ns).max() <= 1.0
        azimuth = np.unwrap(np.arctan2(directions[mine, 1], directions[mine, 0]))
        turned = -2.0 * np.pi * 1e-9 * config.rate_hz * times[mine]
        # Whole nanoseconds of time are 6e-8 rad.
        assert np.ptp(azimuth - turned) < 2e-7
    beginnings = times[np.flatnonzero(rings == 0)]
    assert beginnings[0] < config.cycle_ns
    assert len(np.unique([len(RayPattern(config).sweep(k * config.sweep_ns, 0)) for k in range(7)])) == 2


def test_a_vlp16_fires_by_the_numbers_of_its_lasers() -> None:
    """Manual 63-9243: lasers 0, 1, 2, … at −15, 1, −13, … degrees, 2.304 µs apart; ring 0 is the lowest."""
    one = RayPattern(preset("vlp16")).sweep(0, 0)
    elevation = np.degrees(np.arcsin(one.directions[:16, 2]))
    assert elevation == pytest.approx([-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15])
    assert one.offset_ns[:16].tolist() == [2304 * k for k in range(16)]
    assert one.ring[:4].tolist() == [0, 8, 1, 9]


@pytest.mark.parametrize(("name", "top"), [("os1_64", True), ("pandar_xt32", True), ("hdl64e", False)])
def test_rings_are_numbered_as_drivers_number_them(name: str, top: bool) -> None:
    one = RayPattern(preset(name)).sweep(0, 0)
    order = np.argsort(one.ring[: len(np.unique(one.ring))])
    assert np.all(np.diff(one.directions[order, 2]) < 0) == top


def test_an_ouster_places_points_as_its_manual_does(scenery: Any) -> None:
    """Row r of column m: (r − n)·(cos(θ − φ)·cos e, …) + n·(cos θ, sin θ, 0); walls come out flat."""
    room = [
        scenery.box([9, -9, -9], [10, 9, 20]), scenery.box([-8, -9, -9], [-7, 9, 20]),
        scenery.box([-9, 6, -9], [10, 7, 20]), scenery.box([-9, -6, -9], [10, -5, 20]),
        scenery.box([-9, -9, 9], [10, 9, 10]), scenery.box([-9, -9, -9], [10, 9, -8]),
    ]  # fmt: skip
    config = preset("os1_64", range_noise_m=0.0)
    cloud, _ = sweep(scenery.world(room), scenery.drive(scenery.straight(), 0.3), config)
    assert len(cloud.ring) == 64 * 1024
    points = cloud.points_xyz_m.astype(np.float64)
    walls = np.array([[9 - 1.2, -7 - 1.2], [6, -5], [9 - HEIGHT, -8 - HEIGHT]])
    assert np.abs(points[:, :, None] - walls[None]).min(axis=(1, 2)).max() < 2e-5
    m = np.rint(cloud.offset_ns.astype(np.float64) * 1024 / 1e8)
    # The seam of the sensor's frame lies behind; rays are those of the columns' middles.
    theta = np.pi + 2 * np.pi * (1 - (m + 0.5) / 1024)
    n = 0.016721
    beam = points - n * np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)
    offset = np.angle(np.exp(1j * (theta - np.arctan2(beam[:, 1], beam[:, 0]))))
    rows = cloud.ring.astype(int) * 2
    assert np.abs(np.degrees(offset) - np.array([4.21, 1.40, -1.40, -4.21])[rows % 4]).max() < 1e-3
    u = (2 * rows - 127) / 127
    law = -0.760 - 22.25 * u + 0.019 * u**2 + 1.025 * u**3
    elevation = np.degrees(np.arcsin(beam[:, 2] / np.linalg.norm(beam, axis=1)))
    assert np.abs(elevation - law).max() < 1e-3


@pytest.mark.parametrize("name", ["vlp16", "hdl64e", "mid360", "avia"])
def test_the_own_body_shadows_rays_that_differ_in_every_sweep(scenery: Any, name: str) -> None:
    """The third sweep with a car below the LiDAR is that without it, less the rays that meet the car."""
    low, high = np.array([-0.95, -0.92, 0.2]), np.array([3.75, 0.92, 1.45])
    ground = [scenery.ground(), scenery.box([-50, -50, 30], [50, 50, 31])]
    world = scenery.world(ground, {"ego": scenery.box(low, high)})
    drive = scenery.drive(scenery.straight(), 0.5)
    # The Mid-360 looks over the car unless it nods.
    mount = Mount(position_m=MOUNT.position_m, rpy_deg=(0.0, 35.0 if name == "mid360" else 0.0, 0.0))
    config = preset(name, mount=mount, range_noise_m=0.0, range_min_m=0.01, range_max_m=100.0)
    cloud, _ = sweep(world, drive, config, 300_000_000)
    bare, _ = sweep(scenery.world(ground), drive, config, 300_000_000)
    kept = {*zip(cloud.offset_ns.tolist(), cloud.ring.tolist(), strict=True)}
    missing = np.array(
        [key not in kept for key in zip(bare.offset_ns.tolist(), bare.ring.tolist(), strict=True)]
    )
    one = RayPattern(config).sweep(300_000_000, world.seed)
    rays = {key: k for k, key in enumerate(zip(one.offset_ns.tolist(), one.ring.tolist(), strict=True))}
    index = np.array([rays[key] for key in zip(bare.offset_ns.tolist(), bare.ring.tolist(), strict=True)])
    along, origins = (
        transforms.apply(transforms.from_rotation(mount.T_base_sensor[:3, :3]), one.turned(vectors)[index])
        for vectors in (one.directions, one.origins_m if len(one.origins_m) else 0.0 * one.directions)
    )
    origins += np.array(mount.position_m)
    with np.errstate(divide="ignore"):
        a, b = (low - origins) / along, (high - origins) / along
    near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    met = (near <= far) & (far > 0)
    assert np.count_nonzero(met) > 200
    # A ray along an edge may fall on either side in Embree's single precision.
    assert np.count_nonzero(missing != met) <= 2


def test_columns_or_cycle_are_given() -> None:
    with pytest.raises(ConfigError, match="give columns or cycle_ns"):
        preset("vlp16", columns=1800)
    assert preset("vlp16", columns=1800, cycle_ns=0.0).rays == 1800 * 16
    with pytest.raises(ConfigError, match="3 origins_m for 16 beams"):
        preset("vlp16", origins_m=((0.0, 0.0, 0.0),) * 3)
    with pytest.raises(ConfigError, match="did you mean 'ouster'"):
        preset("vlp16", layout="oster")
