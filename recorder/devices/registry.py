"""Input devices by name."""

from __future__ import annotations

from collections.abc import Callable

from carlaloc_env.errors import DeviceError, unknown_name
from recorder.devices.base import Device
from recorder.devices.scripted import ScriptedDriver

DEVICES: dict[str, Callable[[int], Device]] = {"scripted": ScriptedDriver}
"""Makers of devices, each from the seed of the drive."""


def open_device(name: str, seed: int) -> Device:
    """Device of a name.

    Args:
        name: Its name, e.g. ``scripted``.
        seed: Seed for devices that are driven by the program.

    Raises:
        DeviceError: there is no such device.
    """
    maker = DEVICES.get(name)
    if maker is None:
        raise DeviceError(unknown_name("device", name, DEVICES))
    return maker(seed)
