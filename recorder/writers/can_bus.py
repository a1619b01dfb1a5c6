"""The ego's CAN bus: frames of `CanState` samples, and the DBC file that describes them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from carlaloc_env.samples import CanState


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """Sixteen bits, little-endian, of a frame."""

    name: str
    """Name in the DBC file."""
    value: Callable[[CanState], float]
    """Physical value of a sample."""
    factor: float
    """Physical value of one step."""
    unit: str = ""
    """Unit in the DBC file."""

    def encode(self, state: CanState) -> int:
        """Raw value, held within 16 bits."""
        return max(-32768, min(32767, round(self.value(state) / self.factor)))


FRAMES: dict[str, tuple[int, tuple[Signal, ...]]] = {
    "STEERING_AND_SPEED": (
        0x0C1,
        (
            Signal(
                name="SteeringWheelAngle",
                value=lambda s: math.degrees(s.steering_wheel_rad),
                factor=0.1,
                unit="deg",
            ),
            Signal(name="Speed", value=lambda s: s.speed_mps, factor=0.01, unit="m/s"),
            Signal(name="Gear", value=lambda s: float(s.gear), factor=1.0),
            Signal(name="Handbrake", value=lambda s: float(s.handbrake), factor=1.0),
        ),
    ),
    "WHEEL_SPEEDS": (
        0x0C2,
        (
            Signal(name="FrontLeft", value=lambda s: float(s.wheel_speed_mps[0]), factor=0.01, unit="m/s"),
            Signal(name="FrontRight", value=lambda s: float(s.wheel_speed_mps[1]), factor=0.01, unit="m/s"),
            Signal(name="RearLeft", value=lambda s: float(s.wheel_speed_mps[2]), factor=0.01, unit="m/s"),
            Signal(name="RearRight", value=lambda s: float(s.wheel_speed_mps[3]), factor=0.01, unit="m/s"),
        ),
    ),
    "PEDALS": (
        0x0C3,
        (
            Signal(name="Throttle", value=lambda s: 100.0 * s.throttle, factor=0.1, unit="%"),
            Signal(name="Brake", value=lambda s: 100.0 * s.brake, factor=0.1, unit="%"),
        ),
    ),
}
"""Identifier and signals of each frame; a signal begins every 16 bits."""


def encode(frame: str, state: CanState) -> tuple[int, bytes]:
    """Identifier and data of a frame."""
    identifier, signals = FRAMES[frame]
    data = b"".join(signal.encode(state).to_bytes(2, "little", signed=True) for signal in signals)
    return identifier, data
