"""Echoes of a real LiDAR's receiver against closed forms: ranges, lost echoes, edges, the own car."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.readings.lidar_scans import MOUNT, sweep

from carlaloc_env.core.array_types import Array
from carlaloc_env.road.road_profile import LevelGrid, Roughness
from carlaloc_env.samples import PointCloud
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.lidar import reflection
from carlaloc_env.sensors.lidar_config import LidarConfig, ReceiverConfig
from carlaloc_env.weather.presets import PRESETS

pytest.importorskip("open3d", reason="open3d is not installed")

receiver = pytest.importorskip("carlaloc_env.sensors.lidar.receiver")
beams = pytest.importorskip("carlaloc_env.sensors.lidar.beams")

STILL = ReceiverConfig(
    weak_noise_m=0.0, noise_amplitude=0.0, laser_offset_m=0.0, laser_gain=0.0, range_quantum_m=0.0,
    power_levels=1, edge_rays=0, relief=False,
)  # fmt: skip
"""A receiver without any effect but reflection, detection and intensity."""


def road(changes: ReceiverConfig = STILL, **others: Any) -> Any:
    """The HDL-32E of the rig `real` with another receiver."""
    values = {**LidarConfig.preset_values("hdl32e_road"), "roof_rack": False, "range_noise_m": 0.0}
    values["dropoff_general"] = 0.0
    return LidarConfig(mount=MOUNT, **{**values, "receiver": changes, **others})


def ranges(cloud: PointCloud) -> Array:
    return np.asarray(np.linalg.norm(cloud.points_xyz_m.astype(np.float64), axis=-1))


def in_grid(cloud: PointCloud, columns: int = 1085) -> Array:
    """Ranges by column and ring, NaN where nothing came back, shape (columns, 32)."""
    grid = np.full((columns, 32), np.nan)
    column = (cloud.offset_ns.astype(np.int64) * columns + 1000) // 50_000_000
    grid[np.minimum(column, columns - 1), cloud.ring] = ranges(cloud)
    return grid


def facing(scenery: Any, x_m: float, material: Material, seed: int = 1) -> Any:
    return scenery.world([scenery.box([x_m, -60, -60], [x_m + 1, 60, 60], material)], seed=seed)


def ahead(cloud: PointCloud) -> NDArray[np.bool_]:
    x, y, z = cloud.points_xyz_m.T
    return np.asarray((np.abs(y) < 0.05 * x) & (np.abs(z) < 0.05 * x))


def backscatter(material: Material, cosine: Array) -> Array:
    table = reflection.reflection_table()
    return np.asarray(table.diffuse[material] * (cosine + table.rough[material] * (1 - cosine**2)))


def test_oren_nayar_of_facets() -> None:
    """Radiance of the law equals the sum over V-grooves' facets that it was fitted to, for small slopes.

    A facet met at θ' whose slope is α sends ρ·cos²θ'/cosα of the light on its base; slopes have a normal
    distribution and all directions. Their fit is within 6 % up to 60°; beyond, faces hide each other.
    """
    slope, azimuth = np.meshgrid(np.linspace(0, 1.2, 400), np.linspace(0, 2 * np.pi, 181)[:-1])
    weight = np.exp(-0.5 * (slope / 0.25) ** 2) * np.sin(slope)
    a, b = reflection.oren_nayar(0.25)
    for degrees in (0, 20, 40, 60):
        theta = np.radians(degrees)
        lit = np.cos(theta) * np.cos(slope) + np.sin(theta) * np.sin(slope) * np.cos(azimuth)
        facets = np.sum(weight * np.maximum(lit, 0) ** 2 / np.cos(slope)) / np.sum(weight)
        law = np.cos(theta) * (a * np.cos(theta) + b * np.sin(theta) ** 2)
        assert facets == pytest.approx(law, rel=0.06)


def test_mirrors_shine_face_on_alone(scenery: Any) -> None:
    """The lobe of glass holds its mirrored light: over the half sphere it sums to the mirrored share."""
    table = reflection.reflection_table()
    steps = np.linspace(0, np.pi / 2, 20_001)[:-1]
    width = table.mirror_slope[Material.GLASS] ** 2
    density = np.exp(-(np.tan(steps) ** 2) / width) / (np.pi * width * np.cos(steps) ** 4)
    assert np.sum(density * np.cos(steps) * 2 * np.pi * np.sin(steps)) * steps[1] == pytest.approx(
        1, rel=1e-3
    )
    cloud, _ = sweep(facing(scenery, 21.2, Material.GLASS), scenery.drive(scenery.straight(), 0.2), road())
    off_axis = np.degrees(np.arccos(cloud.points_xyz_m[:, 0] / ranges(cloud)))
    assert cloud.intensity[off_axis < 1].min() == 100
    assert off_axis.max() < 4


@pytest.mark.parametrize("material", [Material.ASPHALT, Material.PLASTER, Material.GLASS])
def test_walls_vanish_at_their_reach(scenery: Any, material: Material) -> None:
    """A wall at a slant of 45° is seen to reach·∛(ρ(θ)/0.1), against 97 % and 103 % of it."""
    narrow = replace(STILL, beam_mrad=(1e-3, 1e-3))
    cosine = np.sqrt(0.5)
    reach_m = 55 * np.cbrt(float(backscatter(material, np.array(cosine))) / 0.1)
    for share, seen in ((0.97, True), (1.03, False)):
        corner = 1.2 + share * reach_m
        # A wall through (corner, 0) along (1, 1).
        wall = scenery.box([-400, corner * cosine, -400], [400, corner * cosine + 1, 400], material)
        points = wall.vertices_m.copy()
        points[:, 0] = (wall.vertices_m[:, 0] + wall.vertices_m[:, 1]) * cosine
        points[:, 1] = (wall.vertices_m[:, 0] - wall.vertices_m[:, 1]) * cosine
        drive = scenery.drive(scenery.straight(), 0.2)
        config = road(narrow, range_max_m=400.0)
        cloud, _ = sweep(scenery.world([replace(wall, vertices_m=points)]), drive, config)
        x, y, z = cloud.points_xyz_m.T
        assert bool(np.any((x > 0) & (np.abs(y) < 0.003 * x) & (np.abs(z) < 0.03 * x))) == seen


def test_roads_are_lost_at_their_real_range(scenery: Any) -> None:
    """Asphalt is seen at 16 m and to 45–66 m, where nuScenes' scans end; intensities follow no cosine."""
    config = road(
        ReceiverConfig(power_levels=1), elevations_deg=tuple(np.linspace(-12, -1.2, 200)), firing_ns=()
    )
    world = scenery.world([scenery.ground()])
    cloud, _ = sweep(world, scenery.drive(scenery.straight(), 0.2), config)
    r = ranges(cloud)
    rings = np.array([np.mean(r[cloud.ring == ring]) for ring in np.unique(cloud.ring)])
    assert 45 < np.percentile(r, 99.9) < 66
    assert np.count_nonzero((r > 15) & (r < 17)) == 1085 * np.count_nonzero((rings > 15) & (rings < 17))
    near = (r > 9) & (r < 16)
    exponent = np.polyfit(np.log(1.85 / r[near]), np.log(cloud.intensity[near]), 1)[0]
    assert -0.4 < exponent < 0.3
    assert np.array_equal(cloud.intensity, np.round(cloud.intensity))


def test_noise_grows_as_echoes_weaken(scenery: Any) -> None:
    """σ² = σ₀² + (σ_weak/amplitude)² of a wall ahead, at three distances; ranges lie on steps."""
    noisy = replace(STILL, weak_noise_m=0.02, beam_mrad=(1e-3, 1e-3))
    drive = scenery.drive(scenery.straight(), 0.3)
    for distance in (12.0, 60.0, 95.0):
        world = facing(scenery, 1.2 + distance, Material.PLASTER)
        errors, far = [], {"range_max_m": 200.0}
        for stamp in range(0, 200_000_000, 50_000_000):
            still, _ = sweep(world, drive, road(replace(STILL, beam_mrad=(1e-3, 1e-3)), **far), stamp)
            cloud, _ = sweep(world, drive, road(noisy, range_noise_m=0.0025, **far), stamp)
            errors.append((ranges(cloud) - ranges(still))[ahead(still)])
        error = np.concatenate(errors)
        amplitude = 0.55 / 0.1 * (55.0 / distance) ** 3
        assert error.std() == pytest.approx(np.hypot(0.0025, 0.02 / amplitude), rel=0.12)
    stepped, _ = sweep(world, drive, road(replace(noisy, range_quantum_m=0.002)))
    steps = ranges(stepped) / 0.002
    assert np.abs(steps - np.round(steps)).max() < 0.01


def test_lasers_have_errors_of_their_own(scenery: Any) -> None:
    """Offset and gain of each ring are those of `laser_errors`, the same in every scan, others by seed."""
    lasers = replace(STILL, laser_offset_m=0.007, laser_gain=2e-4)
    drive = scenery.drive(scenery.straight(), 0.3)
    world = facing(scenery, 31.2, Material.PLASTER, seed=5)
    still, _ = sweep(world, drive, road())
    offset_m, gain = receiver.laser_errors(road(lasers), 5)
    for stamp in (0, 100_000_000):
        cloud, _ = sweep(world, drive, road(lasers), stamp)
        error = ranges(cloud) - ranges(still)
        expected = offset_m[still.ring] + gain[still.ring] * ranges(still)
        assert np.abs(error - expected).max() < 2e-5
    others = np.concatenate([receiver.laser_errors(road(lasers), seed)[0] for seed in range(60)])
    assert others.std() == pytest.approx(0.007, rel=0.05)


def test_weak_echoes_are_lost_behind_strong_ones(scenery: Any) -> None:
    """The first shot past a white wall misses a dark one whose echo is 1/20 as strong; the next finds it."""
    dark = scenery.box([31.2, -60, -60], [32.2, 60, 60], Material.RUBBER)
    bright = scenery.box([11.2, 0, -60], [11.3, 60, 60], Material.PLASTER)
    world, drive = scenery.world([dark, bright]), scenery.drive(scenery.straight(), 0.2)
    controlled = in_grid(sweep(world, drive, road(replace(STILL, power_levels=11)))[0])
    fixed = in_grid(sweep(world, drive, road())[0])
    level = np.arange(13, 18)
    # Clockwise from behind: columns past the middle look to the right, at the dark wall.
    past = 543 - np.argmax((fixed[543 - 9 : 543 + 9] > 20)[::-1], axis=0)
    first = np.argmax(fixed[530:560, level] > 20, axis=0) + 530
    assert past.shape == (32,)
    for ring, column in zip(level, first, strict=True):
        assert np.isnan(controlled[column, ring])
        assert controlled[column + 1, ring] == pytest.approx(fixed[column + 1, ring], abs=1e-4)
        assert np.isfinite(fixed[column - 1 : column + 2, ring]).all()


def test_echoes_too_strong_for_their_power_are_lost(scenery: Any) -> None:
    """The first shot on a sign behind a dark wall has no time, the next has; at the least power all have."""
    dark = scenery.box([31.2, -60, -60], [32.2, 60, 60], Material.RUBBER)
    bright = scenery.box([11.2, -60, -60], [11.3, 0, 60], Material.PLASTER)
    world, drive = scenery.world([dark, bright]), scenery.drive(scenery.straight(), 0.2)
    controlled = in_grid(sweep(world, drive, road(replace(STILL, power_levels=11)))[0])
    patient = in_grid(sweep(world, drive, road(replace(STILL, power_levels=11, overload=1e6)))[0])
    fixed = in_grid(sweep(world, drive, road())[0])
    for ring in range(13, 18):
        # Clockwise from behind: the dark wall lies to the left and comes first.
        first = 530 + int(np.argmax(fixed[530:560, ring] < 20))
        assert np.isnan(controlled[first, ring])
        assert np.isfinite(controlled[first + 1 : first + 4, ring]).all()
        for others in (patient, fixed):
            assert np.isfinite(others[first - 2 : first + 4, ring]).all()


def test_edges_mix_and_planes_do_not(scenery: Any) -> None:
    """On edges alone beams are cast in parts: half a beam on a wall half a metre behind moves the range."""
    near = scenery.box([20.0, 0, -60], [20.3, 60, 60], Material.PLASTER)
    far = scenery.box([20.4, -60, -60], [20.6, 60, 60], Material.PLASTER)
    drive = scenery.drive(scenery.straight(), 0.2)
    mixed, plain = (
        in_grid(sweep(scenery.world([near, far]), drive, road(replace(STILL, edge_rays=rays)))[0])
        for rays in (6, 0)
    )
    changed = np.abs(mixed - plain) > 1e-3
    changed[:400] = changed[680:] = False  # the walls' ends
    assert np.count_nonzero(changed) > 0
    assert np.all(np.abs(np.nonzero(changed)[0] - 542.5) < 2), "only where the near wall ends"
    inside = np.abs(mixed - plain)[changed]
    assert np.all((inside > 0.03) & (inside < 0.5))
    flat = np.full(1085 * 32, np.inf, np.float32)
    azimuth = np.repeat(np.linspace(-np.pi, np.pi, 1085, endpoint=False), 32)
    flat[np.cos(azimuth) > 0.2] = 10.0 / np.cos(azimuth[np.cos(azimuth) > 0.2])
    stone, leaves = (np.full(1085 * 32, kind, np.uint8) for kind in (Material.PLASTER, Material.LEAF))
    edges = beams.on_edges(flat, stone, 1085).reshape(1085, 32)
    assert np.count_nonzero(edges.any(axis=1)) == 4, "the ends of the wall, from both sides"
    assert not beams.on_edges(flat, leaves, 1085).any(), "one crown"


def test_waves_of_the_road_show_in_ranges(scenery: Any) -> None:
    """Ranges shorten by height/cosθ of the waves under the beam; the same place reads the same later."""
    rough = Roughness(3, LevelGrid.uniform(8.0))
    paved = replace(scenery.ground(), material=np.full(4, Material.PAVEMENT, np.uint8))
    world = scenery.world([paved])
    world.roughness = rough.table
    drive = scenery.drive(scenery.straight(), 0.2)
    still, _ = sweep(world, drive, road())
    cloud, _ = sweep(world, drive, road(replace(STILL, relief=True)))
    assert still.ring.tobytes() == cloud.ring.tobytes()
    r = ranges(still)
    near = np.flatnonzero(r < 8.0)
    places = still.points_xyz_m[near].astype(np.float64) + np.array([1.2, 0.0, 1.85])
    height = np.array([rough.height(x, y) for x, y, _ in places])
    moved = (r - ranges(cloud))[near]
    assert np.abs(moved - height * r[near] / 1.85).max() < 1e-4
    assert 0.5e-3 < height.std() < 20e-3


def test_the_own_car_and_its_rack_return(scenery: Any, library: Any) -> None:
    """10–20 % of all returns of the rig's LiDAR on an open road, most at 0.5–1.1 m, all within near_m."""
    world = scenery.world([scenery.ground()], {"ego": library.meshes[library.index("ego")]})
    real = LidarConfig(mount=MOUNT, **LidarConfig.preset_values("hdl32e_road"))
    cloud, labelled = sweep(world, scenery.drive(scenery.straight(5.0), 0.2), real)
    assert labelled.instance is not None
    own = labelled.instance == EGO_INSTANCE
    r = ranges(cloud)
    around = 32 * 1085 * 0.9
    assert 0.1 < np.count_nonzero(own) / around < 0.2
    assert np.mean((r[own] > 0.5) & (r[own] < 1.1)) > 0.7
    assert r[own].max() < real.near_m
    assert r[~own].min() > real.near_m
    bare, _ = sweep(world, scenery.drive(scenery.straight(5.0), 0.2), replace(real, roof_rack=False))
    assert np.count_nonzero(ranges(bare) < real.near_m) < np.count_nonzero(own)


def test_twins_are_equal_and_clouds_share_points(scenery: Any) -> None:
    """Same seed: same bytes, whatever was measured before; both clouds share coordinates; seeds differ."""
    box = scenery.box([12, -3, 0], [13, 3, 3], instance=4)
    real = LidarConfig(mount=MOUNT, **LidarConfig.preset_values("hdl32e_road"))
    drive = scenery.drive(scenery.straight(8.0), 0.4)

    def clouds(seed: int, stamps: list[int]) -> Any:
        return real.build(scenery.world([scenery.ground(), box], seed=seed)).measure(drive, stamps)[-2:]

    one, two, other = (clouds(*of) for of in ((1, [0, 100_000_000]), (1, [100_000_000]), (2, [100_000_000])))
    for name in ("points_xyz_m", "intensity", "ring", "offset_ns"):
        assert getattr(one[0], name).tobytes() == getattr(two[0], name).tobytes()
        assert getattr(one[0], name).tobytes() == getattr(one[1], name).tobytes()
    assert other[0].points_xyz_m.tobytes() != one[0].points_xyz_m.tobytes()


def test_receivers_work_in_weather(scenery: Any) -> None:
    """Under fog the same receiver sees less of the road, in ranges on its steps."""
    world = scenery.world([scenery.ground()])
    drive = scenery.drive(scenery.straight(), 0.2)
    _, clear = sweep(world, drive, road(replace(STILL, range_quantum_m=0.002), weather=True))
    world.weather = PRESETS["FoggyNoon"]
    _, foggy = sweep(world, drive, road(replace(STILL, range_quantum_m=0.002), weather=True))
    seen = [np.count_nonzero(cloud.tag == Tag.ROAD) for cloud in (foggy, clear)]
    assert 0 < seen[0] < 0.9 * seen[1]
    steps = ranges(foggy) / 0.002
    assert np.abs(steps - np.round(steps)).max() < 0.01
    assert np.array_equal(foggy.intensity, np.round(foggy.intensity))


def test_a_scan_casts_fewer_rays_than_the_papers(scenery: Any, town03: Any) -> None:
    """In a street, with the parts of beams on edges, it casts at most as many as the paper's 66 496."""
    stage = SensorStage(town03, seed=1, weather=PRESETS["ClearNoon"])
    rays, cast = stage.rays(), []
    whole = rays.trace

    def counted(beams: Any, *others: Any) -> Any:
        cast.append(len(beams))
        return whole(beams, *others)

    rays.trace = counted  # type: ignore[method-assign]
    real = LidarConfig(mount=MOUNT, **LidarConfig.preset_values("hdl32e_road")).build(stage)
    real.measure(scenery.drive(scenery.straight(), 0.2), [0])
    assert len(cast) == 2
    assert 1085 * 32 * 0.7 < cast[0] < 1085 * 32
    assert 500 < cast[1] < 2078 * 32 - cast[0]
