"""Profiles of wheels, pedals and gamepads, as YAML files, and the profile that fits a device best."""

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
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.core.files.config_files import from_mapping, to_mapping
from carlaloc_env.core.files.output_paths import user_folder
from carlaloc_env.core.files.text_files import read_text
from recorder.devices.axis_shape import AxisShape
from recorder.devices.base import Command

KINDS = ("wheel", "pedals", "gamepad")
BY_USB, BY_NAME, BY_KIND, BY_GUESS = range(4)
"""How surely a profile is a device's: by its USB id, its name, the kind that its name shows, or a guess."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceProfile:
    """Profile of one device: the functions of its axes and buttons."""

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
        shapes = (self.steer, self.throttle, self.brake, self.handbrake)
        return tuple(shape for shape in shapes if shape is not None)


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
    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
    return write_whole(path, text, DeviceError, "set XDG_CONFIG_HOME")


def known_profiles(folder: Path | None = None) -> list[DeviceProfile]:
    """Calibrated profiles first, then the shipped ones; those for other systems are left out.

    Raises:
        ConfigError: a file is not a profile.
    """
    with suppress(OutputError):
        folder = folder or profile_folder()
    profiles = []
    for path in sorted(folder.glob("*.yaml")) if folder and os.access(folder, os.R_OK) else []:
        profiles.append(read_profile(read_text(path, "device profile"), str(path)))
    shipped = files("recorder.devices") / "profiles"
    for entry in sorted(shipped.iterdir(), key=lambda item: item.name):
        if entry.name.endswith(".yaml"):
            profiles.append(read_profile(entry.read_text(encoding="utf-8"), entry.name))
    return [profile for profile in profiles if profile.platform in (None, sys.platform)]


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
    candidates = [
        (fit, fit >= BY_KIND and profile.misses(axis_count), profile)
        for profile in profiles
        if profile.kind in kinds
        and ((fit := fit_of(usb, name, profile)) < BY_KIND or _reads_some(profile, axis_count))
    ]
    best = min(candidates, key=lambda item: (*item[:2], item[2].axis_count is None), default=None)
    return None if best is None else best[2]


def _reads_some(profile: DeviceProfile, axis_count: int) -> bool:
    first = profile.steer or profile.throttle
    fits = profile.is_generic and profile.axis_count in (None, axis_count)
    return fits and first is not None and first.axis < axis_count


def fit_of(usb: str, name: str, profile: DeviceProfile) -> int:
    """Quality of the match between a profile and a device: `BY_USB` … `BY_GUESS`."""
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
