"""Input devices: their interface, their names, and the commands that a driver can give.

It imports next to nothing, so that a command can judge names before it loads more.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Protocol

from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import ConfigError, DeviceError, unknown_name

if TYPE_CHECKING:
    from carlaloc_env.driving.driver_view import DriverView


HUMAN = ("wheel", "gamepad", "keyboard")
"""Devices that a person holds."""
DEVICES = ("scripted", "hand", *HUMAN)
"""Names of all devices."""
POLICY_SUFFIX = ".py"
"""Suffix of files that drive (`recorder.devices.policy`)."""


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


def check_device(name: str) -> None:
    """Refuse a name that is neither a device's nor that of a file that drives.

    Raises:
        DeviceError: it is none.
    """
    if name not in DEVICES and not name.endswith(POLICY_SUFFIX):
        raise DeviceError(unknown_name("device", name, DEVICES) + ", or a .py file that drives")


def wants_window(device: str, window: bool | None) -> bool:
    """Whether a window shows the drive: as asked for, else where a person drives.

    Raises:
        DeviceError: a person would drive without seeing the road.
    """
    wanted = device in HUMAN if window is None else window
    if device in HUMAN and not wanted:
        raise DeviceError(f"driving by {device} needs the window; leave out --no-window")
    return wanted


class Command(Enum):
    """One press of a key or button."""

    REVERSE = "reverse"
    """Change between forward and reverse; heeded below walking speed."""
    HANDBRAKE = "handbrake"
    """Pulled while held."""
    THROTTLE = "throttle"
    """Pressed while held, on pads without analogue triggers."""
    BRAKE = "brake"
    """Likewise."""
    INDICATOR_LEFT = "indicator_left"
    INDICATOR_RIGHT = "indicator_right"
    HEADLAMPS = "headlamps"
    CAMERA = "camera"
    """Next view: driver's seat, chase, above."""
    PAUSE = "pause"
    PHOTO = "photo"
    """Write the picture to a PNG beside the episode."""
    CHECKPOINT = "checkpoint"
    """Set a checkpoint here."""
    RESTART = "restart"
    """Go back to the last checkpoint."""
    HELP = "help"
    QUIT = "quit"

    @classmethod
    def by_name(cls, name: str) -> Command:
        """Command of a name.

        Raises:
            ConfigError: there is no such command.
        """
        try:
            return cls(name)
        except ValueError:
            raise ConfigError(unknown_name("command", str(name), [c.value for c in cls])) from None
