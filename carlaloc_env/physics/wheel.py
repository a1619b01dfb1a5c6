"""Four corners of the car: unsprung mass between spring and tyre, wheel spin, road under three places.

A wheel moves along the body's z axis. All vectors are in body axes about the centre of mass, all states
advance semi-implicitly at 200 Hz: positions with the newest speeds, forces from the newest positions.
"""

from math import sqrt
from typing import Any

from carlaloc_env.core.array_types import GRAVITY_MPS2, Array
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.elementary_kernels import arctan, sin_cos, tan
from carlaloc_env.core.jit import compiled
from carlaloc_env.physics.car_tables import PLACES, CarTables
from carlaloc_env.physics.ground_heights import GroundTable, highest_below
from carlaloc_env.physics.tyre import advance_tyre, lateral_mu
from carlaloc_env.road.road_profile import RoughTable, rough_height

_LOOK_ABOVE_M = 0.5
"""The road is looked for from so far above the hub [m]."""
_LOOK_BELOW_M = 1.0
"""And down to so far below it [m]."""
BodyMotion = tuple[
    float, float, float, float, float, float, float, float, float,
    float, float, float, float, float, float, float, float, float,
]  # fmt: skip
"""Motion of the body: position of the centre of mass [m] in the world, rotation body → world row by
row, velocity [m/s] and rate [rad/s] in body axes."""


@compiled
def _look_down(wheel: Any, car: Any, motion: BodyMotion, ground: GroundTable, hits: Array) -> None:
    """Advance the travel of a wheel and find the road below its middle and both ends of its envelope.

    Args:
        wheel: The wheel.
        car: The car.
        motion: Motion of the body.
        ground: The town's mesh.
        hits: Written: 1 or 0 for no road, its height [m] and normal, rear, centre, front, shape (3, 5).
    """
    px, py, pz, r11, r12, r13, r21, r22, r23, r31, r32, r33, _, _, vz, wx, wy, _ = motion
    x, y = wheel.x, wheel.y
    wheel.travel_m += (wheel.speed_z - (vz + wx * y - wy * x)) * TICK_S
    z = wheel.hub_z + wheel.travel_m
    hx = px + r11 * x + r12 * y + r13 * z
    hy = py + r21 * x + r22 * y + r23 * z
    hz = pz + r31 * x + r32 * y + r33 * z
    wheel.hub_x, wheel.hub_y, wheel.hub_z_world = hx, hy, hz
    ex, ey = car.envelope_m * r11, car.envelope_m * r21
    for n in range(PLACES):
        side = float(n - 1)
        east, north = hx + side * ex, hy + side * ey
        number, height = highest_below(ground, east, north, hz + _LOOK_ABOVE_M, hz - _LOOK_BELOW_M)
        hits[n, 0], hits[n, 1] = 1.0 if number >= 0 else 0.0, height
        if number >= 0:
            for axis in range(3):
                hits[n, 2 + axis] = ground.normal[number, axis]


@compiled
def advance_wheels(tables: CarTables, motion: BodyMotion, ground: GroundTable, rough: RoughTable) -> None:
    """Advance the wheels by one tick and add what they do to the body to `tables.push`.

    Args:
        tables: The car.
        motion: Motion of the body now.
        ground: The town's mesh.
        rough: What lies on the roads beyond the town's mesh.
    """
    car, drive, wheels = tables.car[0], tables.drive[0], tables.wheels
    hits, push, forward_mps = tables.hits, tables.push, motion[12]
    radius = car.wheel_radius_m - 0.02
    # Ackermann: all wheels turn about one point on the rear axle's line.
    slope = tan(drive.steer_rad)
    half = 0.5 * car.track_m * slope / car.wheelbase_m
    left, right = arctan(slope / (1.0 - half)), arctan(slope / (1.0 + half))
    front = 0.5 * car.brake_front * drive.brake_n * radius
    rear = 0.5 * (1.0 - car.brake_front) * drive.brake_n * radius
    motor = 0.5 * drive.motor_n * radius
    if motor * forward_mps < 0.0 and abs(forward_mps) > 0.5:
        # A motor that slows the car can stop a wheel, not turn it back.
        rear, motor = rear + abs(motor), 0.0
    # All wheels first: the anti-roll bars couple those of an axle.
    for k in range(4):
        _look_down(wheels[k], car, motion, ground, hits[k])
    bar_front = car.bar_front * (wheels[0].travel_m - wheels[1].travel_m)
    bar_rear = car.bar_rear * (wheels[2].travel_m - wheels[3].travel_m)
    for k in range(4):
        wheel = wheels[k]
        is_front, is_left = k < 2, k % 2 == 0
        steer = (left if is_left else right) if is_front else 0.0
        bar = bar_front if is_front else bar_rear
        above = rough_height(rough, wheel.hub_x, wheel.hub_y)
        v_long, v_lat = _load(wheel, car, motion, hits[k], above, steer)
        advance_tyre(wheel, car, v_long, wheel.spin_radps * wheel.radius_m - v_long, -v_lat, drive.mu)
        if is_front:
            _spin(wheel, car, 0.0, front, 0.0, drive.mu)
        else:
            _spin(wheel, car, motor, rear, drive.handbrake_nm, drive.mu)
        _spring(wheel, car, motion, steer, bar if is_left else -bar)
        x, y, z = wheel.x, wheel.y, wheel.contact_z
        push[0] += wheel.force_x
        push[1] += wheel.force_y
        push[2] += wheel.force_spring
        push[3] += y * wheel.force_spring - z * wheel.force_y
        push[4] += z * wheel.force_x - x * wheel.force_spring
        push[5] += x * wheel.force_y - y * wheel.force_x


@compiled
def _axes(
    wheel: Any, motion: BodyMotion, steer_rad: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Axes of a wheel in the road plane, in body axes: the road's normal n, t along the wheel, s = n × t."""
    _, _, _, r11, r12, r13, r21, r22, r23, r31, r32, r33, _, _, _, _, _, _ = motion
    gx, gy, gz = wheel.normal_x, wheel.normal_y, wheel.normal_z
    nx = r11 * gx + r21 * gy + r31 * gz
    ny = r12 * gx + r22 * gy + r32 * gz
    nz = r13 * gx + r23 * gy + r33 * gz
    ty, tx = sin_cos(steer_rad)
    along = tx * nx + ty * ny
    tx, ty, tz = tx - along * nx, ty - along * ny, -along * nz
    scale = 1.0 / sqrt(tx * tx + ty * ty + tz * tz)
    tx, ty, tz = tx * scale, ty * scale, tz * scale
    sx, sy, sz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
    return nx, ny, nz, tx, ty, tz, sx, sy, sz


@compiled
def _load(
    wheel: Any, car: Any, motion: BodyMotion, hits: Array, rough_m: float, steer_rad: float
) -> tuple[float, float]:
    """Set the load of a tyre; speed of the contact patch along the wheel and to its left [m/s]."""
    _, _, _, r11, r12, r13, r21, r22, r23, _, _, _, vx, vy, _, wx, wy, wz = motion
    x, y = wheel.x, wheel.y
    wheel.contact_z = cz = wheel.hub_z + wheel.travel_m - wheel.radius_m
    ux, uy, uz = vx + wy * cz - wz * y, vy + wz * x - wx * cz, wheel.speed_z
    on_road = _road(wheel, car, hits, r11 * ux + r12 * uy + r13 * uz, r21 * ux + r22 * uy + r23 * uz)
    nx, ny, nz, tx, ty, tz, sx, sy, sz = _axes(wheel, motion, steer_rad)
    load = 0.0
    if on_road:
        squeeze = car.wheel_radius_m - (wheel.hub_z_world - wheel.height_m - rough_m) * wheel.normal_z
        if squeeze > 0.0:
            load = car.tyre_npm * squeeze - car.tyre_nspm * (ux * nx + uy * ny + uz * nz)
            load = load if load > 0.0 else 0.0
    wheel.load_n = load
    return ux * tx + uy * ty + uz * tz, ux * sx + uy * sy + uz * sz


@compiled
def _road(wheel: Any, car: Any, hits: Array, v_east: float, v_north: float) -> bool:
    """Follow the road under a wheel: tyre envelope over the rays, spread over some travel."""
    is_road, height = False, 0.0
    for n in range(PLACES):
        if hits[n, 0] > 0.0:
            h = hits[n, 1] - (0.0 if n == 1 else car.drop_m)
            if not is_road or h > height:
                is_road, height = True, h
    if not is_road:
        wheel.on_road = 0.0
        return False
    was_road = wheel.on_road > 0.0
    a = (sqrt(v_east * v_east + v_north * v_north) + 0.05) * TICK_S / car.smoothing_m
    gain = a / (1.0 + a)
    nx, ny, nz = wheel.normal_x, wheel.normal_y, wheel.normal_z
    mx, my, mz = hits[1, 2], hits[1, 3], hits[1, 4]
    if hits[1, 0] > 0.0 and mz > 0.3:
        gain_n = gain * 0.25
        nx, ny, nz = nx + gain_n * (mx - nx), ny + gain_n * (my - ny), nz + gain_n * (mz - nz)
        if not was_road:
            nx, ny, nz = mx, my, mz
        scale = 1.0 / sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * scale, ny * scale, nz * scale
        wheel.normal_x, wheel.normal_y, wheel.normal_z = nx, ny, nz
    if was_road:
        # Follow the plane first, so that a constant slope leaves no lag.
        ahead = wheel.height_m - (nx * v_east + ny * v_north) / nz * TICK_S
        height = ahead + gain * (height - ahead)
    wheel.height_m, wheel.on_road = height, 1.0
    return True


@compiled
def _spin(wheel: Any, car: Any, drive_nm: float, brake_nm: float, park_nm: float, mu: float) -> None:
    """Advance the spin of a wheel.

    Args:
        wheel: The wheel.
        car: The car.
        drive_nm: Motor torque [N m].
        brake_nm: Brake torque asked for, before slip control [N m].
        park_nm: Handbrake torque, without slip control [N m].
        mu: Friction factor.
    """
    load, radius = wheel.load_n, wheel.radius_m
    side = wheel.force_lat_n / (lateral_mu(car, load) * mu * load) if load > 0.0 else 0.0
    grip = car.slip_control * car.mu_long * mu * load * radius * sqrt(max(0.1, 1.0 - side * side))
    drive = max(-grip, min(grip, drive_nm))
    hold = min(brake_nm, grip) + park_nm + car.rolling * load * radius
    rate = TICK_S / car.wheel_inertia_kgm2
    spin = wheel.spin_radps + rate * (drive - radius * wheel.force_long_n)
    slow = rate * hold
    wheel.spin_radps = 0.0 if abs(spin) <= slow else spin - slow if spin > 0.0 else spin + slow


@compiled
def _spring(wheel: Any, car: Any, motion: BodyMotion, steer_rad: float, anti_roll_n: float) -> None:
    """Set the forces of a corner on the body and advance its unsprung mass."""
    r33, vx, vy, vz, wx, wy, wz = motion[11:]
    x, y, d = wheel.x, wheel.y, wheel.travel_m
    nx, ny, nz, tx, ty, tz, sx, sy, sz = _axes(wheel, motion, steer_rad)
    spring = wheel.preload_n + wheel.spring_npm * d + anti_roll_n
    spring += wheel.damper_nspm * (wheel.speed_z - (vz + wx * y - wy * x))
    if d > car.bump_stop_m:
        spring += car.stop_npm * (d - car.bump_stop_m)
    elif d < -car.rebound_stop_m:
        spring += car.stop_npm * (d + car.rebound_stop_m)
    load, f_long, f_lat = wheel.load_n, wheel.force_long_n, wheel.force_lat_n
    wheel.force_spring = spring
    wheel.force_x = load * nx + f_long * tx + f_lat * sx
    wheel.force_y = load * ny + f_long * ty + f_lat * sy
    force_z = load * nz + f_long * tz + f_lat * sz
    cz = wheel.contact_z
    ux, uy = vx + wy * cz - wz * y, vy + wz * x - wx * cz
    # The z axis turns with the body: d(v·z)/dt = a·z + v·(ω × z).
    lift_mps2 = (force_z - spring) / wheel.unsprung_kg - GRAVITY_MPS2 * r33
    wheel.speed_z += TICK_S * (lift_mps2 + ux * wy - uy * wx)
