"""Turns raw steering and pedals into controls of a car: limits, rates and filters at 200 Hz."""

import math

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.physics.params import VehicleParams

KEYBOARD_LATERAL_MPS2 = 4.0
"""Lateral acceleration that full steering by key or stick may ask for [m/s²]."""
WHEEL_OMEGA, STICK_OMEGA, KEY_OMEGA = 40.0, 12.0, 9.0
"""Corner frequency of the steering filter for wheels, sticks and keys [rad/s]."""
PEDAL_OMEGA = 25.0
_FULL_STEER_S = 0.7
_RETURN_FASTER = 1.5
_ARRIVED = 1e-9
_SLOW_MPS = 3.0


def steer_limit(speed_mps: float, params: VehicleParams) -> float:
    """Largest steering 0…1 that keeps the lateral acceleration at `KEYBOARD_LATERAL_MPS2`.

    The linear bicycle model in steady state: δ = L·a/v² + K·a.
    """
    v = max(abs(speed_mps), _SLOW_MPS)
    angle = KEYBOARD_LATERAL_MPS2 * (params.wheelbase_m / (v * v) + params.understeer_s2pm)
    return min(1.0, angle / params.steer_max_rad)


def wheel_steer(turned: float, rotation_deg: float, params: VehicleParams) -> float:
    """Steering −1…1 of a wheel turned by a fraction −1…1 of its half range: real angles, never bent."""
    angle = turned * math.radians(rotation_deg) / 2.0 / params.steering_ratio
    return max(-1.0, min(1.0, angle / params.steer_max_rad))


class Filter:
    """Critically damped second-order filter, exact for a target held over a tick.

    x'' = ω² (u − x) − 2 ω x'; no overshoot, continuous rate.
    """

    def __init__(self, omega_radps: float) -> None:
        self._omega = omega_radps
        self._decay = math.exp(-omega_radps * TICK_S)
        self.value = 0.0
        self.rate = 0.0

    def update(self, target: float) -> float:
        """Value after one tick on the way to a target."""
        away = self.value - target
        push = self.rate + self._omega * away
        self.value = target + (away + push * TICK_S) * self._decay
        self.rate = (self.rate - self._omega * push * TICK_S) * self._decay
        if abs(self.value - target) < _ARRIVED and abs(self.rate) < _ARRIVED:
            self.value, self.rate = target, 0.0
        return self.value


class KeySteering:
    """Steering by two keys: rate-limited, self-centring, limited by speed."""

    def __init__(self, params: VehicleParams) -> None:
        self._params = params
        self._hand = 0.0
        self._filter = Filter(KEY_OMEGA)

    def update(self, left: bool, right: bool, speed_mps: float) -> float:
        """Steering after one tick; a counter key first brings the hand back to the middle."""
        limit = steer_limit(speed_mps, self._params)
        target = limit * (int(left) - int(right))
        rate = limit * TICK_S / _FULL_STEER_S
        if target == 0.0 or target * self._hand < 0.0 or abs(self._hand) > limit:
            rate = max(rate, abs(self._hand) * TICK_S / _FULL_STEER_S) * _RETURN_FASTER
        goal = 0.0 if target * self._hand < 0.0 else target
        self._hand += max(-rate, min(rate, goal - self._hand))
        return self._filter.update(self._hand)


class KeyPedals:
    """Throttle and brake by two keys."""

    def __init__(self) -> None:
        self._throttle = self._brake = 0.0
        self._held_s = 0.0
        self._filters = Filter(PEDAL_OMEGA), Filter(PEDAL_OMEGA)

    def update(self, forward: bool, back: bool) -> tuple[float, float]:
        """Throttle and brake after one tick; full braking needs the key held for more than 1 s."""
        self._held_s = self._held_s + TICK_S if back else 0.0
        self._throttle = _moved(self._throttle, 1.0 if forward and not back else 0.0, 1.0, 0.3)
        self._brake = _moved(self._brake, (1.0 if self._held_s > 1.0 else 0.6) if back else 0.0, 1.0, 0.2)
        throttle, brake = self._filters
        return _in_unit(throttle.update(self._throttle)), _in_unit(brake.update(self._brake))


def _moved(value: float, target: float, rise_s: float, fall_s: float) -> float:
    """Value after one tick; the full range takes `rise_s` upwards and `fall_s` downwards."""
    if target > value:
        return min(target, value + TICK_S / rise_s)
    return max(target, value - TICK_S / fall_s)


def _in_unit(value: float) -> float:
    return min(1.0, max(0.0, value))
