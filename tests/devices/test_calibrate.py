"""Calibration of a device as a person does it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from carlaloc_env.core.errors import DeviceError
from recorder.devices.calibrate import calibrate
from recorder.devices.inputs import Inputs
from recorder.devices.profile import read_profile
from recorder.devices.virtual_stick import GAMEPAD

pytest.importorskip("pygame")


Plug = Callable[..., Any]


@pytest.fixture(autouse=True)
def _quick_hands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who moves a stick in software need not hold it for long."""
    monkeypatch.setattr("recorder.devices.calibrate._HOLD_S", 0.1)


def test_calibration_as_a_person_does_it(inputs: Inputs, tmp_path: Path, plug: Plug) -> None:
    """A person follows the lines shown; this wheel has its pedals swapped and the throttle upside down."""
    stick = plug()
    for axis, rest in ((0, 0.0), (1, -1.0), (2, 1.0), (3, 0.0)):
        stick.axis(axis, 0.5)
        stick.axis(axis, rest)
    inputs.pump()
    moves = {"LEFT": (0, 0.97), "RIGHT": (0, -0.96), "THROTTLE": (1, 1.0), "BRAKE": (2, -1.0)}
    rests = {0: 0.0, 1: -1.0, 2: 1.0}
    moved: list[int] = []

    def person(line: str) -> None:
        if "Let go" in line and moved:
            stick.axis(moved[-1], rests[moved[-1]])
        for word, (axis, value) in moves.items():
            if word in line:
                moved.append(axis)
                stick.axis(axis, value)

    path = calibrate("wheel", ask=person, inputs=inputs, folder=tmp_path)
    stick.unplug()
    profile = read_profile(path.read_text(), "x")
    assert profile.calibrated
    assert profile.steer is not None
    assert profile.throttle is not None
    assert profile.brake is not None
    assert (profile.steer.axis, profile.throttle.axis, profile.brake.axis) == (0, 1, 2)
    assert profile.steer.full == pytest.approx(0.97, abs=0.01)
    assert (profile.throttle.rest, profile.throttle.full) == pytest.approx((-1.0, 1.0), abs=0.01)
    assert (profile.brake.rest, profile.brake.full) == pytest.approx((1.0, -1.0), abs=0.01)


def test_buttons_become_pedals_where_no_axis_moves(inputs: Inputs, tmp_path: Path, plug: Plug) -> None:
    """A pad without analogue triggers; its button 5 meant an indicator before."""
    stick = plug(GAMEPAD, 2, 10)
    inputs.pump()
    held: list[int] = []

    def person(line: str) -> None:
        if "Let go" in line:
            stick.axis(0, 0.0)
            stick.button(held.pop(), False) if held else None
        for word, value in (("LEFT", -1.0), ("RIGHT", 1.0)):
            stick.axis(0, value) if word in line else None
        for word, button in (("THROTTLE", 5), ("BRAKE", 0)):
            if word in line:
                held.append(button)
                stick.button(button, True)

    path = calibrate("gamepad", ask=person, inputs=inputs, folder=tmp_path)
    stick.unplug()
    profile = read_profile(path.read_text(), "x")
    assert (profile.throttle, profile.brake) == (None, None)
    assert (profile.buttons["throttle"], profile.buttons["brake"]) == (5, 0)
    assert "handbrake" not in profile.buttons, "button 0 brakes now"


def test_a_device_without_axes_is_refused(inputs: Inputs, tmp_path: Path, plug: Plug) -> None:
    with plug(GAMEPAD, 0, 10):
        inputs.pump()
        with pytest.raises(DeviceError, match="no axis to steer with"):
            calibrate("gamepad", ask=print, inputs=inputs, folder=tmp_path)


def test_of_two_devices_the_one_that_is_turned_is_calibrated(
    inputs: Inputs, tmp_path: Path, plug: Plug
) -> None:
    """A wheel's base need not have a button."""
    other, base = plug(GAMEPAD, 4, 9, 0, "Box", (1, 1)), plug(GAMEPAD, 4, 0, 0, "Base", (1, 2))
    inputs.pump()
    lines: list[str] = []

    def person(line: str) -> None:
        lines.append(line)
        if "2 devices are connected" in line:
            base.axis(0, 0.05)
            inputs.pump()
            base.axis(0, 0.6)
        elif "Turn fully" in line:
            raise KeyboardInterrupt

    with other, base, pytest.raises(KeyboardInterrupt):
        calibrate("wheel", ask=person, inputs=inputs, folder=tmp_path)
    assert lines[1].startswith("Base (0001:0002)")
