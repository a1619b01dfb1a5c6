"""How well scans along the routes of the towns hold the car."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import carlaloc_env
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensors.lidar.config import LidarConfig
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from recorder.slam.localizability import longest_below
from recorder.slam.route_localizability import RouteLocalizability, route_localizability

pytest.importorskip("open3d", reason="Open3D casts the rays of the LiDAR")
LIDAR = next(c for c in rig_by_name("paper").sensors if isinstance(c, LidarConfig))
LONGEST_M = 100.0


@functools.cache
def curve(name: str) -> RouteLocalizability:
    return route_localizability(load_town(name), LIDAR)


def test_streets_hold_the_car_and_leaves_hold_nothing(town03: Town) -> None:
    found = route_localizability(town03, LIDAR, step_m=240.0)
    assert len(found.station_m) == int(np.ceil(town03.route.length_m / 240.0))  # type: ignore[union-attr]
    assert (found.least < 1.0 / 3.0).all()
    assert (found.firm > 0.01).all()
    assert (found.firm <= found.least + 1e-12).all()
    assert (found.along <= 1.0 + 1e-9).all()


@pytest.mark.soak
@pytest.mark.parametrize("name", carlaloc_env.TOWNS)
def test_no_stretch_of_a_hundred_metres_lets_the_car_slip(name: str) -> None:
    """A tenth of Town03's median is the least, with returns from leaves for nothing."""
    limit = 0.1 * float(np.median(curve("Town03").firm))
    length, begin = longest_below(curve(name).station_m, curve(name).firm, limit)
    assert length <= LONGEST_M, f"{length:.0f} m from {begin:.0f} m on"
