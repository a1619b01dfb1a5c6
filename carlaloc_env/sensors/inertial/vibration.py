"""Vibration that a rigid car on a smooth road lacks: the road's roughness and the motor's orders.

It moves the IMU's housing only, not the truth: images, LiDAR and ground truth stay as they are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import rng
from carlaloc_env.core.array_types import Array
from carlaloc_env.timeline.vehicle_track import CarState

ROAD_CLASSES = "ABCDE"
"""Road classes of ISO 8608, smooth to rough."""
_WAVES = 160
"""Sines that make up a road's profile."""
_WAVENUMBERS = (0.02, 8.0)
"""Spatial frequencies of the roughness [cycles/m]."""
_SPRUNG_KG = 420.0
"""Sprung mass of a quarter car [kg]: 1.3 Hz body bounce; the ego's own quarter in physics has 417.5 kg."""
_UNSPRUNG_KG = 42.0
"""Its unsprung mass [kg]: 12 Hz wheel hop; the ego's own in physics is 45 kg."""
_SPRING_NPM = 28_000.0
"""Its spring [N/m]."""
_DAMPER_NSPM = 2_200.0
"""Its damper [N s/m]: damping ratio 0.32."""
_TYRE_NPM = 210_000.0
"""Its tyre [N/m]; the ego's own in physics has 220 kN/m."""


def roughness_m3(road_class: str) -> float:
    """Displacement spectrum G_d at 0.1 cycles/m [m³]: geometric mean of a class of ISO 8608."""
    return 16e-6 * 4.0 ** ROAD_CLASSES.index(road_class)


def body_response(frequency_hz: Array) -> NDArray[np.complex128]:
    """Displacement of the body over that of the road of a quarter car, complex, shape of the input."""
    s = 2j * math.pi * np.asarray(frequency_hz)
    link = _SPRING_NPM + _DAMPER_NSPM * s
    body = _SPRUNG_KG * s * s + link
    wheel = _UNSPRUNG_KG * s * s + link + _TYRE_NPM
    result: NDArray[np.complex128] = _TYRE_NPM * link / (body * wheel - link * link)
    return result


class RoadVibration:
    """Vertical acceleration of the body from a rough road: the same position gives the same every time.

    The profile is a sum of sines in the distance covered, with the spectrum
    G_d(n) = G_d(n₀)·(n/n₀)⁻² of ISO 8608; the quarter car answers each at its frequency n·v.
    """

    def __init__(self, seed: int, name: str, road_class: str) -> None:
        edges = np.geomspace(*_WAVENUMBERS, _WAVES + 1)
        generator = rng.stream(seed, f"{name}/road")
        self._n = edges[:-1] + generator.random(_WAVES) * np.diff(edges)
        density = roughness_m3(road_class) * (self._n / 0.1) ** -2
        self._amplitude = np.sqrt(2.0 * density * np.diff(edges))
        self._phase = 2.0 * math.pi * generator.random(_WAVES)

    def acceleration_mps2(self, distance_m: Array, speed_mps: Array) -> Array:
        """Upward acceleration [m/s²] at distances [m] and speeds [m/s], shape (M,)."""
        frequency = np.abs(speed_mps)[:, None] * self._n
        gain = body_response(frequency)
        phase = 2.0 * math.pi * np.sign(speed_mps)[:, None] * self._n * distance_m[:, None] + self._phase
        omega = 2.0 * math.pi * frequency
        waves = self._amplitude * omega * omega * np.abs(gain) * np.sin(phase + np.angle(gain))
        total: Array = -np.sum(waves, axis=-1)
        return total


class MotorVibration:
    """Sines at multiples (orders) of the motor's turning, stronger under load, on all three axes.

    Above half the IMU's rate they alias, as on a real car without an anti-alias filter.
    """

    def __init__(
        self, seed: int, name: str, *, rms_mps2: float, orders: tuple[float, ...], ratio: float
    ) -> None:
        generator = rng.stream(seed, f"{name}/motor")
        self._orders, self._ratio = np.array(orders), ratio
        self._phase = 2.0 * math.pi * generator.random((3, len(orders)))
        weights = 1.0 / np.arange(1, len(orders) + 1)
        self._amplitude = rms_mps2 * math.sqrt(2.0) * weights / math.sqrt(float(np.sum(weights * weights)))

    def acceleration_mps2(self, car: CarState) -> Array:
        """Acceleration [m/s²] at M instants, shape (M, 3); `rms_mps2` per axis at full throttle."""
        motor_rad = 0.5 * self._ratio * (car.wheel_angle_rad[:, 2] + car.wheel_angle_rad[:, 3])
        spins = np.abs(car.wheel_spin_radps[:, 2] + car.wheel_spin_radps[:, 3]) > 0.1
        load = (0.2 + 0.8 * car.throttle) * spins
        waves = self._amplitude * np.sin(motor_rad[:, None, None] * self._orders + self._phase)
        total: Array = load[:, None] * np.sum(waves, axis=-1)
        return total
