"""The scripted driver in the real car on a flat plane, judged by bands of human driving."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_TICKS, TICK_HZ, TICK_S
from carlaloc_env.core.controls import Controls
from carlaloc_env.core.ego_car import EGO_SIZE_M
from carlaloc_env.core.errors import DeviceError
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.params import VehicleParams
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.town.routing.route import Route
from carlaloc_env.traffic.signals import SignalState
from recorder.devices.registry import open_device
from recorder.devices.scripted.driver import ScriptedDriver
from recorder.devices.scripted.pedals import DriverPedals
from recorder.devices.scripted.route_profile import DriverRoute

FRONT_M = 3.75
"""From base_link to the front bumper."""
COLUMNS = ("time", "s", "offset", "speed", "acceleration", "throttle", "brake", "wheel_deg", "line", "gap")


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
            controls = driver.read(
                DriverView(
                    tick=tick,
                    position_m=state.position_m,
                    heading_rad=state.heading_rad,
                    speed_mps=state.speed_mps,
                    acceleration_mps2=state.acceleration_mps2,
                    route=route,
                    route_s_m=progress,
                    offset_m=offset,
                    speed_limit_mps=float(route.speed_limit_mps[0]),
                    stop_line_distance_m=left,
                    signal_state=0 if left is None else int(light(time)),
                    leader_gap_m=gap,
                    leader_speed_mps=speed_ahead,
                )
            )
            car.tick(controls)
            state = car.state()
            wheel = math.degrees(controls.steer * car.params.steer_max_rad) * car.params.steering_ratio
            rows.append(
                (
                    time,
                    progress,
                    offset,
                    state.speed_mps,
                    state.acceleration_mps2,
                    controls.throttle,
                    controls.brake,
                    wheel,
                    np.nan if left is None else left,
                    np.nan if gap is None else gap,
                )
            )
    return dict(zip(COLUMNS, np.array(rows, dtype=np.float64).T, strict=True))


def jerk(acceleration: Array) -> Array:
    """Longitudinal jerk [m/s³] of acceleration smoothed over 0.5 s."""
    window = round(0.5 * TICK_HZ)
    return np.diff(np.convolve(acceleration, np.ones(window) / window, "valid")) * TICK_HZ


def held_still(log: dict[str, Array]) -> float:
    """Fraction of the driving time in which the wheel turns slower than 1°/s."""
    rate = np.abs(np.diff(log["wheel_deg"])) * TICK_HZ
    return float(np.mean(rate[log["speed"][1:] > 1.0] < 1.0))


def power_above_1_hz(wheel_deg: Array) -> float:
    """Fraction of the steering power above 1 Hz."""
    power = np.abs(np.fft.rfft((wheel_deg - wheel_deg.mean()) * np.hanning(len(wheel_deg)))) ** 2
    frequency = np.fft.rfftfreq(len(wheel_deg), TICK_S)
    return float(power[frequency > 1.0].sum() / power[frequency > 0.0].sum())


RIGHT_ANGLE = math.pi / 2
TOWN = (
    (150.0, 0.0),
    (RIGHT_ANGLE * 13, 1 / 13),
    (120.0, 0.0),
    (RIGHT_ANGLE * 10, -1 / 10),
    (130.0, 0.0),
    (70.0, 1 / 60),
    (60.0, 0.0),
    (70.0, -1 / 60),
    (120.0, 0.0),
)


def town_light(time: float) -> SignalState:
    """Red until 38 s, then green."""
    return SignalState.RED if time < 38.0 else SignalState.GREEN


@pytest.fixture(scope="module")
def town() -> dict[str, Array]:
    """Straights, two junction turns, two bends of R 60 and a red light, 110 s."""
    return drive(route_of(TOWN, 13.9), 110.0, line_s_m=230.0, light=town_light)


@pytest.fixture(scope="module")
def straight() -> dict[str, Array]:
    """70 s along a straight street at 50 km/h."""
    return drive(route_of([(1000.0, 0.0)], 13.9), 70.0)


def test_begins_with_two_seconds_of_rest(town: dict[str, Array]) -> None:
    still = town["time"] < 2.0
    assert np.abs(town["speed"][still]).max() < 1e-3
    assert np.all(town["brake"][still] > 0.1)
    assert town["speed"][town["time"] < 6.0].max() > 1.0


def test_drives_smoothly(town: dict[str, Array], straight: dict[str, Array]) -> None:
    """Jerk below 3 m/s³ at p99, accelerations of calm town driving."""
    for log in (town, straight):
        assert np.percentile(np.abs(jerk(log["acceleration"])), 99) < 3.0
        assert np.percentile(log["acceleration"], 0.5) > -3.0
        assert log["acceleration"].max() < 2.5
        assert np.abs(jerk(log["acceleration"])).max() < 5.0


def test_keeps_its_lane_as_people_do(straight: dict[str, Array]) -> None:
    """Neither glued to the centre nor wandering."""
    moving = straight["speed"] > 5.0
    assert 0.1 < straight["offset"][moving].std() < 0.3
    assert np.abs(straight["offset"]).max() < 0.8
    assert straight["speed"].max() == pytest.approx(0.97 * 13.9, abs=0.6)


def test_stays_in_its_lane_in_turns(town: dict[str, Array]) -> None:
    """Never more than 1 m off, slow enough for people to sit comfortably."""
    assert np.abs(town["offset"]).max() < 1.0
    edges = np.cumsum([0.0] + [piece[0] for piece in TOWN])
    for k, (_, curvature) in enumerate(TOWN):
        inside = (town["s"] > edges[k]) & (town["s"] < edges[k + 1])
        assert inside.any()
        if curvature:
            lateral = town["speed"][inside] ** 2 * abs(curvature)
            assert 1.5 < np.median(lateral) < 3.0
            assert lateral.max() < 3.5


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_tight_turns_are_driven_inside(sense: float) -> None:
    """In a turn of R 5 the outer front corner and the inner side keep equal distances from the lane's centre.

    Wide turns and straights are driven in the middle.
    """
    radius, half_width = 5.0, 0.5 * EGO_SIZE_M[1]
    route = route_of([(40.0, 0.0), (math.pi * radius, sense / radius), (40.0, 0.0)], 11.0)
    road = DriverRoute(route, 1.0)
    middle_m = 40.0 + 0.5 * math.pi * radius
    x, y, _ = route.at(middle_m).position_m[0]
    _, outside = road.locate(float(x), float(y), middle_m)
    shift = -sense * outside
    corner = math.hypot(radius - shift + half_width, FRONT_M) - radius
    assert corner == pytest.approx(half_width + shift, abs=0.1)
    assert corner < math.hypot(radius + half_width, FRONT_M) - radius - 0.4
    x, y, _ = route.at(20.0).position_m[0]
    assert road.locate(float(x), float(y), 20.0)[1] == pytest.approx(0.0, abs=1e-6)
    wide = route_of([(40.0, 0.0), (RIGHT_ANGLE * 10.0, sense / 10.0), (40.0, 0.0)], 11.0)
    x, y, _ = wide.at(48.0).position_m[0]
    assert DriverRoute(wide, 1.0).locate(float(x), float(y), 48.0)[1] == pytest.approx(0.0, abs=0.03)


def test_holds_the_wheel_still(town: dict[str, Array], straight: dict[str, Array]) -> None:
    """The two figures that tell people from controllers (a lane keeper: 2 % still, 77 % above 1 Hz)."""
    assert held_still(straight) > 0.6
    both = np.concatenate([straight["wheel_deg"], town["wheel_deg"]])
    rate = np.abs(np.diff(both)) * TICK_HZ
    assert np.mean(rate < 1.0) > 0.5
    for log in (town, straight):
        assert power_above_1_hz(log["wheel_deg"]) < 0.05
    assert np.abs(np.diff(town["wheel_deg"])).max() * TICK_HZ < 500.0


def test_stops_before_the_line_and_drives_off_on_green(town: dict[str, Array]) -> None:
    red = town["time"] < 38.0
    standing = red & (town["time"] > 6.0) & (np.abs(town["speed"]) < 0.01)
    assert standing.any()
    assert 0.3 < town["line"][standing].min() <= town["line"][standing].max() < 3.0
    after = town["time"][(town["time"] > 38.0) & (town["speed"] > 0.2)][0]
    assert 38.3 < after < 40.5


def test_stops_at_the_end_of_an_open_route(town: dict[str, Array]) -> None:
    length = sum(piece[0] for piece in TOWN)
    assert abs(town["speed"][-1]) < 0.01
    assert length - 3.0 < town["s"][-1] < length


def test_one_foot_for_two_pedals(town: dict[str, Array]) -> None:
    """Never both pedals, and at least 0.3 s between them; a foot needs time to press."""
    throttle, brake = town["throttle"] > 0.02, town["brake"] > 0.02
    assert not np.any(throttle & brake)
    last_throttle, last_brake = -1e9, -1e9
    for tick in range(len(throttle)):
        if throttle[tick]:
            assert tick - last_brake > 0.3 * TICK_HZ
            last_throttle = tick
        if brake[tick]:
            assert tick - last_throttle > 0.3 * TICK_HZ
            last_brake = tick
    for pedal in ("throttle", "brake"):
        assert np.abs(np.diff(town[pedal])).max() * TICK_HZ < 4.0


@pytest.mark.parametrize("turns_yellow_s", [13.5, 16.0, 17.0])
def test_yellow_light(turns_yellow_s: float) -> None:
    """Either stands before the line or has passed it before red; never stops on it."""

    def light(time: float) -> SignalState:
        if time < turns_yellow_s:
            return SignalState.GREEN
        return SignalState.YELLOW if time < turns_yellow_s + 3.0 else SignalState.RED

    log = drive(route_of([(500.0, 0.0)], 13.9), 29.0, line_s_m=150.0, light=light)
    if log["s"][-1] + FRONT_M < 150.0:
        assert abs(log["speed"][-1]) < 0.01
        assert 0.3 < log["line"][-1] < 3.0
        assert log["acceleration"].min() > -4.5
    else:
        passed = log["time"][log["s"] + FRONT_M > 150.0][0]
        assert passed < turns_yellow_s + 3.0
        assert log["speed"][log["time"] > 10.0].min() > 5.0


@pytest.mark.parametrize("line_m", [8.0, 20.0])
def test_a_red_light_near_the_start(line_m: float) -> None:
    """Drives up to it and stands before it, softly: the last jerk stays below 3 m/s³."""
    log = drive(
        route_of([(200.0, 0.0)], 8.3), 17.0, line_s_m=line_m + FRONT_M, light=lambda t: SignalState.RED
    )
    assert log["speed"].max() > 1.5
    assert abs(log["speed"][-1]) < 0.01
    assert 0.3 < log["line"][-1] < 3.0
    assert np.abs(jerk(log["acceleration"])).max() < 3.0


def following(
    gap_m: float, times: list[float], speeds: list[float]
) -> Callable[[float], tuple[float, float]]:
    """A leader that starts some metres ahead and drives given speeds."""
    grid = np.arange(0.0, 200.0, TICK_S)
    speed = np.interp(grid, times, speeds)
    place = FRONT_M + gap_m + np.cumsum(speed) * TICK_S
    return lambda time: (float(place[round(time * TICK_HZ)]), float(speed[round(time * TICK_HZ)]))


@pytest.mark.parametrize(
    ("times", "speeds"),
    [
        ([0.0, 4.0, 30.0, 34.0, 42.0, 48.0], [0.0, 9.0, 9.0, 0.0, 0.0, 10.0]),
        ([0.0, 5.0, 30.0, 32.2, 200.0], [0.0, 12.0, 12.0, 0.0, 0.0]),
    ],
)
def test_never_hits_the_leader(times: list[float], speeds: list[float]) -> None:
    """Follows at a distance, stops behind, even when the leader brakes with 5.5 m/s²."""
    log = drive(route_of([(900.0, 0.0)], 13.9), 55.0, leader=following(14.0, times, speeds))
    assert np.nanmin(log["gap"]) > 1.5
    cruising = (log["time"] > 24.0) & (log["time"] < 30.0)
    headway = log["gap"][cruising] / log["speed"][cruising]
    assert 1.0 < headway.min() <= headway.max() < 6.0
    standing = (log["time"] > 39.0) & (log["time"] < 42.0)
    if speeds[-1] == 0.0:
        standing = log["time"] > 52.0
    assert np.abs(log["speed"][standing]).max() < 0.1
    assert log["gap"][standing].max() < 6.0
    if speeds[-1] > 0.0:
        assert log["speed"][-1] > 3.0
        assert np.percentile(np.abs(jerk(log["acceleration"])), 99) < 3.0


def test_brakes_hard_for_what_appears_suddenly() -> None:
    """A standing car 24 m ahead at 45 km/h is not hit."""
    place: list[float] = []
    driver = ScriptedDriver(0)
    route = route_of([(600.0, 0.0)], 13.0)

    def leader(time: float) -> tuple[float, float] | None:
        if time < 18.0:
            return None
        if not place:
            place.append(seen["s"] + FRONT_M + 24.0)
        return place[0], 0.0

    seen = {"s": 0.0}
    read = driver.read

    def watched(view: DriverView) -> Controls:
        seen["s"] = view.route_s_m
        return read(view)

    driver.read = watched  # type: ignore[method-assign]
    log = drive(route, 30.0, driver=driver, leader=leader)
    assert log["speed"][log["time"] < 18.0].max() > 12.0
    assert abs(log["speed"][-1]) < 0.01
    assert np.nanmin(log["gap"]) > 0.5


def test_goes_round_a_closed_route() -> None:
    """More than a lap of a block, with the distance along the route growing on."""
    block = route_of([(60.0, 0.0), (RIGHT_ANGLE * 12, 1 / 12)] * 4, 11.0, closed=True)
    log = drive(block, 70.0)
    assert log["s"][-1] > 1.2 * block.length_m
    assert np.abs(log["offset"]).max() < 1.0
    assert log["speed"][log["time"] > 8.0].min() > 3.0


@pytest.mark.parametrize("slope", [0.1, -0.1])
def test_stops_and_starts_on_a_hill(slope: float) -> None:
    """A red light on 10 %: stands before the line, rolls back no more than a hand's breadth."""
    route = route_of([(400.0, 0.0)], 11.0)
    position = route.position_m.copy()
    position[:, 2] = slope * position[:, 0]
    route = replace(route, position_m=position, slope=route.slope + slope)
    log = drive(
        route,
        40.0,
        line_s_m=110.0,
        light=lambda t: SignalState.RED if t < 30.0 else SignalState.GREEN,
        slope=slope,
    )
    assert 0.3 < log["line"][(log["time"] > 28.0) & (log["time"] < 30.0)].min() < 3.0
    assert np.sum(np.minimum(log["speed"], 0.0)) * TICK_S > -0.1
    assert log["speed"][-1] > 5.0


@pytest.mark.parametrize("slope", [-0.03, -0.06])
def test_does_not_creep_down_a_hill(slope: float) -> None:
    """At the end of a route the car comes to rest, also where the road falls more than it looks."""
    route = route_of([(100.0, 0.0)], 8.0)
    position = route.position_m.copy()
    position[:, 2] = slope * position[:, 0]
    log = drive(replace(route, position_m=position), 40.0, slope=slope)
    assert np.abs(log["speed"][-5 * TICK_HZ :]).max() < 0.01
    assert route.length_m - 3.0 < log["s"][-1]


def test_same_seed_same_controls() -> None:
    """Two drivers of a seed, and one driver used twice, do exactly the same; another seed does not."""
    route = route_of([(60.0, 0.0), (RIGHT_ANGLE * 12, 1 / 12), (60.0, 0.0)], 11.0)
    driver = ScriptedDriver(5)
    logs = [drive(route, 14.0, driver=d) for d in (driver, driver, ScriptedDriver(5), ScriptedDriver(6))]
    for name in COLUMNS:
        assert logs[0][name].tobytes() == logs[1][name].tobytes() == logs[2][name].tobytes()
    assert not np.array_equal(logs[0]["wheel_deg"], logs[3]["wheel_deg"])


def test_pedals_give_the_acceleration_asked_for() -> None:
    """The foot's model of the car agrees with the car: 1 m/s² asked, 1 m/s² felt."""
    corners = np.array([[-50.0, -50, 0], [600, -50, 0], [600, 50, 0], [-50, 50, 0]])
    with PhysicsWorld(corners, np.array([[0, 1, 2], [0, 2, 3]])) as world:
        car = EgoCar(world)
        state = car.reset((0.0, 0.0, 0.0), 0.0)
        pedals = DriverPedals(VehicleParams())
        felt = []
        for tick in range(1600):
            wanted = 1.0 if tick < 1000 else -1.2
            throttle, brake = pedals.drive(
                wanted, 0.0, speed_mps=state.speed_mps, perceived_mps2=state.acceleration_mps2, grade=0.0
            )
            car.tick(Controls(throttle=throttle, brake=brake))
            state = car.state()
            felt.append(state.acceleration_mps2)
        assert np.mean(felt[600:1000]) == pytest.approx(1.0, abs=0.06)
        assert np.mean(felt[1300:1500]) == pytest.approx(-1.2, abs=0.08)


def test_devices_by_name() -> None:
    device = open_device("scripted", 1)
    assert device.name == "scripted"
    device.close()
    device.close()
    with pytest.raises(DeviceError, match="did you mean 'scripted'"):
        open_device("skripted", 1)
