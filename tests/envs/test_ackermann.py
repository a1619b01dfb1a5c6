"""Actions of the kind `ackermann`: the car comes to the curvature and the speed that are asked for."""

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import MakeEnv

from carlaloc_env.core.ego import Controls
from carlaloc_env.envs.task.ackermann import LATERAL_MPS2, SHARPEST_PER_M, Motion
from carlaloc_env.envs.task.actions import action_kind
from carlaloc_env.physics.params import VehicleParams


@pytest.mark.parametrize("speed_mps", [0.0, 3.0, 20.0])
def test_the_wheel_is_that_of_the_single_track_model(speed_mps: float) -> None:
    """A curvature is the tangent of the wheel's angle over the wheelbase; it keeps v² times it at 3 m/s²."""
    p, motion = VehicleParams(), Motion(speed_mps=speed_mps, speed_limit_mps=10.0)
    controls = action_kind("ackermann").controls([0.5, 0.0], motion)
    curvature = np.tan(controls.steer * p.steer_max_rad) / p.wheelbase_m
    assert curvature == pytest.approx(0.5 * min(SHARPEST_PER_M, LATERAL_MPS2 / max(speed_mps**2, 1.0)))


def test_a_standing_car_is_held() -> None:
    assert action_kind("ackermann").controls([0.0, -1.0], Motion(speed_limit_mps=10.0)) == Controls(brake=0.3)


def test_the_car_comes_to_speed_curvature_and_rest(make_env: MakeEnv) -> None:
    env = make_env(action="ackermann", info=("ego",))
    env.reset(seed=1)
    for _ in range(160):
        *_, info = env.step([0.0, 0.2])
    limit_mps = float(env.world.route.speed_limit_mps[0])
    assert info["ego"].speed_mps == pytest.approx(0.6 * limit_mps, rel=0.03)
    for _ in range(12):
        *_, info = env.step([0.3, 0.2])
    speed_mps = info["ego"].speed_mps
    assert info["ego"].omega_body_radps[2] / speed_mps == pytest.approx(
        0.3 * min(SHARPEST_PER_M, LATERAL_MPS2 / speed_mps**2), rel=0.15
    )
    for _ in range(80):
        *_, info = env.step([0.0, -1.0])
    assert info["ego"].speed_mps == pytest.approx(0.0, abs=0.02)
