"""Hands of the scripted driver: on roads min-jerk pulses once the perceived error has added up.

In turns they follow continuously. Pulses are those of Markkula et al., "Sustained sensorimotor control as
intermittent decisions about prediction errors", 2018.
"""

from collections import deque
from dataclasses import dataclass
from math import degrees, sqrt

from carlaloc_env.core import clock
from carlaloc_env.core.clock import STEP_TICKS, TICK_HZ, TICK_S
from carlaloc_env.core.elementary_kernels import arctan, exp
from carlaloc_env.physics.params import VehicleParams
from recorder.devices.scripted.route_profile import DriverRoute


@dataclass(frozen=True, slots=True, kw_only=True)
class SteeringStyle:
    """Parameters of a driver's steering."""

    preview_s: float = 2.6
    """Time ahead to which lateral errors are extrapolated on roads."""
    turn_preview_s: float = 1.6
    """The same in tight turns."""
    curve_lead_s: float = 0.32
    """How far ahead the bend is looked at that the hands follow now."""
    bend_play: float = 0.03
    """Fraction of a bend's angle that the hands leave uncorrected."""
    noise_m: float = 0.18
    """Standard deviation of the perceived lateral position."""
    noise_s: float = 12.0
    """Time constant of that noise."""
    delay_s: float = 0.15
    """From seeing to acting."""
    gain: float = 0.75
    """Fraction of an error that one pulse corrects."""
    pulse_s: float = 0.40
    """Length of a pulse."""
    refractory_s: float = 0.25
    """Least time between the beginnings of two pulses."""
    threshold: float = 0.85
    """Added-up error [° of the steering wheel × s] that triggers a pulse."""
    busy_deg: float = 10.0
    """Errors above this [° of the steering wheel] are steered out without pause."""
    brisk_mps: float = 10.0
    """Below this speed, errors of the wheel's angle matter less."""
    hand_radps: float = 16.0
    """Natural frequency of arm and hand."""


class DriverSteering:
    """Hands on the wheel; gives the steering fraction −1…1 every tick.

    Args:
        params: The car, whose response a driver knows by feel.
        seed: Seed of the driver.
        style: How to steer.
    """

    def __init__(self, params: VehicleParams, seed: int, style: SteeringStyle | None = None) -> None:
        self._params = params
        self._style = style if style is not None else SteeringStyle()
        rear_fraction = 1.0 - params.cog_x_m / params.wheelbase_m
        self._slip_s2pm = params.mass_kg * (1.0 - rear_fraction) / params.axle_cornering_nprad[1]
        self._random = clock.stream(seed, "driver/steering")
        self._noise_m = float(self._random.normal(0.0, self._style.noise_m))
        self._seen: deque[float] = deque([0.0] * round(self._style.delay_s * TICK_HZ))
        self._bend_rad = 0.0
        self._correction_rad = 0.0
        self._pulses: list[tuple[float, float, int]] = []
        self._sum = 0.0
        self._rest_ticks = 0
        self._is_busy = False
        self._hand_rad = 0.0
        self._hand_radps = 0.0

    def update(
        self,
        road: DriverRoute,
        *,
        tick: int,
        s_m: float,
        offset_m: float,
        heading_rad: float,
        speed_mps: float,
    ) -> float:
        """Steering of this tick, −1…1.

        Args:
            road: The route.
            tick: Ticks since the drive began.
            s_m: How far along the route [m].
            offset_m: How far left of it [m].
            heading_rad: Heading of the car against that of the lane [rad], left positive.
            speed_mps: Forward speed [m/s].
        """
        style = self._style
        if tick % STEP_TICKS == 0:
            keep = exp(-STEP_TICKS * TICK_S / style.noise_s)
            jolt = style.noise_m * sqrt(1.0 - keep * keep)
            self._noise_m = keep * self._noise_m + jolt * float(self._random.normal())
        turning = road.turning(s_m)
        # In a bend the rear tyres slip, and the nose points inside the lane's direction.
        inward = self._slip_s2pm * speed_mps * speed_mps * road.curvature(s_m, 2.0)
        wanted = self._wanted_rad(turning, offset_m, heading_rad - inward, speed_mps)
        self._seen.append(wanted)
        wanted = self._seen.popleft()
        if speed_mps > 0.4:
            self._follow_bend(road, s_m, speed_mps)
            error_deg = degrees(abs(wanted - self._correction_rad)) * self._params.steering_ratio
            calm = max(1.0, style.brisk_mps / speed_mps)
            limit_deg = style.busy_deg * calm
            self._is_busy = error_deg > (0.3 * limit_deg if self._is_busy else limit_deg)
            if self._is_busy:
                self._correction_rad += (wanted - self._correction_rad) * TICK_S / 0.10
                self._sum = 0.0
            else:
                self._decide(tick, wanted, style.threshold * min(calm * calm, 6.0))
        self._run_pulses(tick)
        return self._move_hand(self._bend_rad + self._correction_rad)

    def _wanted_rad(self, turning: float, offset_m: float, heading_rad: float, speed_mps: float) -> float:
        """Road-wheel angle that would bring the car to the lane's centre within the preview."""
        style, p = self._style, self._params
        far = max(12.0, speed_mps * style.preview_s)
        near = max(6.5, speed_mps * style.turn_preview_s)
        ahead = far + turning * (near - far)
        offset = offset_m + (1.0 - turning) * self._noise_m
        curvature = -2.0 * (offset + ahead * heading_rad) / (ahead * ahead)
        return curvature * (p.wheelbase_m + p.understeer_s2pm * speed_mps * speed_mps)

    def _follow_bend(self, road: DriverRoute, s_m: float, speed_mps: float) -> None:
        p = self._params
        lead = self._style.curve_lead_s * speed_mps
        curvature = road.curvature(s_m + lead, max(1.8, 0.33 * speed_mps))
        angle = arctan(p.wheelbase_m * curvature) + p.understeer_s2pm * speed_mps * speed_mps * curvature
        # Hands do not follow what is smaller than half a degree at the wheel, or a fraction of its angle:
        # in a steady bend they hold still, and corrections make up for the rest.
        play = 0.5 / degrees(1.0) / p.steering_ratio + self._style.bend_play * abs(angle)
        self._bend_rad = min(max(self._bend_rad, angle - play), angle + play)

    def _decide(self, tick: int, wanted_rad: float, threshold: float) -> None:
        style = self._style
        pending = sum(self._remaining(pulse, tick) for pulse in self._pulses)
        error = wanted_rad - self._correction_rad - pending
        error_deg = degrees(error) * self._params.steering_ratio
        self._sum += (error_deg - self._sum / 1.2) * TICK_S
        if self._rest_ticks > 0:
            self._rest_ticks -= 1
            return
        if abs(self._sum) < threshold:
            return
        gain = style.gain * (1.0 + 0.15 * float(self._random.normal()))
        length_s = style.pulse_s + 0.06 * float(self._random.uniform(-1.0, 1.0))
        self._pulses.append((gain * error, length_s, tick))
        self._sum = 0.25 * float(self._random.normal()) * threshold
        self._rest_ticks = round(style.refractory_s * TICK_HZ)

    def _run_pulses(self, tick: int) -> None:
        for pulse in self._pulses:
            self._correction_rad += self._remaining(pulse, tick) - self._remaining(pulse, tick + 1)
        self._pulses = [pulse for pulse in self._pulses if (tick + 1 - pulse[2]) * TICK_S < pulse[1]]

    @staticmethod
    def _remaining(pulse: tuple[float, float, int], tick: int) -> float:
        """What is left of a pulse: min-jerk from all to nothing."""
        size, length_s, begin = pulse
        q = min(1.0, max(0.0, (tick - begin) * TICK_S / length_s))
        return size * (1.0 - q * q * q * (10.0 - 15.0 * q + 6.0 * q * q))

    def _move_hand(self, target_rad: float) -> float:
        p, w = self._params, self._style.hand_radps
        pull = w * w * (target_rad - self._hand_rad) - 1.6 * w * self._hand_radps
        self._hand_radps += pull * TICK_S
        fastest = 0.8 * p.wheel_rate_radps / p.steering_ratio
        self._hand_radps = max(-fastest, min(fastest, self._hand_radps))
        self._hand_rad += self._hand_radps * TICK_S
        return max(-1.0, min(1.0, self._hand_rad / p.steer_max_rad))
