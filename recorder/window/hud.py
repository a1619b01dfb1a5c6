"""Instruments over the live image, with nothing in the middle of the view."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from recorder.devices.keys import HELP_LINES
from recorder.window.drive_status import DriveStatus
from recorder.window.lettering import AMBER, BLUE, DARK, WHITE, Lettering

_GREY, _RED, _GREEN = (150, 156, 162), (235, 60, 50), (70, 200, 90)
_LIGHTS = {"red": _RED, "yellow": AMBER, "green": _GREEN}
_WARNINGS = {
    "collision": "COLLISION",
    "red_light": "RED LIGHT",
    "off_road": "OFF THE ROAD",
    "wrong_way": "WRONG WAY",
    "speeding": "TOO FAST",
    "off_route": "OFF THE ROUTE",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class HudState:
    """Values that the instruments show."""

    status: DriveStatus
    """Controls, and what the driver has switched on."""
    speed_mps: float
    """Speed [m/s]."""
    limit_mps: float
    """Speed limit here [m/s]."""
    turn_deg: float
    """Direction of the route ahead, left positive [deg]."""
    remaining_m: float
    """Route still to drive [m]."""
    driven_m: float
    """Route driven so far [m]."""
    light: str
    """Name of the next light's `SignalState`; the window opens before that is loaded."""
    light_m: float | None
    """Distance to its stop line [m]."""
    time_s: float
    """Length of the recording [s]."""
    view: str
    """Camera."""
    pictures_hz: float
    """Pictures shown a second."""


class Hud:
    """Draws the instruments.

    Args:
        pygame: The module, initialised.
        size_px: Size of the window [px].
        lettering: Writes in it.
    """

    def __init__(self, pygame: Any, size_px: tuple[int, int], lettering: Lettering) -> None:
        self._pygame = pygame
        self._width, self._height = size_px
        self._text, self._unit = lettering.write, lettering.unit
        unit = self._unit
        self._veil = pygame.Surface((self._width, unit * 5), pygame.SRCALPHA)
        for row in range(unit * 5):
            alpha = round(190 * (row / (unit * 5)) ** 0.7)
            self._veil.fill((*DARK, alpha), (0, row, self._width, 1))

    def draw(self, surface: Any, state: HudState, map_image: Any | None) -> None:
        """Draw over an image.

        Args:
            surface: The window.
            state: What to show.
            map_image: Surface of the small map.
        """
        surface.blit(self._veil, (0, self._height - self._veil.get_height()))
        self._speed(surface, state)
        self._pedals(surface, state)
        self._route(surface, state)
        self._recording(surface, state)
        if map_image is not None:
            position = (self._width - map_image.get_width() - self._unit // 2, self._unit // 2)
            surface.blit(map_image, position)
            self._pygame.draw.rect(surface, _GREY, (*position, *map_image.get_size()), 1)
        self._lines(surface, state)
        if state.status.help:
            self._help(surface, state.status.buttons)

    def _speed(self, surface: Any, state: HudState) -> None:
        u, base = self._unit, self._height - self._unit // 2
        text = f"{abs(state.speed_mps) * 3.6:.0f}"
        too_fast = state.speed_mps > state.limit_mps + 1.5
        self._text(surface, text, "big", (5 * u, base), AMBER if too_fast else WHITE, "bottomright")
        self._text(surface, "km/h", "small", (5.3 * u, base - 0.4 * u), _GREY, "bottomleft")
        sign = (round(8.6 * u), round(base - 1.5 * u))
        self._pygame.draw.circle(surface, WHITE, sign, round(1.2 * u))
        self._pygame.draw.circle(surface, _RED, sign, round(1.2 * u), max(2, u // 4))
        self._text(surface, f"{state.limit_mps * 3.6:.0f}", "small", sign, DARK, "center")
        back = state.status.controls.reverse
        self._text(surface, "R" if back else "D", "big", (11 * u, base), AMBER if back else WHITE)
        if state.status.controls.handbrake:
            self._text(surface, "(P)", "medium", (13 * u, base - 0.3 * u), _RED)
        if state.status.headlamps:
            self._text(surface, "lights", "small", (11 * u, base - 3.2 * u), _GREEN)
        for side, x in (("left", 1.2), ("right", 3.2)):
            on = state.status.indicator == side and int(state.time_s * 3.0) % 2 == 0
            self._arrow(surface, (x * u, base - 3.8 * u), 90.0 if side == "left" else -90.0, u * 0.6,
                        _GREEN if on else _GREY)  # fmt: skip

    def _pedals(self, surface: Any, state: HudState) -> None:
        u, draw = self._unit, self._pygame.draw
        x, y, width = 16 * u, self._height - 1.6 * u, 9 * u
        draw.rect(surface, _GREY, (x, y, width, 0.5 * u), 1)
        centre = x + width / 2
        end = centre - state.status.controls.steer * width / 2
        draw.rect(surface, BLUE, (min(centre, end), y, max(abs(end - centre), 1), 0.5 * u))
        draw.line(surface, WHITE, (centre, y - 3), (centre, y + 0.5 * u + 2))
        self._text(surface, "steering", "small", (centre, y - 0.2 * u), _GREY, "midbottom")
        for k, (value, colour, name) in enumerate(
            ((state.status.controls.throttle, _GREEN, "gas"), (state.status.controls.brake, _RED, "brake"))
        ):
            left, top, tall = x + width + (1.5 + 2.4 * k) * u, self._height - 3.9 * u, 2.8 * u
            draw.rect(surface, _GREY, (left, top, u, tall), 1)
            draw.rect(surface, colour, (left, top + tall * (1 - value), u, tall * value))
            self._text(surface, name, "small", (left + u / 2, top + tall + 0.1 * u), _GREY, "midtop")

    def _route(self, surface: Any, state: HudState) -> None:
        u, base = self._unit, self._height - self._unit // 2
        x = self._width - 13 * u
        self._arrow(surface, (x, base - 2.2 * u), state.turn_deg, 1.1 * u, BLUE)
        self._text(surface, _metres(state.remaining_m), "medium", (x + 1.8 * u, base - 1.4 * u), WHITE)
        self._text(surface, "to go", "small", (x + 1.8 * u, base - 0.4 * u), _GREY)
        if state.light in _LIGHTS and state.light_m is not None:
            colour = _LIGHTS[state.light]
            position = (round(self._width - 4.8 * u), round(base - 2.0 * u))
            self._pygame.draw.circle(surface, DARK, position, round(0.95 * u))
            self._pygame.draw.circle(surface, colour, position, round(0.75 * u))
            distance = f"{max(state.light_m, 0.0):.0f} m"
            self._text(surface, distance, "medium", (self._width - 3.6 * u, base - 1.4 * u), WHITE)
            self._text(surface, "to light", "small", (self._width - 3.6 * u, base - 0.4 * u), _GREY)

    def _recording(self, surface: Any, state: HudState) -> None:
        u = self._unit
        on = state.status.paused or int(state.time_s * 2.0) % 2 == 0
        self._pygame.draw.circle(surface, _RED if on else _GREY, (u, u), round(0.45 * u))
        minutes, seconds = divmod(int(state.time_s), 60)
        text = f"REC {minutes:02d}:{seconds:02d}   {state.status.size_mb:.1f} MB   {_metres(state.driven_m)}"
        self._text(surface, text, "small", (1.8 * u, u), WHITE, "midleft", shadow=True)
        view = f"view: {state.view}, {state.pictures_hz:.0f} pictures/s"
        counts = f"collisions {state.status.collisions}, rules broken {state.status.broken}"
        line = f"{state.status.device}   {view}   {counts}   H: help"
        self._text(surface, line, "small", (0.6 * u, 1.8 * u), WHITE, "topleft", shadow=True)

    def _lines(self, surface: Any, state: HudState) -> None:
        middle, y = self._width / 2, self._height * 0.13
        lines = [(_WARNINGS[name], _RED) for name in state.status.warnings]
        if state.status.paused:
            lines.append(("PAUSED: press P to resume", WHITE))
        if state.status.message:
            lines.append((state.status.message, AMBER))
        for text, colour in lines:
            self._text(surface, text, "medium", (middle, y), colour, "center", shadow=True)
            y += 1.6 * self._unit
        if state.status.slow is not None:
            text = f"this machine is slow: the world runs at {state.status.slow:.0%} of real time"
            position = (self._width / 2, self._unit)
            self._text(surface, text, "small", position, AMBER, "center", shadow=True)

    def _help(self, surface: Any, buttons: Mapping[str, int]) -> None:
        u = self._unit
        wide, tall = 30 * u, (len(HELP_LINES) + 2) * 1.3 * u
        panel = self._pygame.Surface((wide, tall), self._pygame.SRCALPHA)
        panel.fill((*DARK, 225))
        for row, (keys, what, commands) in enumerate(HELP_LINES):
            y = (row + 1) * 1.3 * u
            numbers = [str(buttons[name]) for name in commands if name in buttons]
            if numbers:
                self._text(panel, f"button {', '.join(numbers)}", "small", (wide - u, y), AMBER, "topright")
            self._text(panel, keys, "small", (u, y), AMBER, "topleft")
            self._text(panel, what, "small", (9 * u, y), WHITE, "topleft")
        surface.blit(panel, ((self._width - wide) / 2, (self._height - tall) / 2))

    def _arrow(
        self,
        surface: Any,
        position: tuple[float, float],
        turn_deg: float,
        size: float,
        colour: tuple[int, ...],
    ) -> None:
        """An arrow that points up when straight on, and to the left for positive turns."""
        vector = self._pygame.math.Vector2
        shape = ((0, -1), (0.75, 0.1), (0.28, 0.1), (0.28, 1), (-0.28, 1), (-0.28, 0.1), (-0.75, 0.1))
        points = [vector(position) + vector(point).rotate(-turn_deg) * size for point in shape]
        self._pygame.draw.polygon(surface, colour, points)


def _metres(distance_m: float) -> str:
    return f"{distance_m / 1000.0:.2f} km" if distance_m >= 1000.0 else f"{max(distance_m, 0.0):.0f} m"
