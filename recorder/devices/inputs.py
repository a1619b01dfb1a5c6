"""Reads keys, wheels, pedals and pads from pygame's event queue."""

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from carlaloc_env.core.errors import DeviceError, MissingDependencyError

_SCAN_A, _PLACES = 4, "abcdefghijklmnopqrstuvwxyz1234567890"
"""SDL's code of the place of A, and the keys of a US keyboard from there on."""
_STIRRED, _MOVED = 0.02, 0.2
"""Changes of a raw value: after which it is believed, and by which a person moves it."""
_MIDDLE = 0.1
"""Greatest raw value of an axis that stands in its middle, such as a stick or a motion sensor at rest."""


@dataclass(slots=True, eq=False)
class Stick:
    """One joystick: a wheel, a set of pedals or a pad.

    SDL reports 0 for an axis that has not moved yet, which on a pedal is half pressed. An axis
    therefore counts as unknown until its value has changed or an event has named it. Drivers that take an
    axis for a trigger report an end of it at first; an axis that leaps from there to the middle never was at
    that end.
    """

    instance: int
    """SDL instance id; never used twice while the program runs."""
    name: str
    """What the device calls itself."""
    usb: str
    """``vendor:product``, lower-case hexadecimal."""
    handle: Any
    """pygame joystick; its events stop when it is let go."""
    raw: list[float] = field(default_factory=list)
    """Last value of every axis, −1…1."""
    trusted: list[bool] = field(default_factory=list)
    """Whether the value of an axis can be believed."""
    buttons: set[int] = field(default_factory=set)
    """Buttons held down."""
    seen: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Least and greatest value of every axis that has moved."""

    def follow(self, number: int, value: float) -> None:
        """Store the new value of an axis."""
        before, was_trusted = self.raw[number], self.trusted[number]
        self.raw[number] = value
        self.trusted[number] |= abs(value - before) > _STIRRED
        if self.trusted[number]:
            first = before if was_trusted else value
            low, high = self.seen.get(number, (first, first))
            if high - low < _STIRRED and abs(before) > 1.0 - _STIRRED and abs(value) < _MIDDLE:
                low = high = value
            self.seen[number] = min(low, value), max(high, value)

    def was_moved(self, number: int) -> bool:
        """Whether a person has moved an axis."""
        low, high = self.seen.get(number, (0.0, 0.0))
        return high - low > _MOVED

    def was_near(self, number: int, value: float, within: float) -> bool:
        """Whether an axis was seen near a value, or on both sides of it."""
        low, high = self.seen.get(number, (math.inf, -math.inf))
        return low - within <= value <= high + within

    def axis(self, number: int) -> float | None:
        """Raw value of an axis, None while it is unknown or where there is no such axis."""
        if number >= len(self.raw) or not self.trusted[number]:
            return None
        return self.raw[number]


@dataclass(frozen=True, slots=True, kw_only=True)
class Press:
    """Press of a key or button."""

    key: int | None = None
    """pygame key code by place, None for a button."""
    stick: Stick | None = None
    """Whose button, None for a key."""
    button: int = -1
    """Number of the button."""
    hat: tuple[int, int] = (0, 0)
    """Direction of a D-pad (right, up), −1…1; (0, 0) for others."""


def import_pygame(needed_by: str) -> Any:
    """Import pygame, so that it prints nothing and leaves OpenGL alone.

    Args:
        needed_by: What needs it, for an error.

    Raises:
        MissingDependencyError: it is not installed.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    # SDL would show images through an OpenGL context of its own, which breaks the renderer's.
    os.environ.setdefault("SDL_FRAMEBUFFER_ACCELERATION", "0")
    try:
        import pygame
    except ImportError as error:
        raise MissingDependencyError(f"{needed_by} pygame ({error}); pip install pygame-ce") from error
    return pygame


class Inputs:
    """Event queue of pygame; `pump` once per image."""

    def __init__(self, *, window: bool) -> None:
        """Start pygame's input.

        Args:
            window: Whether a window will be opened; without one no display is needed, but keys do
                not reach the program.

        Raises:
            MissingDependencyError: pygame is not installed.
            DeviceError: SDL cannot start what ``SDL_VIDEODRIVER`` names.
        """
        os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
        if not window:
            os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
        self._pygame = pygame = import_pygame("input devices need")
        try:
            pygame.display.init()
            pygame.joystick.init()
        except pygame.error as error:
            raise DeviceError(
                f"SDL does not start ({error}); unset SDL_VIDEODRIVER, or correct it"
            ) from error
        self.sticks: dict[int, Stick] = {}
        self.keys: set[int] = set()
        self.presses: list[Press] = []
        self.lost: list[Stick] = []
        self.gained: list[Stick] = []
        self.closed = False
        for index in range(pygame.joystick.get_count()):
            self._add(index)

    def pump(self) -> None:
        """Take in what has happened; presses, losses and gains are those since the last call."""
        pygame = self._pygame
        self.presses, self.lost, self.gained = [], [], []
        for event in pygame.event.get():
            if event.type == pygame.QUIT:
                self.closed = True
            elif event.type == pygame.KEYDOWN:
                self.keys.add(key_at_place(event))
                self.presses.append(Press(key=key_at_place(event)))
            elif event.type == pygame.KEYUP:
                self.keys.discard(key_at_place(event))
            elif event.type == pygame.WINDOWFOCUSLOST:
                self.keys.clear()
            elif event.type == pygame.JOYDEVICEADDED:
                self._add(event.device_index)
            elif event.type == pygame.JOYDEVICEREMOVED:
                self._remove(event.instance_id)
            else:
                self._follow(event)

    def close(self) -> None:
        """Let all devices go; may be called twice."""
        for stick in self.sticks.values():
            stick.handle.quit()
        self.sticks.clear()
        if self._pygame.joystick.get_init():
            self._pygame.joystick.quit()

    def __iter__(self) -> Iterator[Stick]:
        return iter(self.sticks.values())

    def _follow(self, event: Any) -> None:
        pygame = self._pygame
        axis, hat = pygame.JOYAXISMOTION, pygame.JOYHATMOTION
        if event.type not in (axis, hat, pygame.JOYBUTTONDOWN, pygame.JOYBUTTONUP):
            return
        stick = self.sticks.get(event.instance_id)
        if stick is None:
            return
        if event.type == pygame.JOYBUTTONDOWN:
            stick.buttons.add(event.button)
            self.presses.append(Press(stick=stick, button=event.button))
        elif event.type == pygame.JOYBUTTONUP:
            stick.buttons.discard(event.button)
        elif event.type == hat:
            self.presses.append(Press(stick=stick, hat=event.value))
        elif event.axis < len(stick.raw):
            stick.follow(event.axis, float(event.value))

    def _add(self, index: int) -> None:
        try:
            handle = self._pygame.joystick.Joystick(index)
            if handle.get_instance_id() in self.sticks:
                return
            raw = [float(handle.get_axis(k)) for k in range(handle.get_numaxes())]
            stick = Stick(
                instance=handle.get_instance_id(),
                name=handle.get_name(),
                usb=usb_of_guid(handle.get_guid()),
                handle=handle,
                raw=raw,
                trusted=[abs(value) > _STIRRED for value in raw],
            )
        except self._pygame.error:
            # It was pulled out between its event and now; the event of that is on its way.
            return
        self.sticks[stick.instance] = stick
        self.gained.append(stick)

    def _remove(self, instance: int) -> None:
        stick = self.sticks.pop(instance, None)
        if stick is not None:
            self.lost.append(stick)


def key_at_place(event: Any) -> int:
    """Key code that a US keyboard has at the place of a letter or digit; other keys have their own.

    Layouts without Latin letters have no others, and A, W and Q lie elsewhere on French ones.
    """
    place = getattr(event, "scancode", 0) - _SCAN_A
    return ord(_PLACES[place]) if 0 <= place < len(_PLACES) else int(event.key)


def usb_of_guid(guid: str) -> str:
    """``vendor:product`` in an SDL joystick GUID: bytes 4–5 and 8–9, little endian."""
    data = bytes.fromhex(guid) if len(guid) == 32 else bytes(16)
    return f"{int.from_bytes(data[4:6], 'little'):04x}:{int.from_bytes(data[8:10], 'little'):04x}"
