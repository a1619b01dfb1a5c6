"""Wheels and pedals as SDL delivers them: first values, plugs pulled and put back, buttons."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.clock import TICK_HZ
from carlaloc_env.core.errors import DeviceError
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.map.routing.route import Route
from carlaloc_env.physics.params import VehicleParams
from recorder.devices.base import Command
from recorder.devices.control_shaping import wheel_steer
from recorder.devices.human import HumanDevice
from recorder.devices.inputs import Inputs
from recorder.devices.profile import known_profiles, read_profile
from recorder.devices.virtual_stick import GAMEPAD, WHEEL

pytest.importorskip("pygame")


Plug = Callable[..., Any]


SHIPPED = "name: Virtual Wheel\nkind: wheel\nrotation_deg: 900\n" + "\n".join(
    (
        "steer: {axis: 0, rest: 0.0, full: -1.0, opposite: 1.0, dead_zone: 0.0, saturation: 0.0}",
        "throttle: {axis: 2, rest: 1.0, full: -1.0}",
        "brake: {axis: 3, rest: 1.0, full: -1.0}",
        "buttons: {handbrake: 0, reverse: 1, camera: 3}",
    )
)
PROFILES = [read_profile(SHIPPED, "test")]


def view(route: Route, speed_mps: float = 0.0) -> DriverView:
    return DriverView(
        tick=0, position_m=np.zeros(3), heading_rad=0.0, speed_mps=speed_mps, acceleration_mps2=0.0,
        route=route, route_s_m=0.0, offset_m=0.0, speed_limit_mps=13.9,
    )  # fmt: skip


def run(device: HumanDevice, seen: DriverView, seconds: float) -> list[tuple[float, float, float]]:
    trace = []
    for k in range(round(seconds * TICK_HZ)):
        if k % 8 == 0:
            device.poll()
        c = device.read(seen)
        trace.append((c.steer, c.throttle, c.brake))
    return trace


def test_pedal_that_has_not_moved_is_not_half_pressed(
    inputs: Inputs, straight_route: Route, plug: Plug
) -> None:
    with plug() as stick:
        inputs.pump()
        device = HumanDevice("wheel", inputs, PROFILES)
        assert max(throttle for _, throttle, _ in run(device, view(straight_route), 0.5)) == 0.0
        stick.axis(2, 1.0)
        assert run(device, view(straight_route), 0.5)[-1][1] == 0.0
        stick.axis(2, -1.0)
        assert run(device, view(straight_route), 0.5)[-1][1] == pytest.approx(1.0, abs=1e-3)


def test_axis_that_drivers_take_for_a_trigger_does_not_press_in_its_middle(
    inputs: Inputs, straight_route: Route, plug: Plug
) -> None:
    """A Joy-Con's motion axes rattle about 0, where SDL has announced triggers at −1."""
    with plug(GAMEPAD, axes=6, name="Nintendo Switch Joy-Con (L)", usb=(0x057E, 0x2006)) as stick:
        inputs.pump()
        (connected,) = inputs
        assert connected.raw[5] == pytest.approx(-1.0, abs=1e-3)
        device = HumanDevice("gamepad", inputs, known_profiles(Path("none")))
        stick.axis(0, 0.3)
        for value in (0.05, -0.06, 0.06, -0.02):
            stick.axis(2, value)
            stick.axis(5, value)
            assert run(device, view(straight_route), 0.3)[-1][1:] == (0.0, 0.0)
        assert device.message is not None
        assert "let go of the throttle" in device.message
        # A trigger that comes to rest acts from then on.
        stick.axis(5, -1.0)
        assert run(device, view(straight_route), 0.3)[-1][1] == 0.0
        stick.axis(5, 0.0)
        assert run(device, view(straight_route), 0.5)[-1][1] == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("presses", [(1.0,), (-0.6, 0.0, 1.0)])
def test_first_pull_of_a_trigger_acts(
    inputs: Inputs, straight_route: Route, plug: Plug, presses: tuple[float, ...]
) -> None:
    with plug(GAMEPAD, axes=6) as stick:
        inputs.pump()
        device = HumanDevice("gamepad", inputs, known_profiles(Path("none")))
        for value in presses:
            stick.axis(5, value)
            device.poll()
        assert run(device, view(straight_route), 0.5)[-1][1] == pytest.approx(1.0, abs=1e-3)


def test_wheel_turns_the_road_wheels_by_its_ratio(inputs: Inputs, straight_route: Route, plug: Plug) -> None:
    with plug() as stick:
        inputs.pump()
        device = HumanDevice("wheel", inputs, PROFILES)
        stick.axis(0, -0.2)
        steer = run(device, view(straight_route), 1.0)[-1][0]
    params = VehicleParams()
    assert np.degrees(steer * params.steer_max_rad) == pytest.approx(0.2 * 450.0 / 12.0, rel=1e-3)
    assert device.raw.steer == pytest.approx(0.2, abs=1e-3)


def test_unplugging_brakes_gently_and_plugging_in_goes_on(
    inputs: Inputs, straight_route: Route, plug: Plug
) -> None:
    stick = plug()
    inputs.pump()
    device = HumanDevice("wheel", inputs, PROFILES)
    stick.axis(0, -0.3)
    stick.axis(2, 0.99)
    device.poll()
    stick.axis(2, -0.5)
    before = run(device, view(straight_route, 10.0), 1.0)
    assert before[-1][1] > 0.5
    assert device.message is None
    stick.unplug()
    lost = run(device, view(straight_route, 10.0), 3.0)
    assert ("device_lost" in [kind for kind, _ in device.plugged]) or not device.is_connected
    assert device.message is not None
    assert "UNPLUGGED" in device.message
    assert lost[-1][1] == 0.0
    assert lost[-1][2] == pytest.approx(0.3, abs=0.01)
    assert abs(lost[-1][0]) < 0.3 * abs(before[-1][0])
    steps = np.abs(np.diff(np.array(before[-1:] + lost), axis=0)).max(axis=0)
    assert steps[0] < 0.01
    assert steps[2] < 0.01
    with plug() as again:
        run(device, view(straight_route), 0.1)
        again.axis(2, 1.0)
        again.axis(0, 0.2)
        back = run(device, view(straight_route), 1.0)
        assert device.is_connected
        assert device.message is None
        assert back[-1][0] < -0.1
        assert back[-1][2] == pytest.approx(0.0, abs=1e-3)


def test_buttons_become_commands(inputs: Inputs, straight_route: Route, plug: Plug) -> None:
    with plug() as stick:
        inputs.pump()
        device = HumanDevice("wheel", inputs, PROFILES)
        stick.button(3, True)
        device.poll()
        assert device.commands == [Command.CAMERA]
        stick.button(0, True)
        stick.button(1, True)
        device.poll()
        controls = device.read(view(straight_route))
        assert controls.handbrake
        assert controls.reverse
        stick.button(1, False)
        device.poll()
        stick.button(1, True)
        device.poll()
        assert device.read(view(straight_route, 9.0)).reverse, "no reverse gear at speed"


def test_pedals_of_their_own_go_before_the_wheels(inputs: Inputs, straight_route: Route, plug: Plug) -> None:
    with plug() as stick, plug(1) as feet:
        inputs.pump()
        names = {s.name for s in inputs}
        assert len(names) == 2, names
        other = next(s.name for s in inputs if "Wheel" not in s.name)
        pedals = read_profile(
            f"name: {other}\nkind: pedals\nthrottle: {{axis: 1, rest: -1.0, full: 1.0}}\n", "test"
        )
        device = HumanDevice("wheel", inputs, [*PROFILES, pedals])
        stick.axis(2, -1.0)
        stick.axis(0, -0.1)
        feet.axis(1, -1.0)
        device.poll()
        feet.axis(1, -0.1)
        steer, throttle, _ = run(device, view(straight_route), 1.0)[-1]
        assert throttle == pytest.approx((0.45 - 0.03) / 0.95, abs=0.01)
        assert steer > 0.0


def test_without_a_device_the_error_names_the_next_step(inputs: Inputs) -> None:
    with pytest.raises(DeviceError, match="plug one in"):
        HumanDevice("wheel", inputs, known_profiles())


@pytest.mark.parametrize(
    ("axes", "moved", "pressed", "expected"),
    [
        (2, {0: -1.0}, (5,), (1.0, 1.0, 0.0)),
        (4, {0: 1.0}, (4,), (-1.0, 0.0, 1.0)),
        (5, {0: 0.0, 2: -1.0}, (), (0.0, 1.0, 0.0)),
        (5, {0: 0.0, 2: 1.0}, (), (0.0, 0.0, 1.0)),
        (6, {0: 0.0, 5: 1.0, 2: -1.0}, (), (0.0, 1.0, 0.0)),
    ],
    ids=["no triggers", "on/off triggers", "one axis, right", "one axis, left", "two axes"],
)
def test_pads_of_any_kind_drive(
    inputs: Inputs, straight_route: Route, plug: Plug, caplog: pytest.LogCaptureFixture,
    axes: int, moved: dict[int, float], pressed: tuple[int, ...], expected: tuple[float, float, float],
) -> None:  # fmt: skip
    with plug(GAMEPAD, axes, 12) as stick:
        inputs.pump()
        device = HumanDevice("gamepad", inputs, known_profiles(Path("/nonexistent")))
        stick.button(device.buttons["photo"], True)
        device.poll()
        assert device.commands == [Command.PHOTO]
        assert "is read as 'generic gamepad" in caplog.text
        assert "--calibrate" in caplog.text
        for axis, value in moved.items():
            # SDL names an axis only when it moves, and a trigger acts after it was at rest.
            for raw in (0.5, -1.0 if axes == 6 and axis else 0.0, value):
                stick.axis(axis, raw)
                device.poll()
        for button in pressed:
            stick.button(button, True)
        assert "is read as" in (device.message or "")
        assert run(device, view(straight_route), 3.0)[-1] == pytest.approx(expected, abs=1e-3)
        assert (device.message is None) == (expected[1] > 0.5)


def test_combined_pedals_of_a_wheel_drive(inputs: Inputs, straight_route: Route, plug: Plug) -> None:
    with plug(WHEEL, 2, 4) as stick:
        inputs.pump()
        device = HumanDevice("wheel", inputs, known_profiles(Path("/nonexistent")))
        stick.axis(0, 0.1)
        stick.axis(1, 0.05)
        device.poll()
        for value, expected in ((-1.0, (1.0, 0.0)), (1.0, (0.0, 1.0)), (0.0, (0.0, 0.0))):
            stick.axis(1, value)
            assert run(device, view(straight_route), 1.0)[-1][1:] == pytest.approx(expected, abs=1e-3)


def test_a_profile_with_an_axis_that_is_not_there_is_refused_at_start(
    inputs: Inputs, straight_route: Route, plug: Plug
) -> None:
    with plug(WHEEL, 2) as stick:
        inputs.pump()
        with pytest.raises(DeviceError, match=r"has 2 axes, but .* throttle from axis 2, .*--calibrate"):
            HumanDevice("wheel", inputs, PROFILES)
        stick.unplug()
    with plug(WHEEL, 4) as stick:
        inputs.pump()
        device = HumanDevice("wheel", inputs, PROFILES)
        stick.axis(0, 0.1)
        stick.unplug()
        run(device, view(straight_route), 0.1)
        with plug(WHEEL, 2) as other:
            run(device, view(straight_route), 0.1)
            other.axis(0, 0.1)
            run(device, view(straight_route), 0.1)
            assert device.message is not None
            assert "--calibrate" in device.message


def test_a_stick_without_axes_is_no_wheel(inputs: Inputs, plug: Plug) -> None:
    """Some mice and keyboards call themselves joysticks."""
    with plug(WHEEL, 0, 3):
        inputs.pump()
        with pytest.raises(DeviceError, match=r"no wheel is connected; .* has no axis to steer with"):
            HumanDevice("wheel", inputs, known_profiles(Path("/nonexistent")))


G29, STEAM_PAD, PEDALS = (0x046D, 0xC24F), (0x28DE, 0x11FF), (0x1DD2, 0x100C)
"""USB ids of a known wheel, and of devices that no profile names."""


@pytest.mark.parametrize("pad_first", [True, False])
def test_the_wheel_whose_usb_id_is_known_drives_beside_a_pad(
    inputs: Inputs, straight_route: Route, plug: Plug, pad_first: bool
) -> None:
    """Steam plugs in a pad of its own, which must not take the place of the wheel's pedals."""
    made = {}
    for name in ("pad", "wheel") if pad_first else ("wheel", "pad"):
        pad = ("Microsoft X-Box 360 pad 0", STEAM_PAD)
        made[name] = plug(GAMEPAD, 6, 11, 0, *pad) if name == "pad" else plug(WHEEL, 4, 25, 0, "G29", G29)
    with made["pad"] as pad, made["wheel"] as wheel:
        inputs.pump()
        device = HumanDevice("wheel", inputs, known_profiles(Path("/nonexistent")))
        assert device.name == "wheel: Logitech G29 (046d:c24f)"
        wheel.axis(0, -0.2)
        wheel.axis(2, 1.0)
        device.poll()
        wheel.axis(2, -1.0)
        steer, throttle, _ = run(device, view(straight_route), 1.0)[-1]
        pad.axis(0, -1.0)
        pad.button(0, True)
        device.poll()
        assert not device.read(view(straight_route)).handbrake
        assert run(device, view(straight_route), 1.0)[-1] == pytest.approx((steer, throttle, 0.0), abs=1e-3)
    assert throttle == pytest.approx(1.0, abs=1e-3)
    assert steer == pytest.approx(wheel_steer(0.2, 900.0, VehicleParams()), abs=1e-3)


def test_of_several_devices_the_one_that_moves_steers(
    inputs: Inputs, straight_route: Route, plug: Plug, caplog: pytest.LogCaptureFixture
) -> None:
    """A shifter is no wheel because it was plugged in first; its gear holds a button down."""
    names = {"H Shifter": (0x16C0, 0x05E1), "Pedal Set Pro": PEDALS, "Base 15": (0x1FC9, 0x82A1)}
    shifter, feet, base = (plug(WHEEL, 8, 16, 0, name, usb) for name, usb in names.items())
    with shifter, feet, base:
        inputs.pump()
        device = HumanDevice("wheel", inputs, known_profiles(Path("/nonexistent")))
        question = "several devices may be the wheel (H Shifter, Base 15): turn the one that steers"
        assert device.message == question
        assert question in caplog.text
        shifter.button(0, True)
        assert run(device, view(straight_route), 0.1)[-1] == (0.0, 0.0, 0.0)
        for raw in (0.05, -0.3):
            base.axis(0, raw)
            device.poll()
        feet.axis(0, -1.0)
        device.poll()
        feet.axis(0, 1.0)
        steer, throttle, _ = run(device, view(straight_route), 1.0)[-1]
        assert steer == pytest.approx(wheel_steer(0.3, 900.0, VehicleParams()), abs=1e-3)
        assert throttle == pytest.approx(1.0, abs=1e-3)
        assert device.message is None
        assert not device.read(view(straight_route)).handbrake
        for raw in (0.05, -1.0):
            shifter.axis(0, raw)
            device.poll()
        assert run(device, view(straight_route), 1.0)[-1][0] == pytest.approx(steer, abs=1e-3)
        base.unplug()
        assert run(device, view(straight_route), 2.0)[-1][2] > 0.2, "the shifter, moved before, takes over"


def test_a_preferred_device_steers_at_once(inputs: Inputs, straight_route: Route, plug: Plug) -> None:
    first, second = (plug(WHEEL, 4, 9, 0, name, (1, k)) for k, name in enumerate(("One", "Two")))
    with first, second:
        inputs.pump()
        device = HumanDevice("wheel", inputs, known_profiles(Path("/nonexistent")), preferred="0001:0001")
        second.axis(0, -0.1)
        assert run(device, view(straight_route), 1.0)[-1][0] > 0.05


def test_a_pedal_that_was_never_at_rest_does_not_act(
    inputs: Inputs, straight_route: Route, plug: Plug
) -> None:
    """An axis of another scale rests in the middle of what the profile takes for the pedal's travel."""
    with plug() as stick:
        inputs.pump()
        device = HumanDevice("wheel", inputs, PROFILES)
        stick.axis(0, 0.1)
        for raw in (0.5, -0.5, 0.5, -0.5):
            stick.axis(2, raw)
            assert run(device, view(straight_route), 0.2)[-1][1] == 0.0
        assert "let go of the throttle" in (device.message or "")
        stick.axis(2, 0.95)
        device.poll()
        stick.axis(2, -0.5)
        assert run(device, view(straight_route), 1.0)[-1][1] == pytest.approx((0.75 - 0.03) / 0.95, abs=1e-2)


@pytest.mark.soak
def test_plugging_for_twenty_minutes(inputs: Inputs, straight_route: Route, plug: Plug) -> None:
    """In and out some thousand times, sticks moved by another thread meanwhile: nothing leaks or jumps."""
    device, stick = None, plug()
    inputs.pump()
    device = HumanDevice("wheel", inputs, PROFILES)
    end, plugged, rng, last = time.monotonic() + 1200.0, True, np.random.default_rng(1), (0.0, 0.0, 0.0)
    rounds = 0
    while time.monotonic() < end:
        rounds += 1
        if rng.random() < 0.3:
            if plugged:
                stick.unplug()
            else:
                stick = plug()
            plugged = not plugged
        elif plugged:
            stick.axis(int(rng.integers(4)), float(rng.uniform(-1, 1)))
        for row in run(device, view(straight_route, 8.0), 0.05):
            assert all(np.isfinite(row))
            assert abs(row[0] - last[0]) < 0.2
            last = row
        assert device.is_connected == plugged
        assert len(inputs.sticks) == int(plugged)
        time.sleep(0.02)
    assert rounds > 1000
    assert threading.active_count() < 8
