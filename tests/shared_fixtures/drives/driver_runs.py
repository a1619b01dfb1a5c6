"""The scripted driver in the real car on a plane: routes of arcs, and a log of every tick."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_TICKS, TICK_HZ, TICK_S
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.map.routing.route import Route
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.traffic.signals import SignalState
from recorder.devices.scripted.driver import ScriptedDriver

FRONT_M = 3.75
"""From base_link to the front bumper."""


COLUMNS = ("time", "s", "offset", "speed", "acceleration", "throttle", "brake", "wheel_deg", "line", "gap")


RIGHT_ANGLE = math.pi / 2


def route_of(pieces: Sequence[tuple[float, float]], limit_mps: float, *, closed: bool = False) -> Route:
    """Route of (length, curvature) pieces that begins eastwards at the origin.

    Curvature changes over 4 m, as on roads with short clothoids.
    """
    length = sum(piece[0] for piece in pieces)
    count = round(length / 0.5)
    fine = 20
    s = np.arange(count * fine + 1) * length / (count * fine)
    ends = np.cumsum([piece[0] for piece in pieces])
    curvature = np.array([piece[1] for piece in pieces])[
        np.minimum(np.searchsorted(ends, s), len(pieces) - 1)
    ]
    window = round(4.0 / (s[1] - s[0])) | 1
    padded = np.pad(curvature, window // 2, mode="edge")
    curvature = np.convolve(padded, np.ones(window) / window, "valid")
    step = np.diff(s)
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * step)])
    middle = 0.5 * (heading[1:] + heading[:-1])
    x = np.concatenate([[0.0], np.cumsum(np.cos(middle) * step)])[::fine]
    y = np.concatenate([[0.0], np.cumsum(np.sin(middle) * step)])[::fine]
    keep = slice(None, -1) if closed else slice(None)
    zero = np.zeros(len(x))
    return Route(
        position_m=np.stack([x, y, zero], axis=-1)[keep],
        heading_rad=np.arctan2(np.sin(heading[::fine]), np.cos(heading[::fine]))[keep],
        slope=zero[keep],
        curvature_radpm=curvature[::fine][keep],
        speed_limit_mps=(zero + limit_mps)[keep],
        lane=np.zeros(len(x), np.int64)[keep],
        lane_station_m=s[::fine][keep],
        length_m=length,
        closed=closed,
    )


def drive(
    route: Route,
    seconds: float,
    *,
    driver: ScriptedDriver | None = None,
    line_s_m: float | None = None,
    light: Callable[[float], SignalState] = lambda t: SignalState.GREEN,
    leader: Callable[[float], tuple[float, float] | None] = lambda t: None,
    slope: float = 0.0,
) -> dict[str, Array]:
    """One drive with the real car; the world's view comes in 50 ms steps as in the environment.

    Args:
        route: Where to go.
        seconds: How long.
        driver: Who drives.
        line_s_m: Stop line on the route.
        light: Its light over time.
        leader: Distance along the route of a leader's rear, and its speed, over time.
        slope: Rise of the plane towards the east.
    """
    driver = driver if driver is not None else ScriptedDriver(3)
    corners = np.array([[-200.0, -700, 0], [1500, -700, 0], [1500, 700, 0], [-200, 700, 0]])
    corners[:, 2] = slope * corners[:, 0]
    rows = []
    with PhysicsWorld(corners, np.array([[0, 1, 2], [0, 2, 3]])) as world:
        car = EgoCar(world)
        state = car.reset(route.position_m[0], float(route.heading_rad[0]))
        progress = offset = speed_ahead = 0.0
        gap: float | None = None
        for tick in range(round(seconds * TICK_HZ)):
            time = tick * TICK_S
            if tick % STEP_TICKS == 0:
                near = progress % route.length_m if route.closed else progress
                s, offset = route.project(state.position_m, near)
                progress += math.remainder(s - near, route.length_m) if route.closed else s - near
                ahead = leader(time)
                gap = None if ahead is None else ahead[0] - progress - FRONT_M
                speed_ahead = 0.0 if ahead is None else ahead[1]
                gap = gap if gap is not None and gap < 100.0 else None
            left = None if line_s_m is None else line_s_m - progress - FRONT_M
            left = left if left is not None and -4.0 < left < 100.0 else None
            view = DriverView(
                tick=tick, position_m=state.position_m, heading_rad=state.heading_rad,
                speed_mps=state.speed_mps, acceleration_mps2=state.acceleration_mps2,
                route=route, route_s_m=progress, offset_m=offset, stop_line_distance_m=left,
                speed_limit_mps=float(route.speed_limit_mps[0]), leader_gap_m=gap,
                signal_state=0 if left is None else int(light(time)), leader_speed_mps=speed_ahead,
            )  # fmt: skip
            controls = driver.read(view)
            car.tick(controls)
            state = car.state()
            wheel = math.degrees(controls.steer * car.params.steer_max_rad) * car.params.steering_ratio
            pedals = controls.throttle, controls.brake
            far = [np.nan if way is None else way for way in (left, gap)]
            rows.append(
                (time, progress, offset, state.speed_mps, state.acceleration_mps2, *pedals, wheel, *far)
            )
    return dict(zip(COLUMNS, np.array(rows, dtype=np.float64).T, strict=True))


def jerk(acceleration: Array) -> Array:
    """Longitudinal jerk [m/s³] of acceleration smoothed over 0.5 s."""
    window = round(0.5 * TICK_HZ)
    return np.diff(np.convolve(acceleration, np.ones(window) / window, "valid")) * TICK_HZ
