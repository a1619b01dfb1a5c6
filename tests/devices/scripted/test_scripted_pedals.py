"""The driver's model of the car against the car."""

import numpy as np
import pytest

from carlaloc_env.core.ego import Controls
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.params import VehicleParams
from carlaloc_env.physics.world import PhysicsWorld
from recorder.devices.scripted.pedals import DriverPedals


def test_pedals_give_the_acceleration_asked_for() -> None:
    """The foot's model of the car agrees with the car: 1 m/s² asked, 1 m/s² measured."""
    corners = np.array([[-50.0, -50, 0], [600, -50, 0], [600, 50, 0], [-50, 50, 0]])
    with PhysicsWorld(corners, np.array([[0, 1, 2], [0, 2, 3]])) as world:
        car = EgoCar(world)
        state = car.reset((0.0, 0.0, 0.0), 0.0)
        pedals = DriverPedals(VehicleParams())
        measured = []
        for tick in range(1600):
            wanted = 1.0 if tick < 1000 else -1.2
            throttle, brake = pedals.drive(
                wanted, 0.0, speed_mps=state.speed_mps, perceived_mps2=state.acceleration_mps2, grade=0.0
            )
            car.tick(Controls(throttle=throttle, brake=brake))
            state = car.state()
            measured.append(state.acceleration_mps2)
        assert np.mean(measured[600:1000]) == pytest.approx(1.0, abs=0.06)
        assert np.mean(measured[1300:1500]) == pytest.approx(-1.2, abs=0.08)
