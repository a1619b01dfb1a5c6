"""A route for devices that hardly look at it, and sticks that SDL makes in software."""

from __future__ import annotations

import ctypes
import os
import re
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import pytest
from shared_fixtures.drives.driver_runs import route_of

from carlaloc_env.town.routing.route import Route
from recorder.devices.inputs import Inputs

WHEEL, GAMEPAD = 2, 1


def bundled_sdl() -> ctypes.CDLL:
    """The SDL that pygame has loaded."""
    maps = Path("/proc/self/maps")
    if not maps.exists():
        pytest.skip("virtual joysticks are made through /proc, which is missing here")
    found = re.findall(r"(/\S*libSDL2-2\S*)", maps.read_text())
    if not found or not hasattr(ctypes.CDLL(found[0]), "SDL_JoystickAttachVirtual"):
        pytest.skip("this SDL has no virtual joysticks")
    sdl = ctypes.CDLL(found[0])
    sdl.SDL_JoystickOpen.restype = ctypes.c_void_p
    sdl.SDL_JoystickSetVirtualAxis.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int16]
    sdl.SDL_JoystickSetVirtualButton.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint8]
    sdl.SDL_JoystickSetVirtualHat.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint8]
    sdl.SDL_JoystickInstanceID.argtypes = [ctypes.c_void_p]
    return sdl


class _Described(ctypes.Structure):
    """SDL_VirtualJoystickDesc of SDL 2.24 and later."""

    _fields_ = (
        *((name, ctypes.c_uint16) for name in ("version", "type", "naxes", "nbuttons", "nhats", "vendor")),
        *((name, ctypes.c_uint16) for name in ("product", "padding")),
        *((name, ctypes.c_uint32) for name in ("button_mask", "axis_mask")),
        ("name", ctypes.c_char_p),
        *((f"callback_{k}", ctypes.c_void_p) for k in range(7)),
    )


class VirtualStick:
    """A plugged-in joystick, no hardware needed; pulled out at the end of a `with` block.

    With a name it has that and USB ids (vendor, product), else those that SDL makes up.
    """

    def __init__(
        self, kind: int = WHEEL, axes: int = 4, buttons: int = 25, hats: int = 0, name: str = "",
        usb: tuple[int, int] = (0, 0),
    ) -> None:  # fmt: skip
        self._sdl = bundled_sdl()
        if name:
            self._described = _Described(
                version=1, type=kind, naxes=axes, nbuttons=buttons, nhats=hats, vendor=usb[0], product=usb[1],
                name=name.encode(),
            )  # fmt: skip
            index = self._sdl.SDL_JoystickAttachVirtualEx(ctypes.byref(self._described))
        else:
            index = self._sdl.SDL_JoystickAttachVirtual(kind, axes, buttons, hats)
        if index < 0:
            pytest.skip("SDL cannot attach a virtual joystick here")
        self._handle = self._sdl.SDL_JoystickOpen(index)
        self._instance = self._sdl.SDL_JoystickInstanceID(self._handle)
        self._plugged = True

    def axis(self, number: int, value: float) -> None:
        """Move an axis to a raw value, −1…1."""
        self._sdl.SDL_JoystickSetVirtualAxis(self._handle, number, round(32767 * value))

    def button(self, number: int, down: bool) -> None:
        """Press or release a button."""
        self._sdl.SDL_JoystickSetVirtualButton(self._handle, number, int(down))

    def hat(self, direction: int) -> None:
        """Press the D-pad: SDL's 1 up, 2 right, 4 down, 8 left, 0 released."""
        self._sdl.SDL_JoystickSetVirtualHat(self._handle, 0, direction)

    def unplug(self) -> None:
        """Pull it out."""
        if not self._plugged:
            return
        self._plugged = False
        for index in range(self._sdl.SDL_NumJoysticks()):
            if self._sdl.SDL_JoystickGetDeviceInstanceID(index) == self._instance:
                self._sdl.SDL_JoystickDetachVirtual(index)
                return

    def __enter__(self) -> VirtualStick:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()


@pytest.fixture
def plug() -> type[VirtualStick]:
    """Makes virtual sticks."""
    return VirtualStick


@pytest.fixture
def straight_route() -> Route:
    """A kilometre eastwards at 50 km/h."""
    return route_of([(1000.0, 0.0)], 13.9)


@pytest.fixture
def inputs() -> Iterator[Inputs]:
    """Events of all sticks, without a window."""
    pytest.importorskip("pygame")
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    source = Inputs(window=False)
    yield source
    source.close()
