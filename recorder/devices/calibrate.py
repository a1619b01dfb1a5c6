"""Calibrates a device: asks a person to turn and press its controls, and writes its profile."""

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from carlaloc_env.core.errors import DeviceError
from recorder.devices.axis_shape import AxisShape
from recorder.devices.inputs import Inputs, Stick
from recorder.devices.profile import (
    DeviceProfile,
    known_profiles,
    match_profile,
    save_profile,
)

Ask = Callable[[str], None]
"""Shows a line to the person."""
AxisFound = tuple[int, float, float]
"""Axis, its raw value at rest, and at the end of its travel."""

_TRAVEL_MIN = 0.4
_HOLD_S = 0.6
_TIMEOUT_S = 30.0
_POLL_S = 0.01


def find_axis(
    before: Sequence[float], samples: Sequence[Sequence[float]], taken: Sequence[int] = ()
) -> tuple[int, float] | None:
    """Axis that a person moved, and the farthest value it reached.

    Args:
        before: Raw value of every axis at rest.
        samples: Raw values while the person moved one control, in order.
        taken: Axes that have a meaning already; they are chosen only if nothing else moved.

    Returns:
        Number of the axis and its end value; None if nothing has moved far enough.
    """
    best: tuple[float, int, float] | None = None
    for axis, rest in enumerate(before):
        values = [sample[axis] for sample in samples if axis < len(sample)]
        if not values:
            continue
        end = max(values, key=lambda value: abs(value - rest))
        reach = abs(end - rest) * (0.5 if axis in taken else 1.0)
        if abs(end - rest) >= _TRAVEL_MIN and (best is None or reach > best[0]):
            best = (reach, axis, end)
    return None if best is None else (best[1], best[2])


def make_profile(
    name: str,
    kind: str,
    usb: str,
    *,
    left: AxisFound | None,
    right: AxisFound | None,
    throttle: AxisFound | int | None,
    brake: AxisFound | int | None,
    model: DeviceProfile | None,
) -> DeviceProfile:
    """Profile of a device from its steering axis and its pedals, which are axes or buttons.

    Raises:
        DeviceError: left and right were found on two axes.
    """
    steer = None
    if left is not None and right is not None:
        if left[0] != right[0]:
            raise DeviceError(
                f"left moved axis {left[0]}, right axis {right[0]}; calibrate again, one control at a time"
            )
        expo = 0.5 if kind == "gamepad" else 0.0
        steer = AxisShape(
            axis=left[0],
            rest=0.5 * (left[1] + right[1]),
            full=left[2],
            opposite=right[2],
            dead_zone=0.1 if kind == "gamepad" else 0.0,
            saturation=0.02 if kind == "gamepad" else 0.0,
            expo=expo,
        )
    buttons = dict(model.buttons) if model is not None else {}
    for command, pedal in (("throttle", throttle), ("brake", brake)):
        # One button does one thing, and a pedal is what was found now.
        buttons = {key: button for key, button in buttons.items() if key != command and button != pedal}
        if isinstance(pedal, int):
            buttons[command] = pedal
    return DeviceProfile(
        name=name,
        kind=kind,
        usb=(usb,),
        rotation_deg=model.rotation_deg if model is not None else 900.0,
        steer=steer,
        throttle=_pedal(throttle),
        brake=_pedal(brake),
        buttons=buttons,
        calibrated=True,
    )


def _pedal(pedal: AxisFound | int | None) -> AxisShape | None:
    return AxisShape(axis=pedal[0], rest=pedal[1], full=pedal[2]) if isinstance(pedal, tuple) else None


def calibrate(kind: str, *, ask: Ask, inputs: Inputs | None = None, folder: Path | None = None) -> Path:
    """Ask the person to turn and press each control, and save the profile.

    Args:
        kind: ``wheel`` or ``gamepad``.
        ask: Shows what to do.
        inputs: Where events come from; opened when left out.
        folder: Where profiles are kept.

    Raises:
        DeviceError: nothing is connected, or nothing moved for half a minute.
    """
    if kind not in ("wheel", "gamepad"):
        raise DeviceError(f"nothing to calibrate on '{kind}'; add --device wheel or --device gamepad")
    source = inputs or Inputs(window=False)
    try:
        stick = _choose(source, ask)
        if not stick.raw:
            raise DeviceError(f"{stick.name} ({stick.usb}) has no axis to steer with; plug in another device")
        model = match_profile(stick.usb, stick.name, known_profiles(folder), (kind,), len(stick.raw))
        ask(f"{stick.name} ({stick.usb}): let go of everything, the wheel in the middle.")
        rest = _rest(source, stick)
        left = _find_axis(source, stick, rest, "Turn fully LEFT and hold.", ask)
        _wait_for_rest(source, stick, rest, ask)
        right = _find_axis(source, stick, rest, "Turn fully RIGHT and hold.", ask)
        _wait_for_rest(source, stick, rest, ask)
        taken: tuple[int, ...] = (left[0],)
        throttle = _find(source, stick, rest, "Press the THROTTLE fully and hold.", ask, taken)
        _wait_for_rest(source, stick, rest, ask)
        taken = (*taken, throttle[0]) if isinstance(throttle, tuple) else taken
        brake = _find(source, stick, rest, "Press the BRAKE fully and hold.", ask, taken)
        profile = make_profile(
            stick.name, kind, stick.usb, left=left, right=right, throttle=throttle, brake=brake, model=model
        )
        return save_profile(profile, folder)
    finally:
        if inputs is None:
            source.close()


def _polls(source: Inputs, limit_s: float) -> Iterator[None]:
    """Poll the devices every few milliseconds, for some time [s]."""
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        source.pump()
        yield
        time.sleep(_POLL_S)


def _choose(source: Inputs, ask: Ask) -> Stick:
    sticks = list(source)
    if not sticks:
        raise DeviceError("no wheel or pad is connected; plug one in and calibrate again")
    if len(sticks) == 1:
        return sticks[0]
    ask(f"{len(sticks)} devices are connected: press a button of the one to calibrate, or turn it.")
    for stick in sticks:
        stick.seen.clear()
    for _ in _polls(source, _TIMEOUT_S):
        for press in source.presses:
            if press.stick is not None:
                return press.stick
        for stick in source:
            if any(map(stick.was_moved, range(len(stick.raw)))):
                return stick
    raise DeviceError("nothing was pressed or turned; calibrate again")


def _rest(source: Inputs, stick: Stick) -> list[float]:
    """Raw values after two seconds in which nothing has to happen."""
    for _ in _polls(source, 2.0):
        pass
    return list(stick.raw)


def _find_axis(source: Inputs, stick: Stick, rest: Sequence[float], line: str, ask: Ask) -> AxisFound:
    axis_or_button = _find(source, stick, rest, line, ask, ())
    if isinstance(axis_or_button, int):
        raise DeviceError(f"button {axis_or_button} was pressed, but only an axis steers; calibrate again")
    return axis_or_button


def _find(
    source: Inputs, stick: Stick, rest: Sequence[float], line: str, ask: Ask, taken: Sequence[int]
) -> AxisFound | int:
    """The axis that moves now, or the button that is held while no axis but those taken does."""
    ask(line)
    pressed: int | None = None
    samples: list[list[float]] = []
    still_since, last = time.monotonic(), list(stick.raw)
    for _ in _polls(source, _TIMEOUT_S):
        presses = [press.button for press in source.presses if press.stick is stick]
        if presses or max(abs(a - b) for a, b in zip(stick.raw, last, strict=True)) > 0.02:
            still_since, last = time.monotonic(), list(stick.raw)
            pressed = presses[-1] if presses else pressed
        samples.append(list(stick.raw))
        moving_axis = find_axis(rest, samples, taken)
        if time.monotonic() - still_since > _HOLD_S:
            # Triggers may press a button on their way; the axis is worth more.
            if moving_axis is not None:
                return moving_axis[0], rest[moving_axis[0]], moving_axis[1]
            if pressed is not None:
                return pressed
    raise DeviceError("nothing has moved for 30 s; check the plug and calibrate again")


def _wait_for_rest(source: Inputs, stick: Stick, rest: Sequence[float], ask: Ask) -> None:
    ask("Good. Let go.")
    for _ in _polls(source, _TIMEOUT_S):
        if all(abs(a - b) < 0.3 for a, b in zip(stick.raw, rest, strict=True)):
            return
