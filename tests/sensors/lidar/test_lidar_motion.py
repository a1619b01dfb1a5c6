"""Motion in LiDAR scans: de-skewing with the truth, cars that pass, tilted mounts."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from shared_fixtures.readings.lidar_scans import HDL32E, MOUNT, paper, sweep

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.samples import PointCloud
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.ground_truth import truth_at
from carlaloc_env.sensors.lidar_config import LidarConfig

pytest.importorskip("open3d", reason="open3d is not installed")

lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")


def poses(drive: Any, cloud: PointCloud, mount: Mount = MOUNT) -> Array:
    """True pose of the LiDAR at the time of each point."""
    times, back = np.unique(cloud.stamp_ns + cloud.offset_ns.astype(np.int64), return_inverse=True)
    return drive.ego_motion(times).at_mount(mount.T_base_sensor).T_world_frame[back]


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


@pytest.mark.parametrize(
    "model",
    [{}, HDL32E, *(LidarConfig.preset_values(name) for name in ("vlp16", "hdl64e", "os1_64", "mid360"))],
    ids=["paper", "hdl32e", "vlp16", "hdl64e", "os1_64", "mid360"],
)
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
    cloud, _ = sweep(
        world, drive, paper(**{**model, "range_noise_m": 0.02, "range_max_m": 120.0}), 300_000_000
    )
    assert len(cloud.points_xyz_m) > 5000
    T = poses(drive, cloud)
    sigma_normal = 0.02

    def residual(T: Array) -> Array:
        p = transforms.apply(T, cloud.points_xyz_m)
        # Beams may begin beside the sensor's origin.
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
