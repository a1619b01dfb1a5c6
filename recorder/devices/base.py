"""Interface of input devices: they turn the view of a driver into controls, tick by tick."""

from __future__ import annotations

from typing import Protocol

from carlaloc_env.core.ego import Controls
from carlaloc_env.driving.road_ahead import DriverView


class Device(Protocol):
    """An input device: steering wheel, gamepad, keyboard or the scripted driver."""

    @property
    def name(self) -> str:
        """Name of the device, as recorded in the episode."""

    def read(self, view: DriverView) -> Controls:
        """Controls for the coming tick; called once per tick, in order.

        Raises:
            DeviceError: the device is gone or gives no usable value.
        """

    def close(self) -> None:
        """Let the device go; may be called twice."""
