"""Input devices by name."""

from __future__ import annotations

from carlaloc_env.core.errors import DeviceError, unknown_name
from recorder.devices.base import Device
from recorder.devices.human import HumanDevice
from recorder.devices.inputs import Inputs
from recorder.devices.profile import known_profiles
from recorder.devices.scripted.driver import ScriptedDriver

HUMAN = ("wheel", "gamepad", "keyboard")
"""Devices that a person holds."""
DEVICES = ("scripted", *HUMAN)
"""Names of all devices."""


def open_device(name: str, seed: int, *, window: bool = False) -> Device:
    """Device of a name.

    Args:
        name: Its name, e.g. ``scripted``.
        seed: Seed for devices that are driven by the program.
        window: Whether a window will be opened; keys reach the program through it only.

    Raises:
        DeviceError: there is no such device, or it is not connected.
        ConfigError: a profile of the user's is not valid.
        MissingDependencyError: pygame is not installed.
    """
    if name not in DEVICES:
        raise DeviceError(unknown_name("device", name, DEVICES))
    if name == "scripted":
        return ScriptedDriver(seed)
    if name == "keyboard" and not window:
        raise DeviceError("keys reach the program through its window only; leave out --no-window")
    inputs = Inputs(window=window)
    try:
        return HumanDevice(name, inputs, known_profiles())
    except Exception:
        inputs.close()
        raise
