"""Flow, normals, depth and labels of a camera against geometry worked out by hand."""

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.timeline import Timeline

need_opengl()

PINHOLE = Pinhole.from_fov(320, 180, 90.0)
MOUNT = Mount(position_m=(1.8, 0.2, 1.6), axes="optical")
STEP_NS = 50_000_000
MODELS = ("signal_red", "signal_yellow", "signal_green")


@pytest.fixture
def world(scenery: Any) -> Iterator[Any]:
    models = {
        "saloon": scenery.box([-2.3, -0.9, 0.1], [2.3, 0.9, 1.4]),
        **{name: scenery.box([0, 0, 0], [0.1, 0.1, 0.1]) for name in MODELS},
        "ego": scenery.box([-0.95, -0.9, 0.2], [3.75, 0.9, 1.0]),
    }
    town = [scenery.ground(), scenery.box([40, 5, 0], [60, 15, 12]), scenery.box([25, -9, 0], [45, -7, 5])]
    small = scenery.world(town, models, 5)
    yield small
    small.renderer().close()


def drive_of(scenery: Any) -> Timeline:
    def frame_at(t: float) -> Any:
        return scenery.frame([[16 + 6 * t, 2.5 + 2 * t, 0]], [0.3 + 0.4 * t], 6.3)

    timeline: Timeline = scenery.drive(scenery.weaving, 1.0, scenery.catalog(["saloon"]), frame_at)
    return timeline


def camera(world: Any, *outputs: str) -> Any:
    return CameraConfig(name="left", mount=MOUNT, pinhole=PINHOLE, outputs=outputs).build(world)


def poses(timeline: Timeline, *stamps_ns: int) -> list[Array]:
    return [timeline.ego_motion([t]).T_world_frame[0] @ MOUNT.T_base_sensor for t in stamps_ns]


def points_of(depth_m: NDArray[np.float32]) -> Array:
    """Points seen by all pixels in the optical frame [m], shape (H, W, 3)."""
    v, u = np.mgrid[: PINHOLE.height_px, : PINHOLE.width_px].astype(np.float64)
    rays = np.stack([(u - PINHOLE.cx_px) / PINHOLE.fx_px, (v - PINHOLE.cy_px) / PINHOLE.fy_px, 0 * u + 1], -1)
    return rays * depth_m[..., None]


def test_flow_is_the_projection_of_the_points_a_period_later(world: Any, scenery: Any) -> None:
    """Town, turning car, own bonnet and sky, each projected by hand with the poses of both times."""
    drive, stamp = drive_of(scenery), 400_000_000
    samples = camera(world, "depth", "semantic", "flow").measure(drive, [stamp])
    depth, semantic, flow = (samples[k] for k in range(3))
    assert flow.sensor == "flow_left"
    now, then = poses(drive, stamp, stamp + STEP_NS)
    seen = points_of(depth.depth_m).reshape(-1, 3)
    ids = semantic.instance.reshape(-1)
    world_m = transforms.apply(now, seen)
    place = [drive.actor_poses(0, np.array([t])) for t in (stamp, stamp + STEP_NS)]
    car = [
        transforms.transform(p[0], transforms.rpy_to_quat(roll[0], -pitch[0], heading[0]))
        for p, heading, pitch, roll in place
    ]
    is_car, is_ego = ids == EGO_INSTANCE + 1, ids == EGO_INSTANCE
    world_m[is_car] = transforms.apply(car[1] @ transforms.invert(car[0]), world_m[is_car])
    later = transforms.apply(transforms.invert(then), world_m)
    later[is_ego] = seen[is_ego]
    is_sky = depth.depth_m.reshape(-1) == 0
    far = transforms.apply(
        transforms.from_rotation(then[:3, :3].T @ now[:3, :3]),
        points_of(depth.depth_m * 0 + 1).reshape(-1, 3),
    )
    later[is_sky] = far[is_sky]
    v, u = np.mgrid[: PINHOLE.height_px, : PINHOLE.width_px]
    expected = PINHOLE.project(later) - np.stack([u, v], -1).reshape(-1, 2)
    error = np.abs(flow.flow_px.reshape(-1, 2) - expected).max(axis=1)
    for which in (is_car, is_ego, is_sky, ~(is_car | is_ego | is_sky)):
        assert which.sum() > 300
        assert error[which].max() < 0.01
    assert np.abs(expected[is_car]).max() > 1.0


@pytest.mark.parametrize(
    "lens",
    [
        Lens(model="radtan", coefficients=(-0.2, 0.04, 1e-3, -5e-4)),
        Lens(model="equidistant", coefficients=(-0.01, 0.02, -0.013, 0.003)),
    ],
    ids=["radtan", "equidistant"],
)
def test_flow_through_a_lens(world: Any, scenery: Any, lens: Lens) -> None:
    drive, stamp = drive_of(scenery), 400_000_000
    sensor = CameraConfig(
        name="left", mount=MOUNT, pinhole=PINHOLE, lens=lens, outputs=("depth", "semantic", "flow")
    ).build(world)
    depth, semantic, flow = sensor.measure(drive, [stamp])  # type: ignore[misc]
    now, then = poses(drive, stamp, stamp + STEP_NS)
    rays = lens.rays(PINHOLE)
    points = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=2) * depth.depth_m[..., None]  # type: ignore[attr-defined]
    road = semantic.tag == Tag.ROAD  # type: ignore[attr-defined]
    later = transforms.apply(transforms.invert(then) @ now, points[road])
    x, y = lens.distort(later[:, 0] / later[:, 2], later[:, 1] / later[:, 2])
    v, u = np.nonzero(road)
    expected = np.stack([PINHOLE.fx_px * x + PINHOLE.cx_px - u, PINHOLE.fy_px * y + PINHOLE.cy_px - v], -1)
    assert road.sum() > 5000
    assert np.abs(flow.flow_px[road] - expected).max() < 0.01  # type: ignore[attr-defined]


def test_the_next_picture_shows_the_road_where_the_flow_points_to(world: Any, scenery: Any) -> None:
    """Inverse depth of a plane is linear in the picture: interpolated there, it is that of the same point."""
    drive, stamp = drive_of(scenery), 300_000_000
    samples = camera(world, "depth", "semantic", "flow").measure(drive, [stamp, stamp + STEP_NS])
    depth, semantic, flow, later, labels, _ = samples
    now, then = poses(drive, stamp, stamp + STEP_NS)
    expected = transforms.apply(transforms.invert(then) @ now, points_of(depth.depth_m).reshape(-1, 3))[:, 2]
    v, u = np.mgrid[: PINHOLE.height_px, : PINHOLE.width_px].astype(np.float32)
    x, y = u + flow.flow_px[..., 0], v + flow.flow_px[..., 1]
    inverse = np.where(labels.tag == Tag.ROAD, 1 / np.maximum(later.depth_m, 0.1), np.nan)
    found = cv2.remap(inverse.astype(np.float32), x, y, cv2.INTER_LINEAR, borderValue=np.nan)
    road = (semantic.tag == Tag.ROAD) & np.isfinite(found) & (depth.depth_m < 60)
    assert road.sum() > 10_000
    # OpenCV interpolates in steps of 1/32 px.
    error_px = np.abs(found - 1 / expected.reshape(found.shape))[road] * 1.6 * PINHOLE.fy_px
    assert error_px.max() < 0.06


def test_flow_comes_when_the_next_picture_is_due(world: Any) -> None:
    sensor = camera(world, "rgb", "flow")
    assert sensor.latency_ns == STEP_NS
    assert camera(world, "rgb").latency_ns == 0


def test_normals_of_ground_and_walls(world: Any, scenery: Any) -> None:
    """In the optical frame of a rolled and pitched camera, pointing out of the surfaces."""
    drive, stamp = drive_of(scenery), 650_000_000
    depth, semantic, normal = camera(world, "depth", "semantic", "normal").measure(drive, [stamp])
    (pose,) = poses(drive, stamp)
    up = pose[:3, :3].T @ [0.0, 0.0, 1.0]
    world_m = transforms.apply(pose, points_of(depth.depth_m).reshape(-1, 3)).reshape(*depth.depth_m.shape, 3)
    ground = semantic.tag == Tag.ROAD
    assert ground.sum() > 5000
    assert np.abs(normal.normal[ground] - up).max() < 1e-4
    front = (np.abs(world_m[..., 0] - 25.0) < 0.01) & (depth.depth_m > 0) & (world_m[..., 2] > 0.2)
    assert front.sum() > 50
    # Corners of the box share smoothed shading normals, which lean outwards, never inwards.
    facing = normal.normal[front] @ (pose[:3, :3].T @ [-1.0, 0.0, 0.0])
    assert facing.min() > 0.0
    assert np.all(normal.normal[depth.depth_m == 0] == 0)
    length = np.linalg.norm(normal.normal[depth.depth_m > 0], axis=-1)
    np.testing.assert_allclose(length, 1.0, atol=1e-5)
