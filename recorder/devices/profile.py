"""Profiles of wheels, pedals and gamepads: YAML files that name each axis and button.

From a raw axis of a wheel, pedal or stick to a value: data and one function.
"""

import math
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env.core.errors import ConfigError, DeviceError, OutputError
from carlaloc_env.core.files.config_files import from_mapping, read_text, to_mapping
from carlaloc_env.core.files.output_paths import atomic_write, user_folder
from recorder.devices.base import Command


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
    wanted = [profile for profile in profiles if profile.kind in kinds]
    for profile in wanted:
        if usb in profile.usb:
            return profile
    for profile in wanted:
        if profile.name.lower() == name.lower():
            return profile
    looks = name.lower()
    if any(word in looks for word in ("pedal",)):
        guess = "pedals"
    elif any(word in looks for word in ("pad", "xbox", "controller", "dualshock", "dualsense")):
        guess = "gamepad"
    else:
        guess = "wheel"
    generic = [
        profile
        for profile in wanted
        if profile.is_generic
        and profile.axis_count in (None, axis_count)
        and any(shape.axis < axis_count for shape in (profile.steer or profile.throttle,) if shape)
    ]
    generic.sort(key=lambda p: (p.kind != guess, p.misses(axis_count), p.axis_count is None))
    return generic[0] if generic else None
