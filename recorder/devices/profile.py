"""Profiles of wheels, pedals and gamepads: YAML files that name each axis and button.

From a raw axis of a wheel, pedal or stick to a value: data and one function.
"""

import math
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from carlaloc_env.core.errors import ConfigError, DeviceError, OutputError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.config_files import from_mapping, to_mapping
from carlaloc_env.core.files.output_paths import user_folder
from carlaloc_env.core.files.text_files import read_text
from recorder.devices.base import Command
from recorder.devices.inputs import Stick


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisShape:
    """How one axis is read; raw values run from −1 to 1, as SDL gives them."""

    axis: int
    """Number of the axis."""
    rest: float
    """Raw value of an axis that is not touched."""
    full: float
    """Raw value that counts as +1: pedal down, or wheel fully to the left."""
    opposite: float | None = None
    """Raw value that counts as −1 (wheel fully to the right); None: the axis is a pedal."""
    dead_zone: float = 0.03
    """Fraction of the travel next to rest that gives 0; the rest is stretched to meet it."""
    saturation: float = 0.02
    """Fraction of the travel at the end that gives 1 already."""
    gamma: float = 1.0
    """Exponent of the travel: 1 is linear, more is gentler at first."""
    expo: float = 0.0
    """Fraction k of a cubic, y = (1 − k) x + k x³: 0 is linear, 1 gentlest about the middle."""

    def __post_init__(self) -> None:
        ends = (self.full,) if self.opposite is None else (self.full, self.opposite)
        if self.axis < 0:
            raise ConfigError(f"axis {self.axis}; axes are counted from 0")
        if any(not -1.0 <= value <= 1.0 for value in (self.rest, *ends)):
            raise ConfigError(f"axis {self.axis}: raw values lie between -1 and 1")
        if any(abs(end - self.rest) < 0.05 for end in ends):
            raise ConfigError(f"axis {self.axis}: rest {self.rest:g} and its end are too close; calibrate")
        if self.opposite is not None and (self.full - self.rest) * (self.opposite - self.rest) > 0.0:
            raise ConfigError(f"axis {self.axis}: both ends lie on one side of rest; calibrate")
        if not (0.0 <= self.dead_zone < 0.5 and 0.0 <= self.saturation < 0.5):
            raise ConfigError(f"axis {self.axis}: dead_zone and saturation lie between 0 and 0.5")
        if not (0.2 <= self.gamma <= 5.0 and 0.0 <= self.expo <= 1.0):
            raise ConfigError(f"axis {self.axis}: gamma lies between 0.2 and 5, expo between 0 and 1")


def shape_axis(raw: float, shape: AxisShape) -> float:
    """Value of an axis: 0…1 for a pedal, −1…1 for a wheel; monotone, 0 at rest, ±1 at the ends.

    A raw value that is not finite counts as rest.
    """
    if not math.isfinite(raw):
        return 0.0
    away = raw - shape.rest
    positive = away * (shape.full - shape.rest) >= 0.0
    if not positive and shape.opposite is None:
        return 0.0
    end = shape.full if positive or shape.opposite is None else shape.opposite
    travel = away / (end - shape.rest)
    usable = 1.0 - shape.dead_zone - shape.saturation
    x = min(1.0, max(0.0, (travel - shape.dead_zone) / usable))
    x = math.pow(x, shape.gamma)
    y = (1.0 - shape.expo) * x + shape.expo * x * x * x
    return y if positive else -y


KINDS = ("wheel", "pedals", "gamepad")


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceProfile:
    """What the axes and buttons of one device do."""

    name: str
    """Name for people, e.g. ``Logitech G29``."""
    kind: str
    """``wheel``, ``pedals`` or ``gamepad``."""
    usb: tuple[str, ...] = ()
    """USB ids ``vendor:product`` in lower-case hexadecimal; empty: any device of the kind."""
    axis_count: int | None = None
    """Number of axes of the devices that it is for, where it names no USB ids; None: any."""
    platform: str | None = None
    """``linux``, ``win32`` or ``darwin`` where numbering differs; None: all."""
    rotation_deg: float = 900.0
    """How far a wheel turns from end to end [deg]."""
    steer: AxisShape | None = None
    """Steering, left positive; None on pedals."""
    throttle: AxisShape | None = None
    """Throttle pedal or trigger."""
    brake: AxisShape | None = None
    """Brake pedal or trigger."""
    handbrake: AxisShape | None = None
    """Handbrake lever with an axis of its own, pulled beyond a half."""
    buttons: Mapping[str, int] = field(default_factory=dict)
    """Button number of each command, e.g. ``reverse: 5``."""
    calibrated: bool = False
    """Whether a person has turned and pressed everything; shipped profiles are suggestions."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigError(f"kind '{self.kind}'; choose from {', '.join(KINDS)}")
        if self.kind != "pedals" and self.steer is None:
            raise ConfigError(f"'{self.name}' is a {self.kind} without a steer axis")
        if not 90.0 <= self.rotation_deg <= 3600.0:
            raise ConfigError(f"rotation_deg {self.rotation_deg:g} lies outside 90 to 3600")
        for command in self.buttons:
            Command.by_name(command)

    def misses(self, axis_count: int) -> bool:
        """Whether it reads an axis that a device of so many does not have."""
        return any(shape.axis >= axis_count for shape in self.axes)

    @property
    def is_generic(self) -> bool:
        """Whether it is a guess for any device of its kind."""
        return not self.usb and not self.calibrated

    @property
    def axes(self) -> tuple[AxisShape, ...]:
        """All axes that are read."""
        known = (self.steer, self.throttle, self.brake, self.handbrake)
        return tuple(shape for shape in known if shape is not None)


def profile_folder() -> Path:
    """Folder of the profiles that calibration writes.

    Raises:
        OutputError: there is no home folder.
    """
    return user_folder("XDG_CONFIG_HOME", "~/.config") / "carlaloc" / "devices"


def read_profile(text: str, where: str) -> DeviceProfile:
    """Profile of a YAML text.

    Raises:
        ConfigError: the text is no YAML, or a key or value is wrong.
    """
    try:
        mapping = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"{where}: no YAML ({' '.join(str(error).split())})") from error
    return from_mapping(DeviceProfile, mapping, where)


def save_profile(profile: DeviceProfile, folder: Path | None = None) -> Path:
    """Write a profile so that the next drive finds it.

    Raises:
        DeviceError: the folder cannot be written.
    """
    folder = folder or profile_folder()
    stem = "".join(c if c.isalnum() else "_" for c in profile.name.lower()).strip("_") or "device"
    path = folder / f"{stem}.yaml"
    values: dict[str, Any] = {k: v for k, v in to_mapping(profile).items() if v not in (None, [], {})}
    with atomic_write(path, DeviceError, "set XDG_CONFIG_HOME") as part:
        part.write_text(yaml.safe_dump(values, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return path


def known_profiles(folder: Path | None = None) -> list[DeviceProfile]:
    """Calibrated profiles first, then the shipped ones; those for other systems are left out.

    Raises:
        ConfigError: a file is not a profile.
    """
    with suppress(OutputError):
        folder = folder or profile_folder()
    found = []
    for path in sorted(folder.glob("*.yaml")) if folder and os.access(folder, os.R_OK) else []:
        found.append(read_profile(read_text(path, "device profile"), str(path)))
    shipped = files("recorder.devices") / "profiles"
    for entry in sorted(shipped.iterdir(), key=lambda item: item.name):
        if entry.name.endswith(".yaml"):
            found.append(read_profile(entry.read_text(encoding="utf-8"), entry.name))
    return [profile for profile in found if profile.platform in (None, sys.platform)]


def match_profile(
    usb: str, name: str, profiles: list[DeviceProfile], kinds: tuple[str, ...] = KINDS, axis_count: int = 64
) -> DeviceProfile | None:
    """Profile of a device: by USB id, then by name, then a generic one of a fitting kind.

    Of generic ones those for this number of axes go first, then those that find all their axes, then those
    that find one; None where there is none.

    Args:
        usb: ``vendor:product``.
        name: What the device calls itself.
        profiles: Candidates in order of preference.
        kinds: Kinds that are wanted.
        axis_count: Number of axes of the device.
    """
    found = [
        (fit, fit >= BY_KIND and profile.misses(axis_count), profile)
        for profile in profiles
        if profile.kind in kinds
        and ((fit := fit_of(usb, name, profile)) < BY_KIND or _reads_some(profile, axis_count))
    ]
    best = min(found, key=lambda item: (*item[:2], item[2].axis_count is None), default=None)
    return None if best is None else best[2]


def _reads_some(profile: DeviceProfile, axis_count: int) -> bool:
    first = profile.steer or profile.throttle
    fits = profile.is_generic and profile.axis_count in (None, axis_count)
    return fits and first is not None and first.axis < axis_count


BY_USB, BY_NAME, BY_KIND, BY_GUESS = range(4)
"""How surely a profile is a device's: by its USB id, its name, the kind that its name shows, or a guess."""


def fit_of(usb: str, name: str, profile: DeviceProfile) -> int:
    """How surely a profile is a device's: `BY_USB` … `BY_GUESS`."""
    if usb in profile.usb:
        return BY_USB
    looks = name.lower()
    if profile.name.lower() == looks:
        return BY_NAME
    if "pedal" in looks:
        kind = "pedals"
    elif any(word in looks for word in ("pad", "xbox", "x-box", "controller", "dualshock", "dualsense")):
        kind = "gamepad"
    else:
        kind = "wheel"
    return BY_KIND if profile.kind == kind else BY_GUESS


Driven: TypeAlias = tuple[Stick, DeviceProfile]
"""A stick and its profile."""
_KINDS_OF = {"wheel": ("wheel", "pedals"), "gamepad": ("gamepad",)}
"""Kinds of profiles by device."""
_AT_REST = 0.1
"""Part of its travel within which a pedal is at rest."""


def rested(stick: Stick, profile: DeviceProfile, role: str) -> bool:
    """Whether the pedal of a role was seen at rest."""
    shape: AxisShape = getattr(profile, role)
    return stick.was_near(shape.axis, shape.rest, _AT_REST * abs(shape.full - shape.rest))


class StickRoles:
    """Which of the connected sticks steers, and which has the pedals.

    The stick steers whose profile fits best, by its USB id above all; of several the one that is moved first.
    Separate pedals go before those of the wheel, guessed ones as soon as they are moved.

    Args:
        device: ``wheel``, ``gamepad`` or ``keyboard``.
        profiles: Known profiles in order of preference.
        sticks: Those that are connected.
        preferred: USB id of the stick that steers, where several could.
    """

    def __init__(
        self, device: str, profiles: Sequence[DeviceProfile], sticks: Iterable[Stick],
        preferred: str | None = None,
    ) -> None:  # fmt: skip
        self._device, self._profiles, self._preferred = device, list(profiles), preferred
        self._steerer: Stick | None = None
        self._may_steer: list[Driven] = []
        self.sticks: list[Driven] = []
        """All sticks that fit, with their profiles."""
        self.in_use: list[Driven] = []
        """Those that steer or have pedals, and those that are known, whose buttons count."""
        self.question = ""
        """Asks for the stick that steers; empty: it is known."""
        self.update((), sticks)

    def update(self, lost: Iterable[Stick], gained: Iterable[Stick]) -> list[tuple[str, str]]:
        """Decide anew, after sticks were moved, pulled out or plugged in; what became of those that fit."""
        plugged = [("device_lost", stick.name) for stick in lost if self._lose(stick)]
        plugged += [("device_back", stick.name) for stick in gained if self._take(stick)]
        self._assign()
        return plugged

    def _take(self, stick: Stick) -> bool:
        """Use a stick if a profile fits; False otherwise."""
        kinds = _KINDS_OF.get(self._device, ())
        profile = match_profile(stick.usb, stick.name, self._profiles, kinds, len(stick.raw))
        if profile is None:
            return False
        for shape in profile.axes:
            if shape.axis < len(stick.raw) and abs(stick.raw[shape.axis] - shape.rest) < 0.02:
                # The calibrated rest value is as good as a movement.
                stick.known[shape.axis] |= abs(shape.rest) > 0.5
        self.sticks.append((stick, profile))
        lost = self._steerer if all(known is not self._steerer for known, _ in self.sticks) else None
        if stick.usb in (self._preferred, lost and lost.usb):
            self._steerer, self._preferred = stick, None
        return True

    def _lose(self, stick: Stick) -> bool:
        """Forget a stick; False: it was not used."""
        left = [(known, profile) for known, profile in self.sticks if known is not stick]
        was_used = len(left) < len(self.sticks)
        self.sticks = left
        for other, _ in left if stick is self._steerer else ():
            # It was moved while the lost one steered, and steers only if it is moved again.
            other.seen.clear()
        return was_used

    def choose(self, stick: Stick) -> None:
        """Let a stick steer, if it may."""
        if any(able is stick for able, _ in self._may_steer):
            self._steerer = stick
        self._assign()

    def _assign(self) -> None:
        able = [(s, p) for s, p in self.sticks if p.steer is not None and p.steer.axis < len(s.raw)]
        best = min(map(_fit, able), default=BY_USB)
        self._may_steer = [item for item in able if _fit(item) == best]
        if all(stick is not self._steerer for stick, _ in self._may_steer):
            moved = [s for s, p in self._may_steer if p.steer is not None and s.was_moved(p.steer.axis)]
            self._steerer = moved[0] if moved else self._steerer
        self.question = ""
        if self._steerer is None and len(self._may_steer) > 1:
            names = ", ".join(stick.name for stick, _ in self._may_steer)
            self.question = f"several devices may be the {self._device} ({names}): turn the one that steers"
        used = [self.of(role) for role in ("steer", "throttle", "brake")]
        self.in_use = [item for item in self.sticks if _fit(item) < BY_KIND or item in used]

    def of(self, role: str) -> Driven | None:
        """Stick that has the axis of a role; None: there is none, it is asked for, or it is gone."""
        steering = next((item for item in self._may_steer if item[0] is self._steerer), None)
        if self._steerer is None and self._may_steer and not self.question:
            steering = self._may_steer[0]
        if role == "steer":
            return steering
        having = [
            item
            for item in self.sticks
            if (shape := getattr(item[1], role)) is not None
            and shape.axis < len(item[0].raw)
            and (item == steering or (item[1].kind == "pedals" and _fit(item) < BY_GUESS))
        ]
        return min(having, key=lambda item: not _are_pedals(item), default=None)


def _fit(item: Driven) -> int:
    return fit_of(item[0].usb, item[0].name, item[1])


def _are_pedals(item: Driven) -> bool:
    """Whether a stick is separate pedals that are known, or that a person has moved."""
    stick, profile = item
    is_certain = _fit(item) < BY_KIND or any(stick.was_moved(shape.axis) for shape in profile.axes)
    return profile.kind == "pedals" and is_certain
