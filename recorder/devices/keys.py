"""Keys of the keyboard: arrows or WASD drive, others give commands. Codes are SDL's, which are fixed."""

from recorder.devices.base import Command
from recorder.devices.inputs import Inputs

_ARROW_RIGHT, _ARROW_LEFT, _ARROW_DOWN, _ARROW_UP = (0x4000_0000 | code for code in (79, 80, 81, 82))
_F1 = 0x4000_0000 | 58
_ESCAPE, _SPACE, _BACKSPACE = 27, 32, 8

LEFT, RIGHT = (_ARROW_LEFT, ord("a")), (_ARROW_RIGHT, ord("d"))
FORWARD, BACK = (_ARROW_UP, ord("w")), (_ARROW_DOWN, ord("s"))

KEY_COMMANDS = {
    ord("r"): Command.REVERSE,
    _SPACE: Command.HANDBRAKE,
    ord("q"): Command.INDICATOR_LEFT,
    ord("e"): Command.INDICATOR_RIGHT,
    ord("l"): Command.HEADLAMPS,
    ord("c"): Command.CAMERA,
    ord("p"): Command.PAUSE,
    ord("f"): Command.PHOTO,
    ord("k"): Command.CHECKPOINT,
    _BACKSPACE: Command.RESTART,
    ord("h"): Command.HELP,
    _F1: Command.HELP,
    _ESCAPE: Command.QUIT,
}
"""Command of each key."""

HELP_LINES = (
    ("arrows / W A S D", "steer, accelerate, brake", ()),
    ("space", "handbrake", ("handbrake",)),
    ("R", "reverse gear (below walking speed)", ("reverse",)),
    ("Q  E", "indicators", ("indicator_left", "indicator_right")),
    ("L", "headlamps", ("headlamps",)),
    ("C", "camera: seat, chase, above", ("camera",)),
    ("P", "pause", ("pause",)),
    ("K", "set a checkpoint", ("checkpoint",)),
    ("backspace", "restart from the last checkpoint", ("restart",)),
    ("F", "photo: a PNG beside the drive", ("photo",)),
    ("H / F1", "this help", ("help",)),
    ("Esc", "end the drive and save it", ("quit",)),
)
"""Lines of the help overlay: keys, their meaning, and the commands whose buttons it adds."""
_STEERING = (Command.REVERSE, Command.HANDBRAKE, Command.RESTART, Command.CHECKPOINT)


def held_pedals(keys: set[int]) -> tuple[bool, bool, bool, bool, bool]:
    """Whether left, right, forward, back and handbrake are held."""
    held = tuple(any(key in keys for key in codes) for codes in (LEFT, RIGHT, FORWARD, BACK, (_SPACE,)))
    return held[0], held[1], held[2], held[3], held[4]


class KeyPanel:
    """Reads commands from the keyboard, without those that only a driver gives.

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
