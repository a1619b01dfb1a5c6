"""The ego's CAN bus: frames of `CanState` samples, and the DBC file that describes them."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from carlaloc_env.samples import CanState


@dataclass(frozen=True, slots=True)
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
            Signal("SteeringWheelAngle", lambda s: math.degrees(s.steering_wheel_rad), 0.1, "deg"),
            Signal("Speed", lambda s: s.speed_mps, 0.01, "m/s"),
            Signal("Gear", lambda s: float(s.gear), 1.0),
            Signal("Handbrake", lambda s: float(s.handbrake), 1.0),
        ),
    ),
    "WHEEL_SPEEDS": (
        0x0C2,
        (
            Signal("FrontLeft", lambda s: float(s.wheel_speed_mps[0]), 0.01, "m/s"),
            Signal("FrontRight", lambda s: float(s.wheel_speed_mps[1]), 0.01, "m/s"),
            Signal("RearLeft", lambda s: float(s.wheel_speed_mps[2]), 0.01, "m/s"),
            Signal("RearRight", lambda s: float(s.wheel_speed_mps[3]), 0.01, "m/s"),
        ),
    ),
    "PEDALS": (
        0x0C3,
        (
            Signal("Throttle", lambda s: 100.0 * s.throttle, 0.1, "%"),
            Signal("Brake", lambda s: 100.0 * s.brake, 0.1, "%"),
        ),
    ),
}
"""Identifier and signals of each frame; a signal begins every 16 bits."""


def encode(frame: str, state: CanState) -> tuple[int, bytes]:
    """Identifier and data of a frame."""
    identifier, signals = FRAMES[frame]
    data = b"".join(signal.encode(state).to_bytes(2, "little", signed=True) for signal in signals)
    return identifier, data
