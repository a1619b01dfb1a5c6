"""Joysticks that SDL makes in software: to every program a wheel or pad that was plugged in."""

from __future__ import annotations

import ctypes
from contextlib import AbstractContextManager
from ctypes.util import find_library
from pathlib import Path

from carlaloc_env.core.errors import DeviceError
from recorder.devices.inputs import import_pygame

WHEEL, GAMEPAD = 2, 1
"""Kinds of joysticks, by SDL's numbers."""


class _Described(ctypes.Structure):
    """SDL_VirtualJoystickDesc of SDL 2.24 and later."""

    _fields_ = (
        *((name, ctypes.c_uint16) for name in ("version", "type", "naxes", "nbuttons", "nhats", "vendor")),
        *((name, ctypes.c_uint16) for name in ("product", "padding")),
        *((name, ctypes.c_uint32) for name in ("button_mask", "axis_mask")),
        ("name", ctypes.c_char_p),
        *((f"callback_{k}", ctypes.c_void_p) for k in range(7)),
    )


def _loaded_sdl() -> ctypes.CDLL:
    """The SDL that pygame uses: the one of its wheel, or the system's."""
    package = Path(import_pygame("virtual joysticks need").__file__).parent
    bundled = [*package.parent.glob("pygame*.libs/libSDL2-2*"), *package.rglob("libSDL2-2*.dylib")]
    name = next(map(str, [*bundled, *package.glob("SDL2.dll")]), None) or find_library("SDL2-2.0")
    sdl = ctypes.CDLL(name)
    sdl.SDL_JoystickOpen.restype = ctypes.c_void_p
    sdl.SDL_JoystickSetVirtualAxis.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int16]
    sdl.SDL_JoystickSetVirtualButton.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint8]
    sdl.SDL_JoystickSetVirtualHat.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint8]
    sdl.SDL_JoystickInstanceID.argtypes = [ctypes.c_void_p]
    return sdl


class VirtualStick(AbstractContextManager["VirtualStick"]):
    """A plugged-in joystick without hardware; pulled out at the end of a `with` block.

    Args:
        kind: `WHEEL` or `GAMEPAD`.
        axes: Number of axes.
        buttons: Number of buttons.
        hats: Number of D-pads.
        name: What it calls itself; empty: SDL makes up a name and ids.
        usb: USB vendor and product of a stick with a name.

    Raises:
        DeviceError: this SDL cannot make one.
    """

    def __init__(
        self, kind: int = WHEEL, axes: int = 4, buttons: int = 25, hats: int = 0, name: str = "",
        usb: tuple[int, int] = (0, 0),
    ) -> None:  # fmt: skip
        try:
            self._sdl = _loaded_sdl()
            if name:
                self._described = _Described(
                    version=1, type=kind, naxes=axes, nbuttons=buttons, nhats=hats, vendor=usb[0],
                    product=usb[1], name=name.encode(),
                )  # fmt: skip
                index = self._sdl.SDL_JoystickAttachVirtualEx(ctypes.byref(self._described))
            else:
                index = self._sdl.SDL_JoystickAttachVirtual(kind, axes, buttons, hats)
        except (OSError, AttributeError):
            index = -1
        if index < 0:
            raise DeviceError("this SDL makes no virtual joysticks; install pygame-ce 2.5 or newer by pip")
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
        """Pull it out; may be called twice."""
        if not self._plugged:
            return
        self._plugged = False
        for index in range(self._sdl.SDL_NumJoysticks()):
            if self._sdl.SDL_JoystickGetDeviceInstanceID(index) == self._instance:
                self._sdl.SDL_JoystickDetachVirtual(index)
                return

    def __exit__(self, *_: object) -> None:
        self.unplug()
