"""Keys for a drive without a person at the wheel: pause, camera, help, end."""

from __future__ import annotations

from recorder.devices.commands import Command
from recorder.devices.inputs import Inputs
from recorder.devices.keys import KEY_COMMANDS

_STEERING = (Command.REVERSE, Command.HANDBRAKE, Command.RESTART, Command.CHECKPOINT)


class KeyPanel:
    """Takes in key presses; what only a driver may ask for is left out.

    Args:
        inputs: Where events come from.
    """

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        self.commands: list[Command] = []
        self.plugged: list[tuple[str, str]] = []
        self.message: str | None = None
        self.buttons: dict[str, int] = {}

    def poll(self) -> None:
        """Take in events; once per image."""
        self.inputs.pump()
        pressed = (KEY_COMMANDS.get(press.key) for press in self.inputs.presses if press.key is not None)
        self.commands = [c for c in pressed if c is not None and c not in _STEERING]

    def close(self) -> None:
        """Let the keyboard go."""
        self.inputs.close()
