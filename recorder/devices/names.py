"""Names of input devices; imports next to nothing, so that a command can judge them before it loads more."""

from __future__ import annotations

from carlaloc_env.core.errors import DeviceError

HUMAN = ("wheel", "gamepad", "keyboard")
"""Devices that a person holds."""
DEVICES = ("scripted", *HUMAN)
"""Names of all devices."""


def wants_window(device: str, window: bool | None) -> bool:
    """Whether a window shows the drive: as asked for, else where a person drives.

    Raises:
        DeviceError: a person would drive without seeing the road.
    """
    wanted = device in HUMAN if window is None else window
    if device in HUMAN and not wanted:
        raise DeviceError(f"driving by {device} needs the window; leave out --no-window")
    return wanted
