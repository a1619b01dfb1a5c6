"""The start screen: device, town, weather and traffic of a drive, chosen by keyboard or pad."""

import time
from dataclasses import asdict, dataclass, replace
from typing import Any

from carlaloc_env.core.errors import DeviceError
from carlaloc_env.map.sources import known_towns
from carlaloc_env.weather.presets import PRESETS
from recorder.devices.base import DEVICES, HUMAN, Command
from recorder.devices.inputs import Inputs, Press
from recorder.devices.keys import (
    BACK,
    FORWARD,
    KEY_COMMANDS,
    LEFT,
    RIGHT,
)
from recorder.devices.profile import known_profiles
from recorder.devices.stick_roles import StickRoles
from recorder.window.lettering import (
    AMBER,
    BLUE,
    DARK,
    WHITE,
)
from recorder.window.opening import CLOSED_EARLY
from recorder.window.window import Window

_TRAFFIC = {
    "dynamic": "cars, buses, bicycles and walkers, and parked cars",
    "0.5": "half of them, and parked cars",
    "static": "parked cars alone",
    "empty": "no others and no parked cars",
}
_ALWAYS_THERE = {
    "scripted": "drives the route by itself",
    "hand": "drives the route by itself, on a virtual wheel",
    "keyboard": "arrows or W A S D",
}
_ENTER, _CONFIRM_BUTTON = (13, 0x4000_0058), 0
_FRAME_S = 1.0 / 30.0
_PALE, _CHOSEN = (176, 182, 188), (36, 66, 102, 235)
_ROAD, _LAND, _LINE = (62, 66, 70), (58, 82, 52), (220, 220, 210)
_NIGHT, _SUNSET, _NOON, _CLOUDS = (16, 22, 44), (224, 138, 84), (112, 172, 228), (150, 156, 162)
_STEPS = ((RIGHT, (1, 0)), (LEFT, (-1, 0)), (FORWARD, (0, 1)), (BACK, (0, -1)))
"""Keys, and their step to the right and up, as a D-pad has it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveChoice:
    """Choices of the start screen."""

    device: str
    """Input device."""
    map: str
    """Town, or path of an OpenDRIVE file."""
    weather: str
    """Weather in the window, by name or as a schedule."""
    traffic: str
    """Level of the town's traffic."""


class StartScreen:
    """Four rows, of which each has a value; shown until they are confirmed.

    Args:
        window: Where it is shown.
        inputs: Where events come from.
        choice: Values at first; those that the lists lack are added to them.
    """

    def __init__(self, window: Window, inputs: Inputs, choice: DriveChoice) -> None:
        self._window, self._inputs = window, inputs
        self.choice = choice
        profiles = known_profiles()
        self._roles = {device: StickRoles(device, profiles, inputs) for device in HUMAN}
        # Here and not above: a window opens before this is loaded.
        from carlaloc_env.map.config import TownConfig

        files = {name: path.with_name("town.toml") for name, path in known_towns().items()}
        towns = {
            name: TownConfig.from_toml(file).description if file.exists() else ""
            for name, file in files.items()
        }
        weathers = {
            name: f"clouds {w.cloudiness:.0f} %, rain {w.precipitation:.0f} %, fog {w.fog_density:.0f} %"
            for name, w in PRESETS.items()
        }
        self._remarks = {**towns, **weathers, **_TRAFFIC}
        lists = {"device": DEVICES, "map": towns, "weather": weathers, "traffic": _TRAFFIC}
        self._options = {
            name: [*dict.fromkeys((*lists[name], value))] for name, value in asdict(choice).items()
        }
        self._row = 1
        self._warning = ""

    def run(self) -> DriveChoice:
        """Show it until the driver starts.

        Raises:
            DeviceError: the driver has pressed Escape or closed the window.
        """
        while not self.update():
            time.sleep(_FRAME_S)
        return self.choice

    def update(self) -> bool:
        """Handle the presses, and draw; True once the choice is confirmed.

        Raises:
            DeviceError: as `run`.
        """
        self._inputs.pump()
        for roles in self._roles.values():
            roles.update(self._inputs.lost, self._inputs.gained)
        asked = [KEY_COMMANDS.get(press.key or 0) for press in self._inputs.presses]
        if self._inputs.closed or Command.QUIT in asked:
            raise DeviceError(CLOSED_EARLY)
        for press in self._inputs.presses:
            if press.key in _ENTER or press.button == _CONFIRM_BUTTON:
                device = self.choice.device
                if device in HUMAN and press.stick is not None:
                    self._roles[device].choose(press.stick)
                question = self._roles[device].question if device in HUMAN else ""
                if self._connected(device) and not question:
                    return True
                lacking = f"no {device} is connected: plug it in, or choose another device"
                self._warning = question or lacking
            else:
                self._step(*_direction(press))
        self._window.paint(self._draw)
        return False

    @property
    def preferred(self) -> str | None:
        """USB id of the stick that steers; None: there is none."""
        steering = self._roles[self.choice.device].of("steer") if self.choice.device in HUMAN else None
        return steering[0].usb if steering else None

    def _step(self, right: int, up: int) -> None:
        self._row = (self._row - up) % len(self._options)
        name = list(self._options)[self._row]
        options = self._options[name]
        position = options.index(getattr(self.choice, name)) + right
        self.choice = replace(self.choice, **{name: options[position % len(options)]})
        if right or up:
            self._warning = ""

    def _connected(self, device: str) -> str:
        """Name of what is connected of a device, or which one is asked for; empty where nothing is."""
        if device in _ALWAYS_THERE:
            return _ALWAYS_THERE[device]
        if self._roles[device].question:
            return "several are connected: turn the one that steers"
        steering = self._roles[device].of("steer")
        return steering[0].name if steering else ""

    def _draw(self, pygame: Any, surface: Any) -> None:
        width, height = surface.get_size()
        self._backdrop(pygame, surface)
        u, write = self._window.lettering.unit, self._window.lettering.write
        write(surface, "CarlaLoc", "big", (3 * u, 2 * u), WHITE, "topleft")
        write(surface, "Choose your drive", "medium", (3.1 * u, 5 * u), WHITE, "topleft")
        panel = pygame.Surface((width - 6 * u, 16.4 * u), pygame.SRCALPHA)
        panel.fill((*DARK, 215))
        for row, name in enumerate(self._options):
            y, chosen = (2.2 + 4 * row) * u, row == self._row
            if chosen:
                panel.fill(_CHOSEN, (0, y - 2 * u, panel.get_width(), 4 * u))
            label = "town" if name == "map" else name
            write(panel, label, "medium", (u, y), WHITE if chosen else _PALE, "midleft")
            value = getattr(self.choice, name)
            remark = self._remarks.get(value, "")
            if name == "device":
                remark = self._connected(value) or "not connected: plug it in"
            write(panel, value, "medium", (25 * u, y - 0.6 * u), WHITE, "center")
            write(panel, remark, "small", (25 * u, y + 1.0 * u), _PALE, "center")
            for x, text in ((13 * u, "<"), (37 * u, ">")) if chosen else ():
                write(panel, text, "medium", (x, y - 0.6 * u), BLUE, "center")
        surface.blit(panel, (3 * u, 7.6 * u))
        surface.fill(DARK, (0, height - 3.6 * u, width, 4 * u))
        keys = "arrows or D-pad: choose     Enter or button A / cross: drive     Esc: leave"
        write(surface, keys, "small", (4 * u, height - 1.9 * u), _PALE)
        there = ", ".join(["keyboard", *(stick.name for stick in self._inputs)])
        line = self._warning or f"connected: {there}"
        colour = AMBER if self._warning else WHITE
        write(surface, line, "small", (4 * u, height - 0.6 * u), colour)

    def _backdrop(self, pygame: Any, surface: Any) -> None:
        """A road under the sky of the chosen weather."""
        width, height = surface.get_size()
        weather = PRESETS.get(self.choice.weather, PRESETS["ClearNoon"])
        sun_deg = weather.sun_altitude_angle
        sky = _NIGHT if sun_deg < 0.0 else _SUNSET if sun_deg < 20.0 else _NOON
        light = 0.3 if sun_deg < 0.0 else 0.7 if sun_deg < 20.0 else 1.0
        grey = 0.8 * weather.cloudiness / 100.0
        colour = [a + grey * (b * light - a) for a, b in zip(sky, _CLOUDS, strict=True)]
        surface.fill(colour)
        horizon, middle = 0.3 * height, 0.5 * width
        land, road, line = ([c * light for c in flat] for flat in (_LAND, _ROAD, _LINE))
        surface.fill(land, (0, horizon, width, height))
        corners = ((middle, horizon), (1.3 * width, height), (-0.3 * width, height))
        pygame.draw.polygon(surface, road, corners)
        for k in range(1, 7):
            near, far = (horizon + (height - horizon) / (0.9 * d) for d in (k - 0.2, k + 0.3))
            half = 0.02 * (near - horizon)
            pygame.draw.rect(surface, line, (middle - half, far, 2 * half, near - far))


def _direction(press: Press) -> tuple[int, int]:
    """Step to the right and up that a key or a D-pad asks for."""
    return next((step for keys, step in _STEPS if press.key in keys), press.hat)
