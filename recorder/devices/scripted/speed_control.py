"""Speed control: a jerk that leads to each goal ahead by the smoothest way, and the least of them.

The speed change of least jerk over a time T is a cubic; from speed v₀ and acceleration a₀ it covers
D = (v₀+v₁)/2·T + a₀T²/12 and begins with the jerk 2(3(v₁−v₀) − 2a₀T)/T². Solving for T at every
tick keeps a car on its cubic and makes the plan its own feedback.
"""

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from recorder.devices.scripted.route_profile import DriverRoute

_SIGHT_M = 130.0
_SCAN_M = 2.0
_SHORTEST_S = 1.6
_STOP_RESERVE_M = 1.0
_LATENCY_S = 0.3
_ANOTHER_STOP_M = 3.0
"""A place to stand that lies so much farther than the last is another one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedStyle:
    """Parameters of a driver's speed control."""

    brake_from_mps2: float = 1.3
    """Braking for something ahead begins when its peak would exceed this."""
    accelerate_mps2: float = 2.0
    """Comfortable acceleration in town."""
    jerk_up_mps3: float = 1.4
    """Greatest rise of acceleration."""
    jerk_down_mps3: float = 1.6
    """Greatest fall of acceleration in normal driving."""
    hardest_mps2: float = 3.0
    """Greatest braking in normal driving."""
    headway_s: float = 1.4
    """Time behind a leader."""
    gap_m: float = 2.8
    """Distance kept from a standing leader."""
    indifference_mps: float = 0.35
    """Speed errors below this are left alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leader:
    """The vehicle ahead."""

    gap_m: float
    """Bumper to bumper."""
    speed_mps: float
    """Its speed along the route."""


@dataclass(slots=True)
class _Bend:
    """A place ahead that must be passed slowly."""

    s_m: float
    speed_mps: float


class DriverSpeed:
    """Acceleration wanted, advanced tick by tick with bounded jerk."""

    def __init__(self, style: SpeedStyle | None = None) -> None:
        self.style = style if style is not None else SpeedStyle()
        self._bends: list[_Bend] = []
        self._stopping = False
        self._stop_s_m = inf
        self._target_mps = 0.0
        self.wanted_mps2 = 0.0
        """Acceleration wanted now [m/s²]."""
        self.jerk_mps3 = 0.0
        """Its rate of change [m/s³]."""

    def rest(self) -> None:
        """Stand still."""
        self.wanted_mps2 = self.jerk_mps3 = 0.0
        self._stopping = False
        self._bends.clear()

    def update(
        self,
        road: DriverRoute,
        *,
        tick: int,
        s_m: float,
        speed_mps: float,
        stop_m: float | None,
        leader: Leader | None,
    ) -> None:
        """Advance by one tick.

        Args:
            road: The route.
            tick: Ticks since the drive began.
            s_m: How far along the route [m].
            speed_mps: Forward speed [m/s].
            stop_m: Distance left to where the car has to stand [m], None if nowhere in sight.
            leader: The vehicle ahead.
        """
        style, v = self.style, max(0.0, speed_mps)
        if tick % STEP_TICKS == 0 or self._target_mps == 0.0:
            self._scan(road, s_m, v)
        jerk = self._cruise(v)
        for bend in self._bends:
            jerk = min(jerk, self._jerk_to(bend.speed_mps, bend.s_m - s_m, v))
        jerk = min(jerk, self._stop(stop_m, s_m, v))
        danger = 0.0
        if leader is not None:
            jerk = min(jerk, self._follow(leader, v))
            closing = max(0.0, v - leader.speed_mps)
            danger = closing * closing / (2.0 * max(0.3, leader.gap_m - 1.0))
        if self._stopping and stop_m is not None:
            danger = max(danger, v * v / (2.0 * max(0.3, stop_m + _STOP_RESERVE_M)))
        if danger > style.hardest_mps2:
            self.jerk_mps3 = -12.0 if self.wanted_mps2 > -1.3 * danger else 0.0
            self.wanted_mps2 = max(-9.0, self.wanted_mps2 + self.jerk_mps3 * TICK_S)
            return
        # Brakes are let go faster than the throttle is pressed, most of all just before standing.
        ease = 1.0 if self.wanted_mps2 > 0.0 else 2.0 if v > 1.2 else 3.0
        jerk = max(-style.jerk_down_mps3, min(ease * style.jerk_up_mps3, jerk))
        before = self.wanted_mps2
        after = min(before + jerk * TICK_S, max(0.7, 2.0 - 0.05 * v))
        if before >= -style.hardest_mps2:
            after = max(after, -style.hardest_mps2)
        self.wanted_mps2 = after
        self.jerk_mps3 = (after - before) / TICK_S

    def _scan(self, road: DriverRoute, s_m: float, v: float) -> None:
        """Look along the route for places that call for braking."""
        ahead, speeds = road.speeds_ahead(s_m, _SIGHT_M, _SCAN_M)
        near = ahead <= 2.0 + 0.6 * v
        self._target_mps = float(speeds[near].min())
        self._bends = [b for b in self._bends if b.s_m > s_m + 0.5 and b.speed_mps < v - 0.1]
        later, used = self._after_lifting(v)
        left = np.maximum(ahead - used, 1.0)
        peak = np.where(speeds < v - 0.3, 0.75 * (later * later - speeds * speeds) / left, 0.0)
        worst = int(np.argmax(peak))
        if peak[worst] < self.style.brake_from_mps2:
            return
        s, speed = s_m + float(ahead[worst]), float(speeds[worst])
        if all(abs(b.s_m - s) > 1.5 * _SCAN_M or speed < b.speed_mps - 0.2 for b in self._bends):
            self._bends = [*self._bends[-3:], _Bend(s, speed)]

    def _after_lifting(self, v: float) -> tuple[float, float]:
        """Speed [m/s] and distance used [m] until an acceleration under way has been taken back."""
        a = max(0.0, self.wanted_mps2)
        seconds = a / self.style.jerk_down_mps3
        later = v + 0.5 * a * seconds
        return later, v * (seconds + min(1.0, a) * _LATENCY_S) + a * seconds * seconds / 3.0

    def _cruise(self, v: float) -> float:
        """Jerk towards the speed that is right here."""
        change, a = self._target_mps - v, self.wanted_mps2
        if abs(change) < self.style.indifference_mps and abs(a) < 0.25:
            return -a / 1.0
        comfort = self.style.accelerate_mps2 - 0.02 * v if change > 0.0 else 1.2
        seconds = min(9.0, max(3.0, 1.5 * abs(change) / comfort))
        return 2.0 * (3.0 * change - 2.0 * a * seconds) / (seconds * seconds)

    def _jerk_to(self, target_mps: float, distance_m: float, v: float) -> float:
        """Jerk that begins the smoothest way to a speed at a distance."""
        change, a = target_mps - v, self.wanted_mps2
        mean = 0.5 * (v + target_mps)
        root = mean * mean + a * distance_m / 3.0
        if distance_m <= 0.0:
            seconds = _SHORTEST_S
        elif root > 0.0:
            seconds = 2.0 * distance_m / (mean + sqrt(root))
        else:
            seconds = 6.0 * mean / abs(a)
        seconds = max(_SHORTEST_S, seconds)
        return 2.0 * (3.0 * change - 2.0 * a * seconds) / (seconds * seconds)

    def _stop(self, stop_m: float | None, s_m: float, v: float) -> float:
        if stop_m is None:
            self._stopping = False
            return inf
        if s_m + stop_m > self._stop_s_m + _ANOTHER_STOP_M:
            self._stopping = False
        self._stop_s_m = s_m + stop_m
        distance = max(stop_m, 0.05)
        later, used = self._after_lifting(v)
        if 0.75 * later * later / max(distance - used, 0.05) > self.style.brake_from_mps2:
            self._stopping = True
        # Without latching, a goal far ahead would be braked for from where it comes in sight.
        return self._jerk_to(0.0, distance, v) if self._stopping else inf

    def _follow(self, leader: Leader, v: float) -> float:
        """Jerk towards the acceleration of the Intelligent Driver Model (Treiber et al., 2000)."""
        style = self.style
        a, b = style.accelerate_mps2, 1.7
        closing = v - leader.speed_mps
        wanted = style.gap_m + max(0.0, v * style.headway_s + 0.5 * v * closing / sqrt(a * b))
        gap = max(0.5, leader.gap_m)
        if gap > 2.2 * wanted and closing < 1.0:
            return inf
        used = (v / max(1.0, self._target_mps)) ** 2
        ask = a * (1.0 - used * used - (wanted / gap) ** 2)
        return (max(-4.0, ask) - self.wanted_mps2) / 0.6
