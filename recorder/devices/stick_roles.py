"""Decides which of the connected sticks steers, and which has the pedals."""

from collections.abc import Iterable, Sequence
from typing import TypeAlias

from recorder.devices.axis_shape import AxisShape
from recorder.devices.inputs import Stick
from recorder.devices.profile import BY_GUESS, BY_KIND, BY_USB, DeviceProfile, fit_of, match_profile

_KINDS_OF = {"wheel": ("wheel", "pedals"), "gamepad": ("gamepad",)}
"""Kinds of profiles by device."""
_AT_REST = 0.1
"""Part of its travel within which a pedal is at rest."""

Driven: TypeAlias = tuple[Stick, DeviceProfile]
"""A stick and its profile."""


def rested(stick: Stick, profile: DeviceProfile, role: str) -> bool:
    """Whether the pedal of a role was seen at rest."""
    shape: AxisShape = getattr(profile, role)
    return stick.was_near(shape.axis, shape.rest, _AT_REST * abs(shape.full - shape.rest))


class StickRoles:
    """Roles of the connected sticks: one steers, and one has the pedals.

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
        """Assign the roles anew after sticks moved, came or went; return losses and gains."""
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
                stick.trusted[shape.axis] |= abs(shape.rest) > 0.5
        self.sticks.append((stick, profile))
        lost = self._steerer if all(other is not self._steerer for other, _ in self.sticks) else None
        if stick.usb in (self._preferred, lost and lost.usb):
            self._steerer, self._preferred = stick, None
        return True

    def _lose(self, stick: Stick) -> bool:
        """Forget a stick; False: it was not used."""
        left = [(other, profile) for other, profile in self.sticks if other is not stick]
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
