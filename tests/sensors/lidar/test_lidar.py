"""The LiDAR against closed forms, and against what SLAM front-ends expect of it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import PointCloud
from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.ground_truth.ego_truth import truth_at
from carlaloc_env.sensors.lidar.config import HDL32E_ELEVATIONS_DEG, HDL32E_FIRING_NS

pytest.importorskip("open3d", reason="open3d is not installed")
lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")

HEIGHT = 1.85
MOUNT = Mount(position_m=(1.2, 0.0, HEIGHT))
HDL32E: dict[str, Any] = {
    "elevations_deg": HDL32E_ELEVATIONS_DEG,
    "firing_ns": HDL32E_FIRING_NS,
    "columns": 1085,
}


def paper(**changes: Any) -> Any:
    return lidar.LidarConfig(**{"mount": MOUNT, **changes})


def sweep(world: Any, drive: Any, config: Any, stamp_ns: int = 0) -> tuple[PointCloud, PointCloud]:
    clouds = config.build(world).measure(drive, [stamp_ns])
    return clouds[0], clouds[1]


def directions(cloud: PointCloud) -> Array:
    p = cloud.points_xyz_m.astype(np.float64)
    return p / np.linalg.norm(p, axis=-1, keepdims=True)


def poses(drive: Any, cloud: PointCloud, mount: Mount = MOUNT) -> Array:
    """True pose of the LiDAR at the time of each point."""
    times, back = np.unique(cloud.stamp_ns + cloud.offset_ns.astype(np.int64), return_inverse=True)
    return drive.ego_motion(times).at_mount(mount.T_base_sensor).T_world_frame[back]


def test_room_of_four_walls(scenery: Any) -> None:
    """Every range in a room equals the closed form; every ray returns; 32 elevations, full circle."""
    room = [
        scenery.ground(50),
        scenery.box([20, -50, -1], [21, 50, 60]),
        scenery.box([-31, -50, -1], [-30, 50, 60]),
        scenery.box([-50, 15, -1], [50, 16, 60]),
        scenery.box([-50, -26, -1], [50, -25, 60]),
    ]
    cloud, _ = sweep(scenery.world(room), scenery.drive(scenery.straight(), 0.2), paper(range_noise_m=0.0))
    assert len(cloud.points_xyz_m) == 2078 * 32
    d = directions(cloud)
    with np.errstate(divide="ignore"):
        walls = [
            np.where(d[:, 0] > 0, 18.8 / d[:, 0], -31.2 / d[:, 0]),
            np.where(d[:, 1] > 0, 15 / d[:, 1], -25 / d[:, 1]),
            np.where(d[:, 2] < 0, -HEIGHT / d[:, 2], np.inf),
        ]
    r = np.linalg.norm(cloud.points_xyz_m.astype(np.float64), axis=-1)
    assert np.abs(r - np.min(walls, axis=0)).max() < 5e-4
    elevation = np.degrees(np.arcsin(d[:, 2]))
    for ring in range(32):
        assert np.allclose(elevation[cloud.ring == ring], -30 + 40 * ring / 31, atol=1e-4)
    assert cloud.offset_ns.max() == pytest.approx(50e6 * 2077 / 2078, abs=1)
    assert np.all(np.diff(cloud.offset_ns.astype(np.int64)) >= 0)
    azimuth = np.unwrap(np.arctan2(d[cloud.ring == 16, 1], d[cloud.ring == 16, 0]))
    assert np.all(np.diff(azimuth) < 0), "clockwise seen from above"
    assert azimuth[0] - azimuth[-1] == pytest.approx(2 * np.pi * 2077 / 2078, abs=1e-6)


def aloam_ring(cloud: PointCloud) -> NDArray[np.int64]:
    """Ring that A-LOAM computes from a 32-beam cloud, in its own float arithmetic."""
    x, y, z = cloud.points_xyz_m.T
    angle = (np.arctan(z / np.sqrt(x * x + y * y)) * np.float32(180 / np.pi)).astype(np.float32)
    return np.trunc((angle + np.float32(92.0 / 3.0)) * np.float32(3.0 / 4.0)).astype(np.int64)


def test_aloam_ring_formula(scenery: Any) -> None:
    """With +0.02° A-LOAM recovers every ring despite range noise; the bare angles lie on its bin edges."""
    world = scenery.world([scenery.ground(), scenery.box([30, -60, -1], [31, 60, 60])])
    drive = scenery.drive(scenery.straight(8.0), 0.2)
    cloud, _ = sweep(world, drive, paper(**HDL32E, elevation_offset_deg=0.02))
    assert len(np.unique(cloud.ring)) == 32
    assert np.array_equal(aloam_ring(cloud), cloud.ring)
    bare, _ = sweep(world, drive, paper(**HDL32E))
    assert np.mean(aloam_ring(bare) != bare.ring) > 0.05
    even, _ = sweep(world, drive, paper())
    assert len(np.unique(aloam_ring(even))) == 31, "the paper's angles share a bin: beams 15 and 16"


def test_hdl32e_timing(scenery: Any) -> None:
    """Firing order and 1.152 µs steps of the manual; azimuth goes on turning within a column."""
    walls = [scenery.box([-40, -40, -50], [-39, 40, 50]), scenery.box([39, -40, -50], [40, 40, 50])]
    world = scenery.world([*walls, scenery.box([-40, -40, -50], [40, 40, -49])])
    cloud, _ = sweep(world, scenery.drive(scenery.straight(), 0.2), paper(**HDL32E, range_noise_m=0.0))
    offset = cloud.offset_ns.astype(np.int64)
    assert np.all(np.diff(offset) >= 0)
    column = np.searchsorted(np.round(np.arange(1085) * 50e6 / 1085), offset, side="right") - 1
    within = offset - np.round(column * 50e6 / 1085).astype(np.int64)
    firing_order = [0, 16, 1, 17, 2, 18, 3]
    for place, ring in enumerate(firing_order):
        assert np.all(within[cloud.ring == ring] == 1152 * place)
    d = directions(cloud)
    turned = np.pi - np.unwrap(np.arctan2(d[:, 1], d[:, 0])) - np.pi / 1085
    assert np.abs(np.angle(np.exp(1j * (turned - 2 * np.pi * offset / 50e6)))).max() < 2e-5


def test_range_noise_along_the_ray(scenery: Any) -> None:
    """σ = 0.02 m ± 2 %, normal, along the ray: elevation and azimuth stay exact."""
    world = scenery.world([scenery.ground(), scenery.box([20, -90, -1], [21, 90, 60])])
    drive = scenery.drive(scenery.straight(5.0), 0.3)
    clean, noisy = [], []
    for stamp in (0, 50_000_000, 100_000_000):
        clean.append(sweep(world, drive, paper(range_noise_m=0.0), stamp)[0])
        noisy.append(sweep(world, drive, paper(), stamp)[0])
    error = np.concatenate(
        [
            np.linalg.norm(b.points_xyz_m.astype(float), axis=1)
            - np.linalg.norm(a.points_xyz_m.astype(float), axis=1)
            for a, b in zip(clean, noisy, strict=True)
        ]
    )
    assert error.std() == pytest.approx(0.02, rel=0.02)
    assert abs(error.mean()) < 4 * 0.02 / np.sqrt(len(error))
    assert np.mean(np.abs(error) < 0.02) == pytest.approx(0.6827, abs=0.01)
    assert np.abs(directions(clean[0]) - directions(noisy[0])).max() < 1e-6


def test_both_clouds_share_every_coordinate(scenery: Any) -> None:
    """The semantic cloud is the plain cloud with labels, to the byte."""
    world = scenery.world([scenery.ground(), scenery.box([20, -9, 0], [21, 9, 9], instance=5)])
    plain, labelled = sweep(world, scenery.drive(scenery.straight(5.0), 0.2), paper())
    assert (plain.sensor, labelled.sensor) == ("lidar", "lidar_semantic")
    for name in ("points_xyz_m", "intensity", "ring", "offset_ns"):
        assert getattr(plain, name).tobytes() == getattr(labelled, name).tobytes()
    assert plain.tag is None
    assert labelled.tag is not None
    assert labelled.instance is not None
    wall = labelled.points_xyz_m[:, 2] > 0
    assert np.all(labelled.tag[wall] == Tag.BUILDING)
    assert np.all(labelled.instance[wall] == 5)


def test_actors_do_not_move_the_noise_of_other_rays(scenery: Any) -> None:
    """Twins: rays that see no car carry the same bytes, though tall cars add returns before the sky."""
    world = scenery.world([scenery.ground()], {"saloon": scenery.box([-2.3, -0.9, 0.1], [2.3, 0.9, 4.4])})
    frame = scenery.frame([[12, 3, 0], [-8, -4, 0]], [0.0, 1.0])
    busy = scenery.drive(scenery.straight(5.0), 0.2, scenery.catalog(["saloon"] * 2), lambda t: frame)
    full = sweep(world, busy, paper())[1]
    empty = sweep(world, busy.select_actors(np.zeros(0, np.intp)), paper())[1]
    assert full.instance is not None
    key = {
        (int(o), int(r)): p.tobytes()
        for o, r, p in zip(empty.offset_ns, empty.ring, empty.points_xyz_m, strict=True)
    }
    static = full.instance < EGO_INSTANCE
    assert len(full.ring) > len(empty.ring) + 100
    assert np.count_nonzero(~static) > 100
    for o, r, p in zip(full.offset_ns[static], full.ring[static], full.points_xyz_m[static], strict=True):
        assert key[int(o), int(r)] == p.tobytes()


@pytest.mark.parametrize("model", [{}, HDL32E], ids=["paper", "hdl32e"])
def test_deskewing_with_truth_flattens_a_wall(scenery: Any, model: dict[str, Any]) -> None:
    """At 20 m/s in a bend: with the truth of each point's time 3σ hold; with one pose they do not."""

    def path(t: Array) -> tuple[Array, Array]:
        yaw = 0.6 * t
        x, y = 20 / 0.6 * np.sin(yaw), 20 / 0.6 * (1 - np.cos(yaw))
        return np.stack([x, y, 0 * t], axis=-1), np.stack([0 * t, 0.03 * np.sin(5 * t), yaw], axis=-1)

    world = scenery.world(
        [scenery.box([60, -90, -40], [61, 90, 60]), scenery.box([-90, 40, -40], [90, 41, 60])]
    )
    drive = scenery.drive(path, 1.0)
    cloud, _ = sweep(world, drive, paper(**model), 300_000_000)
    assert len(cloud.points_xyz_m) > 5000
    T = poses(drive, cloud)
    sigma_normal = 0.02

    def residual(T: Array) -> Array:
        p = transforms.apply(T, cloud.points_xyz_m)
        d = transforms.apply(T, cloud.points_xyz_m) - T[:, :3, 3]
        d /= np.linalg.norm(d, axis=-1, keepdims=True)
        to_x, to_y = (p[:, 0] - 60) / d[:, 0], (p[:, 1] - 40) / d[:, 1]
        return np.where(np.abs(to_x) < np.abs(to_y), to_x, to_y) / sigma_normal

    flat = residual(T)
    assert np.mean(np.abs(flat) < 3) > 0.995
    assert flat.std() == pytest.approx(1.0, abs=0.03)
    middle = T[np.argmin(np.abs(cloud.offset_ns.astype(np.int64) - 25_000_000))]
    bent = residual(np.broadcast_to(middle, T.shape))
    assert np.mean(np.abs(bent) < 3) < 0.5


@pytest.mark.parametrize("speed", [15.0, -15.0])
def test_passing_car_is_sheared(scenery: Any, speed: float) -> None:
    """A flank at 12 m: its edges are seen when x·tan(π − Ω·t) = y₀ ± L/2 + v·t."""
    half_length, half_width, x = 2.3, 0.9, 12.0
    world = scenery.world(
        [], {"saloon": scenery.box([-half_length, -half_width, 0.0], [half_length, half_width, 3.0])}
    )

    def frame_at(t: float) -> Any:
        heading = np.pi / 2 * np.sign(speed)
        return scenery.frame([[1.2 + x + half_width, 0.4 + speed * t, 0]], [heading], abs(speed))

    drive = scenery.drive(scenery.straight(), 0.2, scenery.catalog(["saloon"]), frame_at)
    cloud, labelled = sweep(world, drive, paper(range_noise_m=0.0))
    assert np.all(labelled.instance == EGO_INSTANCE + 1)
    flank = np.abs(cloud.points_xyz_m[:, 0] - x) < 1e-3
    y = cloud.points_xyz_m[flank, 1].astype(np.float64)
    t = cloud.offset_ns[flank] * 1e-9
    omega = 2 * np.pi / 0.05
    step = x * 2 * np.pi / 2078 * 1.3

    def edge(side: float) -> float:
        def miss(s: float) -> float:
            return x * np.tan(np.pi - omega * s) - (0.4 + side * half_length + speed * s)

        s = brentq(miss, 0.02, 0.03)
        return 0.4 + side * half_length + speed * s

    assert y.max() == pytest.approx(edge(1), abs=step)
    assert y.min() == pytest.approx(edge(-1), abs=step)
    seen = edge(1) - edge(-1)
    assert abs(seen - 2 * half_length) > 0.025, "the shear must be larger than what this test would miss"
    inside = np.abs(y - (0.4 + speed * t)) - half_length
    assert inside.max() < 1e-3, "each point lies on the car where it is at the point's own time"


def test_roof_shadows_the_ground(scenery: Any, box_range: Callable[..., Array]) -> None:
    """No ground point lies behind the own body, all others are there; own hits stay out of the cloud."""
    low, high = np.array([-0.95, -0.92, 0.2]), np.array([3.75, 0.92, 1.45])
    body = scenery.box(low, high, Material.CAR_PAINT, Tag.CAR)
    world = scenery.world([scenery.ground()], {"ego": body})
    drive = scenery.drive(scenery.weaving, 0.3)
    config = paper(range_noise_m=0.0)
    cloud, labelled = sweep(world, drive, config, 100_000_000)
    bare, _ = sweep(scenery.world([scenery.ground()]), drive, config, 100_000_000)
    d = directions(bare)
    shadowed = np.isfinite(box_range(np.broadcast_to([1.2, 0, HEIGHT], d.shape), d, low, high))
    assert np.count_nonzero(shadowed) > 5000
    assert len(cloud.points_xyz_m) == np.count_nonzero(~shadowed)
    assert cloud.points_xyz_m.tobytes() == bare.points_xyz_m[~shadowed].tobytes()
    assert labelled.instance is not None
    assert not np.any(labelled.instance == EGO_INSTANCE)
    own, labels = sweep(
        world, drive, paper(range_noise_m=0.0, ego_returns=True, range_min_m=0.1), 100_000_000
    )
    assert labels.instance is not None
    mine = labels.instance == EGO_INSTANCE
    assert np.abs(own.points_xyz_m[mine, 2].max() - (1.45 - HEIGHT)) < 1e-5


def test_tilted_mount_and_lever_arm(scenery: Any) -> None:
    """A LiDAR turned and tilted on the car sees the same walls through T_world_lidar of each point."""
    mount = Mount(position_m=(-0.5, 0.7, 2.0), rpy_deg=(4.0, -7.0, 120.0))
    world = scenery.world([scenery.ground()])
    drive = scenery.drive(scenery.weaving, 0.5)
    cloud, _ = sweep(world, drive, paper(mount=mount, range_noise_m=0.0), 200_000_000)
    world_points = transforms.apply(poses(drive, cloud, mount), cloud.points_xyz_m)
    assert np.abs(world_points[:, 2]).max() < 1e-3
    truth = truth_at(drive, [200_000_000], mount.T_base_sensor, frame_id="lidar")[0]
    assert truth.position_m == pytest.approx(poses(drive, cloud, mount)[0][:3, 3], abs=1e-9)


def test_intensity(scenery: Any) -> None:
    """100·ρ·cosθ·exp(−a·R) for diffuse surfaces, above 100 for a retro-reflective sign face on."""
    world = scenery.world(
        [scenery.ground(), scenery.box([20, -2, 0], [20.1, 2, 4], Material.SIGN, Tag.TRAFFIC_SIGN)]
    )
    cloud, labelled = sweep(world, scenery.drive(scenery.straight(), 0.2), paper(range_noise_m=0.0))
    assert labelled.tag is not None
    assert labelled.cos_incidence is not None
    r = np.linalg.norm(cloud.points_xyz_m.astype(float), axis=-1)
    road = labelled.tag == Tag.ROAD
    expected = 100 * MATERIALS[Material.ASPHALT].reflectance * (HEIGHT / r) * np.exp(-0.004 * r)
    assert np.abs(cloud.intensity[road] - expected[road]).max() < 1e-2
    assert np.abs(labelled.cos_incidence[road] - HEIGHT / r[road]).max() < 1e-4
    sign = labelled.tag == Tag.TRAFFIC_SIGN
    assert cloud.intensity[sign].min() > 150
    assert cloud.intensity.max() <= 255


@pytest.mark.parametrize(("material", "reach"), [(Material.ASPHALT, 49.0), (Material.PLASTER, 93.8)])
def test_dark_walls_vanish_early_when_asked(scenery: Any, material: Material, reach: float) -> None:
    """Face-on reach √(ρ/0.9)·120 m of the LISA rule, against walls at 96 % and 104 % of it."""
    config = paper(range_noise_m=0.0, drop_weak=True)
    for share, seen in ((0.96, True), (1.04, False)):
        x = 1.2 + share * reach
        world = scenery.world([scenery.box([x, -30, -30], [x + 1, 30, 30], material)])
        cloud, _ = sweep(world, scenery.drive(scenery.straight(), 0.2), config)
        ahead = np.abs(cloud.points_xyz_m[:, 1]) < 1.0
        level = np.abs(cloud.points_xyz_m[:, 2]) < 2.0
        assert bool(np.any(ahead & level)) == seen
    assert reach == pytest.approx(120 * np.sqrt(MATERIALS[material].reflectance / 0.9), abs=0.1)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"columns": 0}, "columns"),
        ({"range_max_m": 0.5}, "range_min_m"),
        ({"elevations_deg": (3.0, -3.0)}, "lowest"),
        ({"elevations_deg": ()}, "elevations"),
        ({"firing_ns": (0, 1)}, "firing_ns"),
        ({"outputs": ("clouds",)}, "cloud"),
        ({"rate_hz": 30}, "divide"),
    ],
)
def test_wrong_configurations_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        paper(**wrong)
