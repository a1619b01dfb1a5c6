"""The scripted driver as an agent: one action of 50 ms for a view, though its hands move every 5 ms."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from carlaloc_env.driving.driver_view import DriverView
from recorder.devices.scripted.driver import ScriptedDriver


class StepDriver:
    """Gives actions of the kind ``controls``: means over the ticks of a step, while the car rolls on.

    Args:
        seed: Seed of the driver.
    """

    def __init__(self, seed: int) -> None:
        self._driver = ScriptedDriver(seed)

    def act(self, view: DriverView) -> NDArray[np.float32]:
        """Steering, throttle, brake, reverse and handbrake for the coming step, shape (5,)."""
        along = view.speed_mps * np.array([np.cos(view.heading_rad), np.sin(view.heading_rad), 0.0])
        taken = []
        for tick in range(STEP_TICKS):
            position_m = view.position_m + tick * TICK_S * along
            c = self._driver.read(replace(view, tick=view.tick + tick, position_m=position_m))
            taken.append((c.steer, c.throttle, c.brake, 0.0, float(c.handbrake)))
        action: NDArray[np.float32] = np.mean(taken, axis=0).astype(np.float32)
        return action
