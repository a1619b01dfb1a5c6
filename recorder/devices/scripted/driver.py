"""The scripted driver: a device like any other that follows the route as a person would."""

import math

from carlaloc_env.core import clock
from carlaloc_env.core.clock import TICK_HZ, TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.map.routing.route import Route
from carlaloc_env.physics.params import VehicleParams
from carlaloc_env.traffic.signals import SignalState
from recorder.devices.scripted.pedals import DriverPedals
from recorder.devices.scripted.route_profile import DriverRoute
from recorder.devices.scripted.speed_control import DriverSpeed, Leader
from recorder.devices.scripted.steering import DriverSteering

STANDSTILL_S = 2.0
"""The drive begins with this much rest, which inertial SLAM needs to start."""
_STOP_BEFORE_LINE_M = 1.3
_ROUTE_END_M = 1.0
_YELLOW_BRAKE_MPS2 = 2.3
_RED_BRAKE_MPS2 = 4.5
_STANDING_MPS = 0.06
_PAST_RATE = 0.5
_RESYNC_M = 4.0
_HILL_GRADE = 0.015
_HILL_HOLD_S = 0.45


class ScriptedDriver:
    """Drives along the view's route; the same seed and the same views give the same controls.

    Args:
        seed: Seed of the driver's small errors and reaction times.
        params: The car that it is used to.
    """

    def __init__(self, seed: int, params: VehicleParams | None = None) -> None:
        self._params = params if params is not None else VehicleParams()
        self._seed = seed
        self._last_tick = -1
        self._begin()

    def _begin(self) -> None:
        """Reset the driver's state for a standing car."""
        self._random = clock.stream(self._seed, "driver/decisions")
        self._limit_fraction = 0.94 + 0.05 * float(self._random.uniform())
        self._steering = DriverSteering(self._params, self._seed)
        self._pedals = DriverPedals(self._params)
        self._speed = DriverSpeed()
        self._route: Route | None = None
        self._road: DriverRoute | None = None
        self._s_m = 0.0
        self._standing, self._is_launching = True, False
        self._free_since: int | None = None
        self._go_tick = self._hill_ticks = 0
        self._passing_s_m: float | None = None
        self._stopping_s_m: float | None = None
        self._leader: Leader | None = None
        self._steer = 0.0

    @property
    def name(self) -> str:
        """Name of the device, as recorded in the episode."""
        return "scripted"

    def close(self) -> None:
        """Do nothing: there is no device to release."""

    def read(self, view: DriverView) -> Controls:
        """Controls for the coming tick; a tick that is not later than the last begins a new drive."""
        if view.tick <= self._last_tick:
            self._begin()
        self._last_tick = view.tick
        road = self._know_route(view)
        x, y = float(view.position_m[0]), float(view.position_m[1])
        if abs(view.route_s_m - self._s_m) > _RESYNC_M:
            self._s_m = view.route_s_m
        self._s_m, offset = road.locate(x, y, self._s_m)
        v = view.speed_mps
        self._watch_leader(view)
        stop = self._distance_to_stop(view, road)
        if self._standing and not self._drives_off(view, stop):
            throttle, brake = self._pedals.hold()
            self._speed.rest()
            return Controls(steer=self._steer, throttle=throttle, brake=brake)
        handbrake = self._hold_hill(road)
        on_throttle = not (self._pedals.is_on_brake or self._pedals.is_changing)
        if not handbrake and (on_throttle or v > 0.5):
            self._is_launching = False
        if not self._is_launching:
            # A person waits with speeding up until the foot has found the pedal.
            self._speed.update(
                road, tick=view.tick, s_m=self._s_m, speed_mps=v, stop_m=stop, leader=self._leader
            )
        throttle, brake = self._pedals.drive(
            self._speed.wanted_mps2,
            1.0 if self._is_launching else self._speed.jerk_mps3,
            speed_mps=v,
            perceived_mps2=view.acceleration_mps2,
            grade=road.grade(self._s_m + 1.4),
        )
        # A driver who rolls past the place, down a slope, brakes all the sooner.
        slow = _STANDING_MPS if stop is None else max(_STANDING_MPS, min(0.3, -_PAST_RATE * stop))
        if v < slow and not self._is_launching and self._speed.wanted_mps2 <= 0.0:
            self._standing, self._free_since = True, None
        self._steer = self._steering.update(
            road,
            tick=view.tick,
            s_m=self._s_m,
            offset_m=offset,
            heading_rad=math.remainder(view.heading_rad - road.heading(self._s_m), 2.0 * math.pi),
            speed_mps=v,
        )
        return Controls(steer=self._steer, throttle=throttle, brake=brake, handbrake=handbrake)

    def _know_route(self, view: DriverView) -> DriverRoute:
        if self._road is None or view.route is not self._route:
            self._route = view.route
            self._road = DriverRoute(view.route, self._limit_fraction)
            self._s_m = view.route_s_m
        return self._road

    def _hold_hill(self, road: DriverRoute) -> bool:
        """Handbrake for starting uphill: held until the throttle carries the car."""
        if not self._is_launching:
            return False
        if self._pedals.is_on_brake or self._pedals.is_changing:
            self._hill_ticks = round(_HILL_HOLD_S * TICK_HZ)
        else:
            self._hill_ticks -= 1
        return self._hill_ticks > 0 and road.grade(self._s_m + 1.4) > _HILL_GRADE

    def _watch_leader(self, view: DriverView) -> None:
        """Smooth what is seen of the leader, which comes in steps of 50 ms."""
        if view.leader_gap_m is None:
            self._leader = None
            return
        leader = self._leader
        if leader is None or abs(leader.gap_m - view.leader_gap_m) > 3.0:
            self._leader = Leader(gap_m=view.leader_gap_m, speed_mps=view.leader_speed_mps)
            return
        speed = leader.speed_mps + (view.leader_speed_mps - leader.speed_mps) * TICK_S / 0.3
        gap = leader.gap_m + (view.leader_speed_mps - view.speed_mps) * TICK_S
        self._leader = Leader(gap_m=gap + 0.05 * (view.leader_gap_m - gap), speed_mps=speed)

    def _distance_to_stop(self, view: DriverView, road: DriverRoute) -> float | None:
        """Distance left to the first place where the car has to stand [m]."""
        distances = []
        if not road.closed:
            distances.append(road.length_m - _ROUTE_END_M - self._s_m)
        line = self._distance_to_line(view)
        if line is not None:
            distances.append(line)
        leader = self._leader
        if leader is not None and leader.speed_mps < 0.8:
            distances.append(leader.gap_m - self._speed.style.gap_m)
        return min(distances) if distances else None

    def _distance_to_line(self, view: DriverView) -> float | None:
        distance = view.stop_line_distance_m
        if distance is None or view.signal_state not in (SignalState.RED, SignalState.YELLOW):
            self._passing_s_m = self._stopping_s_m = None
            return None
        # The distance was measured at the view's own place on the route.
        left = distance + view.route_s_m - self._s_m
        line_s = self._s_m + left
        v = max(0.0, view.speed_mps)
        if self._passing_s_m is not None and abs(self._passing_s_m - line_s) < 3.0:
            return None
        # Who has decided to stop does not think again.
        decided = self._stopping_s_m is not None and abs(self._stopping_s_m - line_s) < 3.0
        too_hard = _YELLOW_BRAKE_MPS2 if view.signal_state == SignalState.YELLOW else _RED_BRAKE_MPS2
        crossed = left < -0.3 and v > 0.3
        if crossed or (not decided and v > 1.0 and v * v > 2.0 * too_hard * max(left, 0.1)):
            self._passing_s_m = line_s
            return None
        self._stopping_s_m = line_s
        return left - _STOP_BEFORE_LINE_M

    def _drives_off(self, view: DriverView, stop_m: float | None) -> bool:
        """Whether the standing car starts now: the road is free and the driver has taken note."""
        leader = self._leader
        blocked = stop_m is not None and stop_m < 1.5
        if leader is not None and leader.gap_m < self._speed.style.gap_m + 1.0:
            blocked = True
        if blocked:
            self._free_since = None
            return False
        if self._free_since is None:
            self._free_since = view.tick
            reaction_s = 0.7 + 0.15 * float(self._random.normal())
            self._go_tick = view.tick + round(min(1.2, max(0.4, reaction_s)) * TICK_HZ)
        # At the beginning the driver waits, ready to go.
        if view.tick < max(self._go_tick, round(STANDSTILL_S * TICK_HZ)):
            return False
        self._standing, self._is_launching = False, True
        return True
