"""Rays against boxes that stand, drive and turn: closed-form answers."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import RaycastError
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag

pytest.importorskip("open3d", reason="open3d is not installed")
raycast = pytest.importorskip("carlaloc_env.raycast")

CAR_LOW, CAR_HIGH = np.array([-2.35, -0.92, 0.1]), np.array([2.35, 0.92, 1.45])


def random_rays(count: int, seed: int) -> tuple[Array, Array, NDArray[np.int64]]:
    """Rays from a small volume near (0, 0, 1.8), mostly level, at random times of one step."""
    rng = np.random.default_rng(seed)
    origins = np.array([0.0, 0.0, 1.8]) + rng.uniform(-0.6, 0.6, (count, 3))
    azimuth, elevation = rng.uniform(-np.pi, np.pi, count), rng.normal(-0.05, 0.15, count)
    flat = np.cos(elevation)
    directions = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)
    return origins, directions, rng.integers(0, STEP_NS, count)


def test_static_box_and_ground(scenery: Any, box_range: Callable[..., Array]) -> None:
    """Range, material, tag, instance and incidence of a street of one house."""
    house = scenery.box([20, -8, 0], [30, 8, 12], Material.BRICK_RED, Tag.BUILDING, instance=77)
    world = scenery.world([scenery.ground(), house])
    origins, d, stamps = random_rays(20_000, 1)
    hits = world.rays().cast(origins, d, stamps, scenery.drive(scenery.straight(), 0.1), 100.0)
    wall = box_range(origins, d, [20, -8, 0], [30, 8, 12])
    floor = np.where(d[:, 2] < 0, -origins[:, 2] / d[:, 2], np.inf)
    expected = np.minimum(wall, floor)
    expected[expected > 100.0] = np.inf
    assert np.array_equal(np.isfinite(hits.range_m), np.isfinite(expected))
    seen = np.isfinite(expected)
    assert np.abs(hits.range_m[seen] - expected[seen]).max() < 1e-3
    on_wall = seen & (wall < floor - 1e-3)
    on_floor = seen & (floor < wall - 1e-3)
    assert on_wall.sum() > 500
    assert on_floor.sum() > 5000
    assert np.all(hits.instance[on_wall] == 77)
    assert np.all(hits.material[on_wall] == Material.BRICK_RED)
    assert np.all(hits.tag[on_floor] == Tag.ROAD)
    assert np.abs(hits.cos_incidence[on_floor] + d[on_floor, 2]).max() < 1e-5


def test_a_town_in_a_shared_file_is_hit_as_one_in_memory(
    scenery: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Made, and mapped as by a second process: the same hits to the bit."""
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path))
    boxes = [
        scenery.box([x, y, 0], [x + 2, y + 3, 5 + x % 7], Material.BRICK_RED, Tag.BUILDING, instance=400 + x)
        for x in range(-300, 300, 5)
        for y in range(-200, 200, 10)
        if abs(x) + abs(y) > 20
    ]
    origins, d, stamps = random_rays(5000, 3)
    drive = scenery.drive(scenery.straight(), 0.1)
    made, mapped = (
        scenery.world([scenery.ground(), *boxes]).rays().cast(origins, d, stamps, drive, 100.0)
        for _ in range(2)
    )
    assert len(list(tmp_path.glob("*.rays"))) == 1
    for name in ("range_m", "material", "tag", "instance", "cos_incidence"):
        assert getattr(made, name).tobytes() == getattr(mapped, name).tobytes()
    assert len(set(mapped.instance.tolist())) > 20


@pytest.mark.parametrize("ego_speed", [0.0, 20.0])
def test_moving_turning_climbing_cars(
    scenery: Any, box_range: Callable[..., Array], ego_speed: float
) -> None:
    """Each ray meets each car where the car is at the ray's own time; the nearest car wins."""
    rng = np.random.default_rng(3)
    count = 40
    start = np.stack([*rng.uniform(-60, 60, (2, count)), rng.uniform(-1, 1, count)], axis=-1)
    keep = np.hypot(start[:, 0], start[:, 1]) > 6
    start = start[keep]
    count = len(start)
    heading, rate = rng.uniform(-np.pi, np.pi, count), rng.uniform(-0.5, 0.5, count)
    speed, pitch = rng.uniform(0, 20, count), rng.uniform(-0.1, 0.1, count)
    roll = np.random.default_rng(5).uniform(-0.1, 0.1, count)

    def frame_at(t: float) -> Any:
        along = np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=-1)
        turned = transforms.wrap_angle(heading + rate * t)
        return scenery.frame(
            start + (speed * t)[:, None] * along, turned, speed, pitch_rad=pitch, roll_rad=roll
        )

    catalog = scenery.catalog(["saloon"] * count)
    drive = scenery.drive(scenery.straight(ego_speed), 0.2, catalog, frame_at)
    world = scenery.world([scenery.ground()], {"saloon": scenery.box(CAR_LOW, CAR_HIGH)})
    origins, d, stamps = random_rays(30_000, 4)
    origins = origins + np.array([ego_speed, 0, 0]) * (stamps * 1e-9)[:, None]
    hits = world.rays().cast(origins, d, stamps, drive, 100.0)

    best = np.where(d[:, 2] < 0, -origins[:, 2] / d[:, 2], np.inf)
    who = np.full(len(d), -1)
    a, b = frame_at(0.0), frame_at(0.05)
    f = stamps / STEP_NS
    for k in range(count):
        position = a.position_m[k] + f[:, None] * (b.position_m[k].astype(float) - a.position_m[k])
        yaw = a.heading_rad[k] + f * transforms.wrap_angle(float(b.heading_rad[k]) - float(a.heading_rad[k]))
        back = transforms.quat_conjugate(
            transforms.rpy_to_quat(float(a.roll_rad[k]), -float(a.pitch_rad[k]), yaw)
        )
        r = box_range(
            transforms.quat_rotate(back, origins - position),
            transforms.quat_rotate(back, d),
            CAR_LOW,
            CAR_HIGH,
        )
        who, best = np.where(r < best, k, who), np.minimum(r, best)
    best[best > 100.0] = np.inf
    on_car = np.isfinite(best) & (who >= 0)
    assert on_car.sum() > 1000
    # A ray that grazes an edge may fall on either side of it in float32.
    same = np.abs(hits.range_m[np.isfinite(best)] - best[np.isfinite(best)]) < 2e-3
    assert same.mean() > 0.9995
    agree = hits.instance[on_car] == EGO_INSTANCE + 1 + who[on_car]
    assert agree.mean() > 0.999


def test_fast_car_is_hit_up_to_its_bumpers(scenery: Any) -> None:
    """Rays aimed at both ends of a car at 40 m/s, at its place at each ray's own time, all arrive."""
    speed, count = 40.0, 2000
    rng = np.random.default_rng(2)
    stamps = rng.integers(0, STEP_NS, count)
    target = np.stack(
        [
            rng.choice([-2.34, 2.34], count) + 3.0 + speed * stamps * 1e-9,
            np.full(count, 9.0 - 0.92),
            rng.uniform(0.2, 1.4, count),
        ],
        axis=-1,
    )
    origins = np.broadcast_to([0.0, 0.0, 1.8], (count, 3))
    d = target - origins
    distance = np.linalg.norm(d, axis=-1, keepdims=True)
    drive = scenery.drive(
        scenery.straight(),
        0.1,
        scenery.catalog(["saloon"]),
        lambda t: scenery.frame([[3.0 + speed * t, 9.0, 0]], [0.0], speed),
    )
    world = scenery.world([], {"saloon": scenery.box(CAR_LOW, CAR_HIGH)})
    hits = world.rays().cast(origins, d / distance, stamps, drive, 100.0)
    assert np.abs(hits.range_m - distance[:, 0]).max() < 1e-3


def test_actor_pose_is_the_cameras_pose(scenery: Any) -> None:
    """LiDAR and camera put the same car at the same place: position, heading, nose up, left side up."""
    from carlaloc_env.actors.instances import place_actors

    library = ModelLibrary({"saloon": scenery.box(CAR_LOW, CAR_HIGH)})
    frame = scenery.frame([[4, 5, 6], [-7, 8, 1]], [0.7, -2.5], pitch_rad=[0.2, -0.1], roll_rad=[-0.1, 0.3])
    T = place_actors(scenery.catalog(["saloon", "saloon"]), frame, library).T_world_model
    points = np.random.default_rng(0).normal(size=(2, 3))
    seen = raycast.into_actor_frame(
        transforms.apply(T, points) - frame.position_m.astype(float),
        np.ones((2, 3)),
        frame.heading_rad.astype(float),
        frame.pitch_rad.astype(float),
        frame.roll_rad.astype(float),
    )
    assert np.allclose(seen[:, :3], points, atol=1e-6)


def test_culling_loses_no_pair() -> None:
    """Every ray with a point inside a cylinder is a candidate, cylinders around the eye included."""
    origins, d, _ = random_rays(2000, 7)
    rng = np.random.default_rng(8)
    centre = rng.uniform(-30, 30, (60, 3)) * [1, 1, 0.2]
    radius, tall = rng.uniform(0.3, 6, 60), rng.uniform(0.2, 2, 60)
    limit = rng.uniform(5, 50, 2000).astype(np.float32)
    around = raycast.Cylinders(centre_m=centre, radius_m=radius, half_height_m=tall)
    rays, actors = raycast.candidates(origins, d, limit, around)
    pairs = set(zip(rays.tolist(), actors.tolist(), strict=True))
    assert len(pairs) == len(rays)
    s = np.linspace(0, 1, 150)[:, None, None] * limit[None, :, None]
    points = origins[None] + s * d[None]
    meets = set()
    for k in range(60):
        offset = points - centre[k]
        inside = (np.hypot(offset[..., 0], offset[..., 1]) < radius[k]) & (np.abs(offset[..., 2]) < tall[k])
        meets |= {(int(ray), k) for ray in np.flatnonzero(inside.any(axis=0))}
    assert len(meets) > 1000
    assert meets <= pairs
    assert len(pairs) < 4 * len(meets)


def test_own_body_is_hit_where_it_stands(scenery: Any, box_range: Callable[..., Array]) -> None:
    """The ego's body moves with the ego; without it the ground is seen."""
    low, high = np.array([-0.95, -0.9, 0.3]), np.array([3.75, 0.9, 1.45])
    body = scenery.box(low, high, Material.CAR_PAINT, Tag.CAR)
    world = scenery.world([scenery.ground()], {"ego": body})
    drive = scenery.drive(scenery.straight(20.0), 0.2)
    _, d, stamps = random_rays(5000, 9)
    d[:, 2] -= 0.5
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    origins = np.array([1.2, 0, 1.85]) + np.array([20.0, 0, 0]) * (stamps * 1e-9)[:, None]
    hits = world.rays().cast(origins, d, stamps, drive, 100.0)
    r = box_range(np.broadcast_to([1.2, 0, 1.85], d.shape), d, low, high)
    stopped = np.isfinite(r)
    assert stopped.sum() > 500
    assert np.all(hits.instance[stopped] == EGO_INSTANCE)
    assert np.abs(hits.range_m[stopped] - r[stopped]).max() < 1e-4
    free = world.rays().cast(origins, d, stamps, drive, 100.0, ego=False)
    assert np.all(free.tag[np.isfinite(free.range_m)] == Tag.ROAD)


def test_far_corner_of_a_town_is_as_exact_as_its_middle(scenery: Any) -> None:
    """float32 at 1 km from the origin keeps ranges within a fifth of a millimetre."""
    origins, d, stamps = random_rays(4000, 11)
    drive = scenery.drive(scenery.straight(), 0.1)
    shift = np.array([1024.0, -960.0, 32.0])
    near = scenery.world([scenery.box([15, -30, -5], [16, 30, 30])])
    far = scenery.world([scenery.box(shift + np.array([15, -30, -5]), shift + np.array([16, 30, 30]))])
    a = near.rays().cast(origins, d, stamps, drive, 100.0).range_m
    b = far.rays().cast(origins + shift, d, stamps, drive, 100.0).range_m
    both = np.isfinite(a) & np.isfinite(b)
    assert both.sum() > 500
    assert np.abs(a[both] - b[both]).max() < 2e-4


def test_a_ray_does_not_depend_on_its_company(scenery: Any) -> None:
    """Some rays, in another order, give the same bytes as among all."""
    catalog = scenery.catalog(["saloon"] * 3)
    frame = scenery.frame([[10, 0, 0], [12, 9, 0], [-9, 3, 0]], [0.1, 1.0, 2.0], 0.0)
    drive = scenery.drive(scenery.straight(), 0.2, catalog, lambda t: frame)
    world = scenery.world(
        [scenery.ground(), scenery.box([20, -8, 0], [30, 8, 12])], {"saloon": scenery.box(CAR_LOW, CAR_HIGH)}
    )
    origins, d, stamps = random_rays(8000, 12)
    every = world.rays().cast(origins, d, stamps, drive, 100.0)
    some = np.random.default_rng(0).permutation(8000)[:1234]
    few = world.rays().cast(origins[some], d[some], stamps[some], drive, 100.0)
    for name in ("range_m", "tag", "instance", "material", "cos_incidence"):
        assert getattr(few, name).tobytes() == getattr(every, name)[some].tobytes()


def test_nothing_to_hit_and_no_rays(scenery: Any) -> None:
    world = scenery.world()
    drive = scenery.drive(scenery.straight(), 0.1)
    origins, d, stamps = random_rays(10, 1)
    assert not np.isfinite(world.rays().cast(origins, d, stamps, drive, 100.0).range_m).any()
    assert len(world.rays().cast(origins[:0], d[:0], stamps[:0], drive, 100.0)) == 0


def test_missing_open3d_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(RaycastError, match=r"libgomp1 libusb-1\.0-0 libidn2-0"):
        raycast.RayScene([], ModelLibrary({}))
