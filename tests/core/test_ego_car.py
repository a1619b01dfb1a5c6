"""The ego's dimensions have one owner, and agree with what its physics and its mesh make of them."""

import pytest

from carlaloc_env.core import ego
from carlaloc_env.physics.params import VehicleParams


def test_rolling_radius_lies_below_the_loaded_radius() -> None:
    """Loaded radius: unloaded less load over stiffness; a wheel rolls within 1 % of it, never above."""
    car = VehicleParams()
    for load_n in car.static_load_n:
        loaded_m = car.wheel_radius_m - load_n / car.tyre_npm
        assert 0.0 < loaded_m - ego.EGO_ROLLING_RADIUS_M < 0.012 * loaded_m


def test_axles_and_tyres_fit_into_the_body() -> None:
    """Both axles lie between the bumpers, and tyres end inside the body's sides."""
    assert ego.EGO_REAR_M < 0.0 < ego.EGO_WHEELBASE_M < ego.EGO_FRONT_M
    length_m = ego.EGO_FRONT_M - ego.EGO_REAR_M
    assert length_m == pytest.approx(ego.EGO_SIZE_M[0])
    assert 0.5 * ego.EGO_TRACK_M < ego.EGO_TYRE_OUTER_M < 0.5 * ego.EGO_SIZE_M[1]
