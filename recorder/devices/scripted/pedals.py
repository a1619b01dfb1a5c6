"""The right foot of the scripted driver: one pedal at a time, time to change over, no jumps."""

from carlaloc_env.core.array_types import GRAVITY_MPS2
from carlaloc_env.core.clock import TICK_HZ, TICK_S
from carlaloc_env.physics.drivetrain import motor_force_n
from carlaloc_env.physics.params import VehicleParams

_CHANGE_S = 0.35
_PRESS_RADPS, _RELEASE_RADPS = 9.0, 18.0
_LIFTED = 0.02
_HYSTERESIS_MPS2 = 0.15
_HOLD_BRAKE = 0.25


class DriverPedals:
    """Foot that presses throttle or brake for a wanted acceleration.

    Args:
        params: The car.
    """

    def __init__(self, params: VehicleParams) -> None:
        self._params = params
        spin = 4.0 * params.wheel_inertia_kgm2 / params.wheel_radius_m**2
        self._inert_kg = params.mass_kg + spin
        self._on_brake = True
        self._change_ticks = 0
        self._pedal = [0.0, _HOLD_BRAKE]
        self._rate = [0.0, 0.0]
        self._correction_mps2 = 0.0

    @property
    def is_on_brake(self) -> bool:
        """Whether the foot is on the brake or on its way there."""
        return self._on_brake

    @property
    def is_changing(self) -> bool:
        """Whether the foot is between the pedals."""
        return self._change_ticks > 0

    def hold(self) -> tuple[float, float]:
        """Throttle and brake of a standing car."""
        self._on_brake, self._change_ticks = True, 0
        self._correction_mps2 = 0.0
        return self._press(0.0, _HOLD_BRAKE)

    def drive(
        self, wanted_mps2: float, jerk_mps3: float, *, speed_mps: float, perceived_mps2: float, grade: float
    ) -> tuple[float, float]:
        """Throttle and brake for an acceleration.

        Args:
            wanted_mps2: Acceleration wanted now [m/s²].
            jerk_mps3: How it is about to change [m/s³].
            speed_mps: Forward speed [m/s].
            perceived_mps2: Acceleration perceived [m/s²].
            grade: Slope ahead, rising > 0.
        """
        p = self._params
        if not self.is_changing and speed_mps > 1.0:
            error = max(-1.0, min(1.0, wanted_mps2 - perceived_mps2))
            self._correction_mps2 = max(-0.8, min(0.8, self._correction_mps2 + 0.35 * error * TICK_S))
        lead = wanted_mps2 + 0.2 * jerk_mps3 + self._correction_mps2
        force, coast = self._force_n(lead, speed_mps, grade)
        soon, coast_soon = self._force_n(
            lead + 0.3 * jerk_mps3, max(0.0, speed_mps + 0.3 * wanted_mps2), grade
        )
        margin = _HYSTERESIS_MPS2 * p.mass_kg
        if self._change_ticks > 0:
            # The way over begins when the old pedal is up.
            self._change_ticks -= max(self._pedal) < _LIFTED
        elif self._on_brake and soon > coast_soon + margin and force > coast - 2.0 * margin:
            self._on_brake, self._change_ticks = False, round(_CHANGE_S * TICK_HZ)
        elif not self._on_brake and soon < coast_soon - margin:
            self._on_brake, self._change_ticks = True, round(_CHANGE_S * TICK_HZ)
        if self.is_changing:
            return self._press(0.0, 0.0, _RELEASE_RADPS)
        if self._on_brake:
            return self._press(0.0, max(0.0, coast - force) / (p.brake_mps2 * p.mass_kg))
        full = motor_force_n(p, 1.0, speed_mps)
        return self._press(max(0.0, force - coast) / (full - coast), 0.0)

    def _force_n(self, wanted_mps2: float, speed_mps: float, grade: float) -> tuple[float, float]:
        """Force for an acceleration, and force with both pedals released [N]."""
        p = self._params
        slope = p.mass_kg * GRAVITY_MPS2 * grade
        drag = 0.5 * p.air_kgpm3 * p.drag_area_m2 * speed_mps * speed_mps
        roll = p.rolling * p.mass_kg * GRAVITY_MPS2 if speed_mps > 0.0 else 0.0
        return self._inert_kg * wanted_mps2 + slope + drag + roll, motor_force_n(p, 0.0, speed_mps)

    def _press(self, throttle: float, brake: float, foot_radps: float = _PRESS_RADPS) -> tuple[float, float]:
        """Move both pedals towards their targets like a critically damped foot."""
        for k, target in enumerate((throttle, brake)):
            pull = foot_radps**2 * (min(1.0, target) - self._pedal[k]) - 2.0 * foot_radps * self._rate[k]
            self._rate[k] += pull * TICK_S
            self._pedal[k] = min(1.0, max(0.0, self._pedal[k] + self._rate[k] * TICK_S))
        return self._pedal[0], self._pedal[1]
