"""GNSS: true place on WGS84, noise of the promised size in metres."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from carlaloc_env.errors import ConfigError
from carlaloc_env.geodesy import GeoReference
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.gnss import GnssConfig

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


def test_negative_noise_is_refused() -> None:
    with pytest.raises(ConfigError, match="noise_enu_m"):
        GnssConfig(noise_enu_m=(1.0, -1.0, 1.0))
