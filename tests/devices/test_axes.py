"""From raw axes to controls: the function, the laws and the shipped profiles."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carlaloc_env.core.clock import TICK_HZ, TICK_S
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.physics.params import VehicleParams
from recorder.devices.axis_shape import AxisShape, shape_axis
from recorder.devices.calibrate import find_axis, make_profile
from recorder.devices.control_shaping import (
    Filter,
    KeyPedals,
    KeySteering,
    steer_limit,
    wheel_steer,
)
from recorder.devices.profile import (
    DeviceProfile,
    known_profiles,
    match_profile,
    read_profile,
    save_profile,
)

PEDAL = AxisShape(axis=2, rest=1.0, full=-1.0, gamma=1.3)
WHEEL = AxisShape(axis=0, rest=0.1, full=-1.0, opposite=0.9, dead_zone=0.0, saturation=0.0)
PAD = AxisShape(axis=0, rest=0.0, full=-1.0, opposite=1.0, dead_zone=0.1, expo=0.5)


@pytest.mark.parametrize("shape", [PEDAL, WHEEL, PAD])
@given(a=st.floats(-1.2, 1.2), b=st.floats(-1.2, 1.2))
def test_axis_is_monotone_bounded_and_continuous(shape: AxisShape, a: float, b: float) -> None:
    low, high = (0.0 if shape.opposite is None else -1.0), 1.0
    ya, yb = shape_axis(a, shape), shape_axis(b, shape)
    assert low <= ya <= high
    assert (ya - yb) * (a - b) <= 1e-12 if shape.full < shape.rest else (ya - yb) * (a - b) >= -1e-12
    assert abs(ya - yb) <= 3.0 * abs(a - b) + 1e-9


@pytest.mark.parametrize(
    ("shape", "raw", "value"),
    [
        (PEDAL, 1.0, 0.0),
        (PEDAL, 0.96, 0.0),
        (PEDAL, -1.0, 1.0),
        (PEDAL, -0.97, 1.0),
        (PEDAL, 0.0, ((0.5 - 0.03) / 0.95) ** 1.3),
        (WHEEL, 0.1, 0.0),
        (WHEEL, -1.0, 1.0),
        (WHEEL, 0.9, -1.0),
        (WHEEL, 0.5, -0.5),
        (PAD, 0.09, 0.0),
        (PAD, 0.54, -(0.5 * 0.5 + 0.5 * 0.125)),
        (PAD, math.nan, 0.0),
    ],
)
def test_axis_values_by_hand(shape: AxisShape, raw: float, value: float) -> None:
    assert shape_axis(raw, shape) == pytest.approx(value, abs=1e-12)


@pytest.mark.parametrize(
    "values",
    [
        {"axis": -1, "rest": 0.0, "full": 1.0},
        {"axis": 0, "rest": 0.0, "full": 0.01},
        {"axis": 0, "rest": 0.0, "full": 1.0, "opposite": 0.5},
        {"axis": 0, "rest": 0.0, "full": 1.5},
        {"axis": 0, "rest": 0.0, "full": 1.0, "dead_zone": 0.6},
    ],
)
def test_impossible_axes_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ConfigError):
        AxisShape(**values)  # type: ignore[arg-type]


def test_filter_follows_the_closed_form() -> None:
    """x(t) = 1 − (1 + ω t) e^(−ω t) for a unit step."""
    omega = 9.0
    smooth = Filter(omega)
    for k in range(1, TICK_HZ):
        t = k * TICK_S
        assert smooth.update(1.0) == pytest.approx(1.0 - (1.0 + omega * t) * math.exp(-omega * t), abs=1e-12)


@pytest.mark.parametrize(("kmh", "degrees"), [(30.0, 10.0), (50.0, 4.0), (80.0, 1.95), (100.0, 1.5)])
def test_key_steering_is_limited_by_lateral_acceleration(kmh: float, degrees: float) -> None:
    params = VehicleParams()
    angle = math.degrees(steer_limit(kmh / 3.6, params) * params.steer_max_rad)
    assert angle == pytest.approx(degrees, rel=0.12)


def test_keys_turn_in_the_time_promised_and_never_jump() -> None:
    keys, steer = KeySteering(VehicleParams()), []
    for k in range(4 * TICK_HZ):
        t = k * TICK_S
        steer.append(keys.update(t < 1.5, 2.0 <= t < 3.0, 0.0))
    trace = np.array(steer)
    assert trace[: round(1.5 * TICK_HZ)].max() == pytest.approx(1.0, abs=0.01)
    assert trace[round(0.7 * TICK_HZ)] == pytest.approx(1.0 - 2.0 / (9.0 * 0.7), abs=0.05)
    assert np.abs(np.diff(trace)).max() < 1.6 * TICK_S / 0.7
    assert np.abs(np.diff(trace, n=2)).max() < 2.0 * 9.0 / 0.7 * TICK_S * TICK_S * 1.5
    assert trace[round(2.9 * TICK_HZ)] < -0.9


def test_brake_key_goes_to_full_only_when_held() -> None:
    pedals, trace = KeyPedals(), []
    for _ in range(2 * TICK_HZ):
        trace.append(pedals.update(forward=True, back=True))
    brake = np.array(trace)[:, 1]
    assert brake[round(0.95 * TICK_HZ)] == pytest.approx(0.6, abs=0.01)
    assert brake[-1] == pytest.approx(1.0, abs=0.02)
    assert np.array(trace)[:, 0].max() == 0.0


def test_wheel_angles_are_real() -> None:
    """A quarter turn of the wheel is 90° / 12 at the road wheels."""
    params = VehicleParams()
    steer = wheel_steer(90.0 / 450.0, 900.0, params)
    assert math.degrees(steer * params.steer_max_rad) == pytest.approx(90.0 / params.steering_ratio)
    assert wheel_steer(1.0, 2000.0, params) == 1.0


def test_shipped_profiles_name_the_common_wheels(tmp_path: Path) -> None:
    profiles = known_profiles(tmp_path)
    for usb, name in (
        ("046d:c24f", "G29"),
        ("046d:c262", "G920"),
        ("046d:c26e", "G923"),
        ("044f:b66e", "T300"),
        ("0eb7:0e03", "Fanatec"),
    ):
        found = match_profile(usb, "whatever", profiles)
        assert found is not None
        assert name in found.name
    pad = match_profile("045e:028e", "Xbox 360 Controller", profiles)
    assert pad is not None
    assert pad.kind == "gamepad"
    wheel = match_profile("1234:5678", "Strange Racing Thing", profiles, ("wheel",))
    assert wheel is not None
    assert wheel.kind == "wheel"


def test_calibrated_profile_goes_first_and_comes_back_equal(tmp_path: Path) -> None:
    profile = make_profile(
        "My Rig",
        "wheel",
        "046d:c24f",
        left=(1, 0.02, -0.98),
        right=(1, 0.02, 0.99),
        throttle=(0, -1.0, 1.0),
        brake=(0, -1.0, -0.2),
        model=None,
    )
    path = save_profile(profile, tmp_path)
    assert read_profile(path.read_text(), "x") == profile
    assert match_profile("046d:c24f", "", known_profiles(tmp_path)) == profile


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name: x\nkind: wheel\n", "without a steer"),
        ("name: x\nkind: plane\n", "choose from"),
        ("name: x\nkind: pedals\nbuttons: {revers: 1}\n", "did you mean 'reverse'"),
        ("name: x\nkind: pedals\nsteeer: 1\n", "did you mean 'steer'"),
        ("a: [", "no YAML"),
    ],
)
def test_bad_profiles_are_named(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_profile(text, "mine.yaml")


def test_calibration_finds_the_axis_that_moved() -> None:
    rest = [0.0, 1.0, 1.0, 0.1]
    assert find_axis(rest, [[-0.2, 1.0, 1.0, 0.1], [-0.95, 0.99, 1.0, 0.12]]) == (0, -0.95)
    assert find_axis(rest, [[0.1, 1.0, -1.0, 0.1]]) == (2, -1.0)
    assert find_axis(rest, [[0.1, 0.9, 0.9, 0.0]]) is None
    # Combined pedals: the brake moves the throttle's axis the other way.
    assert find_axis([0.0, 0.0], [[0.0, -1.0]], taken=(1,)) == (1, -1.0)


def test_profile_without_pedals_drives_nothing_by_itself() -> None:
    profile = DeviceProfile(name="p", kind="pedals", throttle=PEDAL)
    assert profile.axes == (PEDAL,)
