"""GNSS: true place on WGS84, noise of the promised size in metres."""

from typing import Any

import numpy as np
import pyproj
import pytest
from scipy.stats import chi2

from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.core.map_projection import projected_reference
from carlaloc_env.envs.observer import values_of
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.gnss_satellites import CONSTELLATIONS, dilution

STEP = 200_000_000


def enu(world: Any, fixes: list[Any]) -> np.ndarray:
    geodetic = [[f.latitude_deg, f.longitude_deg, f.altitude_m] for f in fixes]
    return world.geo.geodetic_to_enu(geodetic)


def test_noise_free_fix_is_the_antenna(scenery: Any) -> None:
    """Lever arm included: the antenna's place, not the axle's, to a micrometre."""
    world = scenery.world()
    drive = scenery.drive(scenery.weaving, 4.0)
    mount = Mount(position_m=(0.7, 0.1, 1.5))
    stamps = list(range(0, 4_000_000_000, STEP))
    fixes = GnssConfig(mount=mount, noise_enu_m=(0, 0, 0)).build(world).measure(drive, stamps)
    truth = drive.ego_motion(stamps).at_mount(mount.T_base_sensor).position_m
    assert np.abs(enu(world, fixes) - truth).max() < 1e-6


def test_noise_by_chi_square(scenery: Any) -> None:
    """Σ(e/σ)² of 3 m, 3 m, 5 m lies within the 0.1–99.9 % band of χ²; axes and fixes are independent."""
    world = scenery.world(seed=5)
    seconds = 400.0
    drive = scenery.drive(scenery.straight(0.0), seconds)
    fixes = GnssConfig().build(world).measure(drive, list(range(0, int(seconds * 1e9), STEP)))
    e = enu(world, fixes)
    for axis, sigma in enumerate((3.0, 3.0, 5.0)):
        assert chi2.ppf(0.001, len(e)) < np.sum((e[:, axis] / sigma) ** 2) < chi2.ppf(0.999, len(e))
        assert abs(np.corrcoef(e[1:, axis], e[:-1, axis])[0, 1]) < 4 / np.sqrt(len(e))
    assert np.abs(np.corrcoef(e.T) - np.eye(3)).max() < 4 / np.sqrt(len(e))
    assert np.array_equal(fixes[0].covariance_enu_m2, np.diag([9.0, 9.0, 25.0]))


def test_noise_is_in_metres_at_every_latitude(scenery: Any) -> None:
    """The same draw moves the fix by the same metres in Oslo and on the equator; degrees would not."""
    drive = scenery.drive(scenery.straight(0.0), 1.0)
    moved = []
    for latitude in (0.0, 60.0):
        world = scenery.world(seed=2)
        world.geo = GeoReference(latitude_deg=latitude, longitude_deg=10.0)
        moved.append(enu(world, GnssConfig().build(world).measure(drive, [STEP])))
    assert np.allclose(moved[0], moved[1], atol=1e-6)
    assert np.abs(moved[0]).max() > 0.1


def test_projected_worlds_give_the_projection_and_covariances_about_true_north(scenery: Any) -> None:
    """UTM in Munich: heights are kept, and the grid's axes are 1.9° off those of the covariance."""
    world = scenery.world()
    world.geo = projected_reference("EPSG:32632", 691_000.0, 5_336_000.0, height_m=519.0)
    drive = scenery.drive(scenery.straight(5.0), 1.0)
    config = GnssConfig(noise_enu_m=(1e-9, 2e-9, 3e-9), mount=Mount())
    (fix,) = config.build(world).measure(drive, [STEP])
    x, y, z = drive.ego_motion([STEP]).position_m[0]
    grid = pyproj.Transformer.from_crs(4326, 32632, always_xy=True)
    back = grid.transform(fix.longitude_deg, fix.latitude_deg)
    assert back == pytest.approx((691_000.0 + x, 5_336_000.0 + y), abs=1e-5)
    assert fix.altitude_m == pytest.approx(519.0 + z, abs=1e-7)
    angle = world.geo.azimuth_rad
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(fix.covariance_enu_m2, R @ np.diag([1.0, 4.0, 9.0]) @ R.T * 1e-18, atol=1e-26)


def canyon(scenery: Any, height: float = 25.0, half_width: float = 8.0) -> list[Any]:
    """Two rows of houses along a street that runs east."""
    return [
        scenery.ground(),
        scenery.box([-400, half_width, 0], [400, half_width + 12, height]),
        scenery.box([-400, -half_width - 12, 0], [400, -half_width, height]),
    ]


def receiver(world: Any, preset: str = "realistic", **changes: Any) -> Any:
    values = {**GnssConfig.preset_values(preset), "mount": Mount(position_m=(0.7, 0, 1.5)), **changes}
    return GnssConfig(**values).build(world)


@pytest.mark.parametrize(("name", "hours"), [("galileo", 14.0791), ("beidou", 12.887), ("glonass", 11.263)])
def test_orbits_are_the_published_ones(name: str, hours: float) -> None:
    """Period after Kepler; after one of them the satellites stand as before, the Earth having turned."""
    walker = CONSTELLATIONS[name]
    period = 2 * np.pi * np.sqrt(walker.radius_m**3 / 3.986004418e14)
    assert period / 3600 == pytest.approx(hours, abs=0.01)
    begin, end = walker.ecef_m(0.0), walker.ecef_m(period)
    turn = -7.2921151467e-5 * period
    c, s = np.cos(turn), np.sin(turn)
    back = begin @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    assert np.abs(end - back).max() < 1.0
    assert np.linalg.norm(begin, axis=-1) == pytest.approx(walker.radius_m)
    assert np.degrees(np.arcsin(np.abs(walker.ecef_m(3e3)[:, 2]) / walker.radius_m)).max() <= (
        walker.inclination_deg + 1e-9
    )


def test_satellites_in_view_under_open_sky(scenery: Any) -> None:
    """Of 72 satellites 18 to 33 stand above 7° at 49° N, at any time of the day; none in the polar hole."""
    world = scenery.world([scenery.ground()])
    drive = scenery.drive(scenery.straight(), 0.3)
    for hour in range(24):
        sensor = receiver(world, epoch_s=3600.0 * hour)
        directions, factor, hidden = sensor.sky(drive, 0, np.array([0.0, 0.0, 1.5]))
        assert 18 <= np.count_nonzero(np.isfinite(factor)) <= 33
        assert hidden == 0.0
        seen = directions[np.isfinite(factor)]
        assert np.degrees(np.arcsin(seen[:, 2].min())) > 7.0


def test_canyon_hides_the_sky_as_its_profile_says(scenery: Any) -> None:
    """Walls 23.5 m above the antenna, 8 m away: a ray at azimuth φ passes above atan(23.5·|sin φ|/8)."""
    world = scenery.world(canyon(scenery))
    drive = scenery.drive(scenery.straight(), 0.3)
    place = np.array([0.0, 0.0, 1.5])
    directions, factor, hidden = receiver(world).sky(drive, 0, place)
    above = directions[:, 2] > np.sin(np.radians(7.0))
    blocked = 23.5 * np.abs(directions[:, 1]) > 8.0 * directions[:, 2]
    assert np.array_equal(np.isfinite(factor), above & ~blocked)
    # Open share: mean over azimuth of 1 − sin of the profile's elevation, over that of the mask.
    phi = np.linspace(0, 2 * np.pi, 20_001)
    low = np.maximum(np.sin(np.arctan(23.5 * np.abs(np.sin(phi)) / 8)), np.sin(np.radians(7)))
    expected = 1 - np.mean(1 - low) / (1 - np.sin(np.radians(7)))
    assert hidden == pytest.approx(expected, abs=0.06)


def errors_of(fixes: list[Any], world: Any, truth: np.ndarray) -> np.ndarray:
    return enu(world, fixes) - truth


@pytest.mark.parametrize("preset", ["realistic", "rtk"])
@pytest.mark.parametrize("street", [False, True])
def test_covariance_tells_the_truth(scenery: Any, preset: str, street: bool) -> None:
    """eᵀC⁻¹e of one fix of each of 300 seeds lies within the 0.1–99.9 % band of χ² with 3·300 degrees."""
    static = canyon(scenery, height=12.0) if street else [scenery.ground()]
    world = scenery.world(static)
    drive = scenery.drive(scenery.straight(), 2.3)
    truth = np.array([0.7, 0.0, 1.5])
    total = 0.0
    for seed in range(300):
        world.seed = seed
        (fix,) = receiver(world, preset).measure(drive, [10 * STEP])
        e = errors_of([fix], world, truth)[0]
        total += float(e @ np.linalg.solve(fix.covariance_enu_m2, e))
    assert chi2.ppf(0.001, 900) < total < chi2.ppf(0.999, 900)


def test_errors_grow_and_correlate_between_walls(scenery: Any) -> None:
    """In the canyon across the street worst; multipath keeps its value for tens of seconds."""
    drive = scenery.drive(scenery.straight(), 600.3)
    stamps = list(range(0, 600_000_000_000, 5 * STEP))
    spread = {}
    for name, static in (("open", [scenery.ground()]), ("canyon", canyon(scenery, height=15.0))):
        world = scenery.world(static, seed=3)
        fixes = receiver(world).measure(drive, stamps)
        assert all(fix.has_fix for fix in fixes)
        e = errors_of(fixes, world, np.array([0.7, 0.0, 1.5]))
        spread[name] = e.std(axis=0)
        whitened = e - e.mean(axis=0)
        lag = np.sum(whitened[1:] * whitened[:-1]) / np.sum(whitened**2)
        # White noise alone would give 0 ± 0.04; the ranges' own white part keeps it below 1.
        assert lag > {"open": 0.3, "canyon": 0.6}[name], "a second later the error is much the same"
    assert spread["canyon"][1] > 2.5 * spread["open"][1], "walls north and south spoil the north"
    assert spread["open"].max() < 3.0


def test_tunnels_have_no_fix(scenery: Any) -> None:
    """Below a roof from x = 20 m on: no fix, NaN, status −1, and zeros in the observation."""
    roof = scenery.box([20, -30, 6], [200, 30, 7])
    sides = [scenery.box([20, y, 0], [200, y + 1, 6]) for y in (-6, 5)]
    world = scenery.world([scenery.ground(), roof, *sides])
    drive = scenery.drive(scenery.straight(20.0), 5.3)
    fixes = receiver(world, "rtk").measure(drive, list(range(0, 5_000_000_000, STEP)))
    state = [fix.solution for fix in fixes]
    assert state[0] == "fixed"
    inside = [k for k, fix in enumerate(fixes) if 0.2 * k * 20 + 0.7 > 40]
    assert {state[k] for k in inside} == {"none"}
    lost = fixes[inside[0]]
    assert not lost.has_fix
    assert np.isnan(lost.latitude_deg)
    assert values_of(lost).tolist() == [0.0, 0.0, 0.0, 0.0]


def test_bad_geometry_gives_no_fix(scenery: Any) -> None:
    """PDOP of a regular tetrahedron of directions is 1.5; of satellites in one plane it is infinite."""
    s = 1 / np.sqrt(3)
    tetrahedron = np.array([[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]])
    assert dilution(tetrahedron) == pytest.approx(1.5)
    row = np.array([[0, np.sin(a), np.cos(a)] for a in (-0.5, -0.1, 0.2, 0.7)])
    assert dilution(row) > 1e3
    world = scenery.world(canyon(scenery, height=40.0, half_width=9.0))
    drive = scenery.drive(scenery.straight(), 0.3)
    lost = 0
    for hour in range(24):
        (fix,) = receiver(world, epoch_s=3600.0 * hour).measure(drive, [0])
        lost += not fix.has_fix
        if fix.has_fix:
            assert np.sqrt(np.trace(fix.covariance_enu_m2)) < 12.0 * 40.0
    assert 0 < lost < 24


def test_rtk_is_centimetres_in_the_open_and_decimetres_when_floating(scenery: Any) -> None:
    drive = scenery.drive(scenery.straight(), 40.3)
    stamps = list(range(0, 40_000_000_000, STEP))
    world = scenery.world([scenery.ground()])
    fixes = receiver(world, "rtk").measure(drive, stamps)
    assert {fix.solution for fix in fixes} == {"fixed"}
    assert errors_of(fixes, world, np.array([0.7, 0, 1.5])).std(axis=0).max() < 0.03
    world = scenery.world(canyon(scenery, height=20.0))
    floating = receiver(world, "rtk").measure(drive, stamps)
    assert "fixed" not in {fix.solution for fix in floating}
