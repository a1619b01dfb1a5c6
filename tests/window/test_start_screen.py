"""The start screen: a drive chosen by keyboard and by pad, and scripts that never see it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from carlaloc_env.map.sources import known_towns
from recorder.cli.commands.record import _chooses
from recorder.cli.main import main, make_parser
from recorder.devices.inputs import Inputs
from recorder.devices.virtual_stick import GAMEPAD, WHEEL
from recorder.window.start_screen import DriveChoice, StartScreen
from recorder.window.window import Window

pygame = pytest.importorskip("pygame")

FIRST = {"map": "Town03", "weather": "ClearNoon", "traffic": "dynamic"}
NEXT_TOWN = list(known_towns())[list(known_towns()).index("Town03") + 1]
UP, RIGHT, DOWN = 1, 2, 4


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> Iterator[Window]:
    """A window on SDL's dummy display."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Window("test")
    yield window
    window.close()


def press(*keys: int) -> None:
    for key in keys:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))


def test_a_drive_is_chosen_by_keyboard(window: Window, inputs: Inputs) -> None:
    """Rows go round; a schedule that was given on the command line stays on the list."""
    first = {**FIRST, "weather": "shower.yaml"}
    screen = StartScreen(window, inputs, DriveChoice(device="keyboard", **first))
    press(pygame.K_RIGHT, pygame.K_DOWN, pygame.K_d, pygame.K_LEFT, pygame.K_DOWN, pygame.K_RIGHT)
    assert not screen.update()
    press(pygame.K_DOWN, pygame.K_LEFT, pygame.K_RIGHT, pygame.K_RETURN)
    assert screen.run() == DriveChoice(device="keyboard", map=NEXT_TOWN, weather="shower.yaml", traffic="0.5")


def test_a_drive_is_chosen_by_pad(
    window: Window, inputs: Inputs, plug: Callable[..., Any], tmp_path: Path
) -> None:
    """No drive starts with a pad that is not there; its name is shown as soon as it is."""
    screen = StartScreen(window, inputs, DriveChoice(device="gamepad", **FIRST))
    press(pygame.K_RETURN)
    assert not screen.update(), "no pad is there yet"
    with plug(GAMEPAD, 6, 11, 1) as pad:
        for direction in (0, RIGHT, 0, DOWN, 0, RIGHT, 0):
            pad.hat(direction)
            assert not screen.update()
        pad.button(0, True)
        assert screen.run() == DriveChoice(
            device="gamepad", map=NEXT_TOWN, weather="CloudyNoon", traffic="dynamic"
        )


def test_of_several_wheels_the_one_that_is_turned_is_taken(
    window: Window, inputs: Inputs, plug: Callable[..., Any]
) -> None:
    first, second = (plug(WHEEL, 4, 9, 0, name, (1, k)) for k, name in enumerate(("H Shifter", "Base")))
    with first, second:
        inputs.pump()
        screen = StartScreen(window, inputs, DriveChoice(device="wheel", **FIRST))
        press(pygame.K_RETURN)
        assert not screen.update(), "nothing was turned yet"
        for raw in (0.05, -0.3):
            second.axis(0, raw)
            assert not screen.update()
        press(pygame.K_RETURN)
        assert screen.run().device == "wheel"
        assert screen.preferred == "0001:0001"


@pytest.mark.parametrize(
    ("words", "driver", "chooses"),
    [
        ("--device keyboard", "x11", True),
        ("--device keyboard", "dummy", False),
        ("--device keyboard --traffic 0.1", "x11", False),
        ("--device wheel --map Town05", "x11", False),
        ("--device wheel --map Town05 --choose", "x11", True),
        ("--device gamepad --no-choose", "x11", False),
        ("--device scripted --window", "x11", False),
        ("--choose", "x11", True),
        ("", "x11", False),
    ],
)
def test_scripts_are_asked_nothing(
    words: str, driver: str, chooses: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", driver)
    assert _chooses(make_parser().parse_args(["record", *words.split()])) == chooses


def test_escape_is_one_line_of_the_command(
    window: Window, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the command to the screen and back; a start screen without a window is refused."""
    press(pygame.K_ESCAPE)
    command = ["record", "--choose", "--out", str(tmp_path / "a.mcap")]
    assert main(command) == 1
    assert main([*command, "--no-window"]) == 2
    closed, refused = (line for line in capsys.readouterr().err.splitlines() if "carlaloc record" in line)
    assert "nothing has been recorded" in closed
    assert "--no-window" in refused
    assert not list(tmp_path.iterdir())
