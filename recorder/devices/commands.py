"""Commands of a driver besides steering and pedals."""

from __future__ import annotations

from enum import Enum

from carlaloc_env.core.errors import ConfigError, unknown_name


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
