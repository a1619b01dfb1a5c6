"""Events of joysticks: their ids, and no display needed."""

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest

from carlaloc_env.core.errors import DeviceError
from recorder.devices.base import Command
from recorder.devices.inputs import Inputs, usb_of_guid
from recorder.devices.keys import KEY_COMMANDS


def test_usb_ids_are_read_from_guids() -> None:
    """Bytes 4–5 and 8–9 of a G29's GUID on Linux."""
    assert usb_of_guid("030000006d0400004fc2000011010000") == "046d:c24f"
    assert usb_of_guid("rubbish") == "0000:0000"


def test_no_display_is_needed() -> None:
    """Rules out that a wheel without a window opens one."""
    code = "from recorder.devices.inputs import Inputs; Inputs(window=False).pump()"
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")}
    subprocess.run([sys.executable, "-c", code], check=True, env=env, timeout=600)


def test_a_pad_that_is_gone_again_is_ignored(inputs: Inputs) -> None:
    """Its arrival lies in SDL's queue still."""
    pygame = pytest.importorskip("pygame")
    pygame.event.post(pygame.event.Event(pygame.JOYDEVICEADDED, device_index=0))
    pygame.event.post(pygame.event.Event(pygame.JOYDEVICEREMOVED, instance_id=77))
    inputs.pump()
    assert (inputs.gained, inputs.lost) == ([], [])


def test_a_pad_that_arrives_twice_is_one(inputs: Inputs, plug: Callable[..., Any]) -> None:
    pygame = pytest.importorskip("pygame")
    with plug() as stick:
        pygame.event.post(pygame.event.Event(pygame.JOYDEVICEADDED, device_index=0))
        inputs.pump()
        assert len(inputs.gained) == len(inputs.sticks) == 1
        stick.axis(0, 0.5)
        inputs.pump()
        (seen,) = inputs
        assert seen.raw[0] == pytest.approx(0.5, abs=1e-3)


def test_a_video_driver_that_does_not_start_is_a_line() -> None:
    code = "from recorder.devices.inputs import Inputs; Inputs(window=False)"
    env = {**os.environ, "SDL_VIDEODRIVER": "nonsense"}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert DeviceError.__name__ in done.stderr
    assert "SDL_VIDEODRIVER" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(("layout", "typed"), [("US", "wadq"), ("Russian", "цфвй"), ("French", "zqda")])
def test_letters_count_by_their_place_on_the_keyboard(layout: str, typed: str, inputs: Inputs) -> None:
    """Codes of places are those of USB's usage tables (page 7): A is 4, D 7, Q 20, W 26."""
    pygame = pytest.importorskip("pygame")
    for letter, place in zip(typed, (26, 4, 7, 20), strict=True):
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=ord(letter), scancode=place))
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_SPACE, scancode=44))
    inputs.pump()
    assert inputs.keys == {ord("w"), ord("a"), ord("d"), ord("q"), pygame.K_SPACE}
    assert KEY_COMMANDS[inputs.presses[3].key or 0] is Command.INDICATOR_LEFT
    # Released after the layout was changed.
    pygame.event.post(pygame.event.Event(pygame.KEYUP, key=ord("w"), scancode=26))
    inputs.pump()
    assert ord("w") not in inputs.keys
