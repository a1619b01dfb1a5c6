"""Tight bends to both sides, one after the other: the scripted driver slows down between them."""

import numpy as np
from shared_fixtures.drives.driver_runs import route_of

from recorder.devices.scripted.route_profile import DriverRoute


def speed_mps(second: float) -> float:
    """Least speed over two bends of 9 m radius, the first to the left [m/s]."""
    route = DriverRoute(
        route_of([(40.0, 0.0), (11.0, 1 / 9.0), (11.0, second / 9.0), (40.0, 0.0)], 13.9), 0.97
    )
    return float(route.speeds_ahead(0.0, 100.0, 0.5)[1].min())


def test_double_bends_are_driven_slowly() -> None:
    """At 1.3 m/s² on an arc of 9 m that is 3.4 m/s; a single bend is driven at 2.4 m/s², 4.65 m/s."""
    assert abs(speed_mps(1.0) - np.sqrt(2.4 * 9.0)) < 0.1
    assert abs(speed_mps(-1.0) - np.sqrt(1.3 * 9.0)) < 0.3
