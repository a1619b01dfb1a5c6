"""A person at the wheel: raw input of wheels, pedals, pads and keys becomes controls at 200 Hz."""

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import DeviceError
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.physics.params import VehicleParams
from recorder.devices.axis_shape import AxisShape, shape_axis
from recorder.devices.base import Command
from recorder.devices.control_shaping import (
    PEDAL_OMEGA,
    STICK_OMEGA,
    WHEEL_OMEGA,
    Filter,
    KeyPedals,
    KeySteering,
    steer_limit,
    wheel_steer,
)
from recorder.devices.inputs import Inputs, Press
from recorder.devices.keys import KEY_COMMANDS, held_pedals
from recorder.devices.profile import BY_KIND, DeviceProfile, fit_of
from recorder.devices.stick_roles import StickRoles, rested

_LOG = logging.getLogger(__name__)
_REVERSE_BELOW_MPS = 1.5
_LOST_BRAKE, _LOST_RAMP_S, _LOST_STRAIGHTEN_S = 0.3, 1.0, 1.5


class HumanDevice:
    """Device of a person: wheel, pad or keyboard, which may be plugged in and out during the drive.

    `StickRoles` decides which stick does what; a pedal acts after it was seen at rest. While nothing that
    drives is connected, the car coasts, brakes gently and straightens.
    """

    def __init__(
        self,
        kind: str,
        inputs: Inputs,
        profiles: Sequence[DeviceProfile],
        params: VehicleParams | None = None,
        preferred: str | None = None,
    ) -> None:
        """Look for devices.

        Args:
            kind: ``wheel``, ``gamepad`` or ``keyboard``.
            inputs: Where events come from.
            profiles: What devices are known, in order of preference.
            params: The car.
            preferred: USB id of the device that steers, where several could.

        Raises:
            DeviceError: no such device is connected.
        """
        self._kind = kind
        self.inputs = inputs
        self._roles = StickRoles(kind, profiles, inputs, preferred)
        self._params = params if params is not None else VehicleParams()
        self.begin()
        self.plugged: list[tuple[str, str]] = []
        self._has_driven = False
        if kind != "keyboard" and not self.is_connected:
            there = "".join(f"; {stick.name} ({stick.usb}) has no axis to steer with" for stick in inputs)
            raise DeviceError(
                f"no {kind} is connected{there}; plug one in, or choose --device keyboard or scripted"
            )
        if (fault := self._fault()) is not None:
            raise DeviceError(fault)
        if (note := self._roles.question or self._guess()) is not None:
            _LOG.warning(note)

    def begin(self, *, reverse: bool = False) -> None:
        """Begin a drive, or a new attempt at it, with hands and feet off.

        Args:
            reverse: Whether the reverse gear is engaged.
        """
        self._key_steering, self._key_pedals = KeySteering(self._params), KeyPedals()
        self._steer = Filter(WHEEL_OMEGA if self._kind == "wheel" else STICK_OMEGA)
        self._pedals = Filter(PEDAL_OMEGA), Filter(PEDAL_OMEGA)
        self._reverse = reverse
        self._lost_s = self._lost_steer = 0.0
        self.raw = Controls()
        self.commands: list[Command] = []

    @property
    def name(self) -> str:
        """Kind and names of the devices, as recorded in the episode."""
        driven = self._roles.sticks if self._roles.question else self._roles.in_use
        names = ", ".join(f"{profile.name} ({stick.usb})" for stick, profile in driven)
        return f"{self._kind}: {names}" if names else self._kind

    @property
    def buttons(self) -> dict[str, int]:
        """Button of each command on what is connected."""
        return {name: number for _, profile in self._roles.in_use for name, number in profile.buttons.items()}

    @property
    def is_connected(self) -> bool:
        """Whether anything that steers is there."""
        return self._kind == "keyboard" or bool(self._roles.question or self._roles.of("steer"))

    @property
    def message(self) -> str | None:
        """A message about the devices for the driver, None when all is well."""
        if not self.is_connected:
            return f"{self._kind.upper()} UNPLUGGED: braking; plug it in again"
        if self._roles.question:
            return self._roles.question
        if self._kind != "keyboard" and self._travel("steer") is None:
            return f"turn the {self._kind} a little so that its position is known"
        return self._fault() or self._pressed_from_the_start() or self._guess()

    def poll(self) -> None:
        """Take in events; once per image."""
        self.inputs.pump()
        self.plugged = self._roles.update(self.inputs.lost, self.inputs.gained)
        self.commands = [c for press in self.inputs.presses if (c := self._command(press)) is not None]

    def read(self, view: DriverView) -> Controls:
        """Controls for the coming tick."""
        if Command.REVERSE in self.commands and abs(view.speed_mps) < _REVERSE_BELOW_MPS:
            self._reverse = not self._reverse
        self.commands = [command for command in self.commands if command is not Command.REVERSE]
        if not self.is_connected:
            return self._without_hands()
        self._lost_s = 0.0
        if self._kind == "keyboard":
            shaped = self._read_keys(view.speed_mps)
        else:
            shaped = self._read_sticks(view.speed_mps)
        # The driver has found the pedals.
        self._has_driven |= shaped.throttle > 0.5
        return replace(shaped, reverse=self._reverse)

    def close(self) -> None:
        """Let the devices go; may be called twice."""
        self.inputs.close()

    def _read_keys(self, speed_mps: float) -> Controls:
        left, right, forward, back, handbrake = held_pedals(self.inputs.keys)
        self.raw = Controls(
            steer=float(left - right), throttle=float(forward), brake=float(back), handbrake=handbrake
        )
        steer = self._key_steering.update(left, right, speed_mps)
        throttle, brake = self._key_pedals.update(forward, back)
        return Controls(steer=_clip(steer), throttle=throttle, brake=brake, handbrake=handbrake)

    def _read_sticks(self, speed_mps: float) -> Controls:
        turned = self._travel("steer") or 0.0
        throttle, brake = self._pedal("throttle"), self._pedal("brake")
        pressed = self._held(Command.THROTTLE), self._held(Command.BRAKE)
        by_button = self._key_pedals.update(*pressed)
        handbrake = self._held(Command.HANDBRAKE) or self._pedal("handbrake") > 0.5
        self.raw = Controls(
            steer=turned,
            throttle=max(throttle, float(pressed[0])),
            brake=max(brake, float(pressed[1])),
            reverse=self._reverse,
            handbrake=handbrake,
        )
        if self._kind == "wheel":
            driven = self._roles.of("steer")
            rotation = driven[1].rotation_deg if driven is not None else 900.0
            target = wheel_steer(turned, rotation, self._params)
        else:
            target = turned * steer_limit(speed_mps, self._params)
        return Controls(
            steer=_clip(self._steer.update(target)),
            throttle=max(by_button[0], _clip(self._pedals[0].update(throttle))),
            brake=max(by_button[1], _clip(self._pedals[1].update(brake))),
            handbrake=handbrake,
        )

    def _without_hands(self) -> Controls:
        if self._lost_s == 0.0:
            self._lost_steer = self._steer.value
        self._lost_s += TICK_S
        brake = _LOST_BRAKE * min(1.0, self._lost_s / _LOST_RAMP_S)
        self.raw = Controls()
        straight = self._lost_steer * math.exp(-self._lost_s / _LOST_STRAIGHTEN_S)
        return Controls(
            steer=_clip(self._steer.update(straight)),
            throttle=max(0.0, _clip(self._pedals[0].update(0.0))),
            brake=max(0.0, _clip(self._pedals[1].update(brake))),
            reverse=self._reverse,
        )

    def _guess(self) -> str | None:
        """Message about a stick whose profile is a guess, until the car has been driven."""
        for stick, profile in () if self._has_driven else self._roles.in_use:
            if fit_of(stick.usb, stick.name, profile) >= BY_KIND:
                return (
                    f"{stick.name} ({stick.usb}) is read as '{profile.name}'; if that is wrong: "
                    f"{self._calibrate}"
                )
        return None

    def _pressed_from_the_start(self) -> str | None:
        """Message about a pedal that has never been at rest, and therefore does not act."""
        for role in ("throttle", "brake"):
            driven = self._roles.of(role)
            if driven is None or rested(*driven, role):
                continue
            if (self._travel(role) or 0.0) > 0.0:
                return f"let go of the {role} of {driven[0].name}; if nothing presses it: {self._calibrate}"
        return None

    @property
    def _calibrate(self) -> str:
        return f"carlaloc record --device {self._kind} --calibrate"

    def _fault(self) -> str | None:
        """Message about a missing control of the sticks, with a remedy; None when they can drive."""
        if self._kind == "keyboard" or self._roles.question:
            return None
        for role in ("steer", "throttle", "brake"):
            buttons = (profile.buttons for _, profile in self._roles.sticks)
            if self._roles.of(role) is not None or any(role in pressed for pressed in buttons):
                continue
            for stick, profile in self._roles.sticks:
                shape = getattr(profile, role)
                if shape is not None:
                    return (
                        f"{stick.name} ({stick.usb}) has {len(stick.raw)} axes, but '{profile.name}' reads "
                        f"the {role} from axis {shape.axis}, counted from 0; run: {self._calibrate}"
                    )
            return f"no connected device has a {role}; plug it in, or run: {self._calibrate}"
        return None

    def _travel(self, role: str) -> float | None:
        """Shaped travel of a control; None where it is missing or its position is not known."""
        driven = self._roles.of(role)
        if driven is None:
            return None
        shape: AxisShape = getattr(driven[1], role)
        raw = driven[0].axis(shape.axis)
        return None if raw is None else shape_axis(raw, shape)

    def _pedal(self, role: str) -> float:
        driven = self._roles.of(role)
        if driven is None or not rested(*driven, role):
            return 0.0
        return max(0.0, self._travel(role) or 0.0)

    def _held(self, command: Command) -> bool:
        driven = self._roles.in_use
        return any(profile.buttons.get(command.value, -1) in stick.buttons for stick, profile in driven)

    def _command(self, press: Press) -> Command | None:
        if press.key is not None:
            return KEY_COMMANDS.get(press.key)
        for stick, profile in self._roles.in_use:
            if stick is press.stick:
                names = {number: name for name, number in profile.buttons.items()}
                return Command.by_name(names[press.button]) if press.button in names else None
        return None


def _clip(value: float) -> float:
    return min(1.0, max(-1.0, value))
