"""What is measured: one function per row of the table."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from embree_alone import embree_alone
from memory import can_measure, peak_memory_bytes
from naive_pybullet import NaiveWorld
from scenario import RANGE_M, SEED, TOWN, Drive, advance, drive_among
from timing import Timing, time_calls

from carlaloc_env.clock import STEP_NS, STEP_TICKS, TICK_S, stamp_ns
from carlaloc_env.controls import Controls
from carlaloc_env.driving import DrivingWorld
from carlaloc_env.env import CarlaLocEnv
from carlaloc_env.errors import CarlaLocError
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.presets import rig_by_name
from carlaloc_env.sensors.base import Sensor
from carlaloc_env.sensors.camera import CameraConfig
from carlaloc_env.sensors.lidar import LidarConfig
from carlaloc_env.stage import SensorStage
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.world import TrafficConfig
from carlaloc_env.weather import weather_by_name
from recorder.devices.registry import open_device

ACTORS_IN_RANGE = 50
CROWDED = 60
ACTORS_IN_TOWN = 100
_GENTLE = Controls(throttle=0.3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One line of the table."""

    name: str
    """Short name, for ``--only``."""
    what: str
    """What was measured."""
    value: float | None
    """The figure that counts; None when it could not be measured."""
    unit: str
    """Its unit."""
    target: float | None = None
    """What the figure shall reach; None when it is only reported."""
    at_least: bool = True
    """Whether more is better."""
    ours: Timing | None = None
    """Times of this project."""
    naive: Timing | None = None
    """Times of PyBullet used the usual way."""
    note: str = ""
    """Circumstances, or why it could not be measured."""
    detail: dict[str, float] = field(default_factory=dict)
    """Further figures."""

    @property
    def passed(self) -> bool | None:
        """Whether the target is reached; None without a target or a figure."""
        if self.target is None or self.value is None:
            return None
        return self.value >= self.target if self.at_least else self.value <= self.target

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "name": self.name,
            "what": self.what,
            "value": self.value,
            "unit": self.unit,
            "target": self.target,
            "at_least": self.at_least,
            "passed": self.passed,
            "ours": self.ours.to_json() if self.ours else None,
            "naive": self.naive.to_json() if self.naive else None,
            "note": self.note,
            **self.detail,
        }


class Bench:
    """Everything that several rows need, made when first asked for.

    Args:
        repeat: How often each call is timed.
        quick: Whether to take few calls and short drives, to see that everything runs.
    """

    def __init__(self, *, repeat: int, quick: bool) -> None:
        self.repeat = repeat
        self.quick = quick

    @cached_property
    def town(self) -> Town:
        """The town of all rows."""
        return load_town(TOWN)

    @cached_property
    def drive(self) -> Drive:
        """A drive among many actors."""
        return drive_among(
            self.town, ACTORS_IN_RANGE, steps=5 if self.quick else 100, sweeps=1 if self.quick else 4
        )

    @cached_property
    def stage(self) -> SensorStage:
        """What sensors of this project look at."""
        return SensorStage(self.town, seed=SEED, weather=weather_by_name("ClearNoon"))

    @cached_property
    def naive(self) -> NaiveWorld:
        """The same town in PyBullet; the ego's surroundings alone if this shall be quick."""
        if not self.quick:
            return NaiveWorld(self.town.chunks)
        place = self.drive.timeline.ego_motion([self.drive.stamps_ns[0]]).position_m[0]
        near = [c for c in self.town.chunks if np.abs(c.bounds_m.mean(axis=0) - place).max() < RANGE_M]
        return NaiveWorld(near)

    def naive_drive(self) -> NaiveWorld:
        """The same town and the drive's actors in PyBullet."""
        drive = self.drive
        place = drive.timeline.ego_motion([drive.stamps_ns[0]]).position_m[0]
        self.naive.stand(drive.timeline.catalog, place)
        self.naive.move_actors(drive.timeline.actors_at(drive.stamps_ns[0]))
        return self.naive

    def sensor(self, kind: type) -> Sensor:
        """The paper's first sensor of a kind."""
        config = next(config for config in rig_by_name("paper").sensors if isinstance(config, kind))
        return config.build(self.stage)

    def sweep(self, sensor: Sensor) -> Callable[[], object]:
        """A call that measures the drive's stamps in turn."""
        stamps = self._round()
        return lambda: sensor.measure(self.drive.timeline, [next(stamps)])

    def _round(self) -> Iterator[int]:
        while True:
            yield from self.drive.stamps_ns


def lidar(bench: Bench) -> Row:
    """One revolution of the paper's LiDAR, both clouds with noise, against the bare rays in PyBullet."""
    config = next(c for c in rig_by_name("paper").sensors if isinstance(c, LidarConfig))
    T = bench.drive.timeline.ego_motion([bench.drive.stamps_ns[0]]).T_world_frame[0]
    T = T @ config.mount.T_base_sensor
    azimuth = -2 * np.pi * np.arange(config.columns) / config.columns
    turn, lift = np.meshgrid(azimuth, np.radians(config.elevations_deg), indexing="ij")
    rays = np.stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)], axis=-1)
    directions = rays.reshape(-1, 3) @ T[:3, :3].T
    naive = bench.naive_drive()
    times = time_calls(
        {
            "ours": bench.sweep(bench.sensor(LidarConfig)),
            "naive": lambda: naive.ranges_m(T[:3, 3], directions, config.range_max_m),
        },
        3 * bench.repeat,
    )
    return _compared(
        "lidar",
        f"LiDAR scan of {len(directions)} rays, {ACTORS_IN_RANGE} moving actors in range",
        times,
        12.0,
        f"actors within {bench.drive.farthest_m:.0f} of {RANGE_M:.0f} m; "
        f"rayTestBatch over {naive.bodies} bodies",
    )


def lidar_rate(bench: Bench) -> Row:
    """A whole scan, both clouds, against Embree alone casting the same rays at everything held still."""
    steps = 5 if bench.quick else 100
    drive = drive_among(bench.town, CROWDED, steps=steps, sweeps=1)
    stamp, timeline = drive.stamps_ns[0], drive.timeline
    sensor = bench.sensor(LidarConfig)
    config = sensor.config
    assert isinstance(config, LidarConfig)
    columns = stamp + np.arange(config.columns) * config.sweep_ns // config.columns
    T = timeline.ego_motion(columns).at_mount(config.mount.T_base_sensor).T_world_frame
    azimuth = np.pi - 2 * np.pi * (np.arange(config.columns) + 0.5) / config.columns
    turn, lift = np.meshgrid(azimuth, np.radians(config.elevations_deg), indexing="ij")
    local = np.stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)], axis=-1)
    directions = np.einsum("cij,cbj->cbi", T[:, :3, :3], local)
    origins = np.broadcast_to(T[:, None, :3, 3], directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).reshape(-1, 6).astype(np.float32)
    alone = embree_alone(bench.town.chunks, bench.stage.library, timeline, stamp, rays)
    times = time_calls({"ours": lambda: sensor.measure(timeline, [stamp]), "embree": alone}, 6 * bench.repeat)
    ours, embree = times["ours"], times["embree"]
    return Row(
        name="lidar_rate",
        what=f"LiDAR scan of {len(rays)} rays, {CROWDED} actors; rate against bare Embree, still scene",
        value=embree.least_s / ours.least_s,
        unit="of Embree's rate",
        target=0.5,
        ours=ours,
        note=f"actors within {drive.farthest_m:.0f} m; shortest times of {ours.calls} calls in turn",
        detail={
            "embree_ms": 1e3 * embree.least_s,
            "ours_ms": 1e3 * ours.least_s,
            "ratio_of_medians": embree.median_s / ours.median_s,
            "ratio_of_cpu": embree.cpu_s / ours.cpu_s,
        },
    )


def camera(bench: Bench) -> Row:
    """Colour, depth and semantics of one camera."""
    config = next(c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig))
    T = bench.drive.timeline.ego_motion([bench.drive.stamps_ns[0]]).T_world_frame[0]
    T = T @ config.mount.T_base_sensor
    naive = bench.naive_drive()
    what = f"camera {config.pinhole.width_px}×{config.pinhole.height_px}: RGB, depth, semantics"
    try:
        ours = bench.sweep(bench.sensor(CameraConfig))
        ours()
    except CarlaLocError as error:
        return Row(name="camera", what=what, value=None, unit="× faster", target=3.0, note=str(error))
    calls = {"ours": ours, "naive": lambda: naive.picture(config.pinhole, T)}
    return _compared("camera", what, time_calls(calls, bench.repeat), 3.0, "against TinyRenderer")


def physics(bench: Bench) -> Row:
    """The ego's tick among actors, as the driving world asks for it."""
    world = DrivingWorld(bench.town, _hundred())
    world.reset()
    advance(world, 10 if bench.quick else 60)
    first = world.tick_count // STEP_TICKS * STEP_TICKS - 5 * STEP_TICKS
    timeline, state = world.timeline, world.state
    alone = PhysicsWorld(bench.town.collision_vertices_m, bench.town.collision_triangles)
    ego = EgoCar(alone)
    ego.reset(state.position_m, state.heading_rad)
    ticks = 4 * STEP_TICKS
    frames = [timeline.actors_at(stamp_ns(first + k)) for k in range(0, ticks, 2)]

    def ours() -> None:
        for k in range(ticks):
            if k % 2 == 0:
                alone.set_actors(frames[k // 2], timeline.catalog)
            ego.tick(_GENTLE)
            ego.state()

    naive_world = bench.naive
    naive_world.stand(timeline.catalog, state.position_m)

    def naive() -> None:
        for frame in frames:
            naive_world.move_actors(frame)
            naive_world.step()

    times = time_calls({"ours": ours, "naive": naive}, 3 * bench.repeat)
    tick, naive_tick = times["ours"].per(ticks), times["naive"].per(len(frames))
    alone.close()
    world.close()
    return Row(
        name="physics",
        what=f"physics tick of 5 ms, {ACTORS_IN_TOWN} actors in town",
        value=TICK_S / tick.median_s,
        unit="× real time",
        target=40.0,
        ours=tick,
        naive=naive_tick,
        note=f"a body for everything: {TICK_S / naive_tick.median_s:.1f} × real time",
    )


def driving(bench: Bench) -> Row:
    """The whole world's tick: physics, actors, traffic and signals."""
    world = DrivingWorld(bench.town, _hundred())
    world.reset()
    driver = open_device("scripted", SEED)
    advance(world, 10)
    ticks = 4 * STEP_TICKS

    def drive() -> None:
        for _ in range(ticks):
            world.tick(_GENTLE)

    def be_driven() -> None:
        for _ in range(ticks):
            world.tick(driver.read(world.driver_view()))

    times = time_calls({"driven": be_driven, "alone": drive}, 3 * bench.repeat)
    tick, driven = times["alone"].per(ticks), times["driven"].per(ticks)
    driver.close()
    world.close()
    return Row(
        name="driving",
        what=f"tick of the whole driving world, {ACTORS_IN_TOWN} actors",
        value=TICK_S / tick.median_s,
        unit="× real time",
        ours=tick,
        note=f"with traffic; with the scripted driver {TICK_S / driven.median_s:.1f} × real time",
        detail={"driven_s": driven.median_s},
    )


def start(bench: Bench) -> Row:
    """A town from the cache and the first observation."""
    _ = bench.town

    def begin(rig: str) -> None:
        env = CarlaLocEnv(TOWN, rig=rig)
        env.reset(seed=SEED)
        env.close()

    times = time_calls({"state": lambda: begin("state")}, bench.repeat, 0)["state"]
    return Row(
        name="start",
        what="town from the cache and reset",
        value=times.median_s,
        unit="s",
        target=3.0,
        at_least=False,
        ours=times,
        note="rig state",
    )


def steps(rig: str, least: float | None) -> Callable[[Bench], Row]:
    """Environment steps with a rig."""

    def row(bench: Bench) -> Row:
        name, what = f"steps_{rig}", f"environment steps of 50 ms, rig '{rig}'"
        count = {"state": 40, "lidar": 8, "paper": 2}[rig]
        env = CarlaLocEnv(TOWN, rig=rig)
        action = np.array([0.0, 0.3, 0.0, 0.0, 0.0], np.float32)

        def some() -> None:
            for _ in range(count):
                env.step(action)

        try:
            env.reset(seed=SEED)
            times = time_calls({"step": some}, bench.repeat)["step"].per(count)
        except CarlaLocError as error:
            return Row(name=name, what=what, value=None, unit="/s", target=least, note=str(error))
        finally:
            env.close()
        return Row(
            name=name,
            what=what,
            value=1.0 / times.median_s,
            unit="/s",
            target=least,
            ours=times,
            note=f"{1e-9 * STEP_NS / times.median_s:.1f} × real time",
        )

    return row


def memory(bench: Bench) -> Row:
    """Peak memory of the demo: drive, parallel replay, SLAM, pictures."""
    row = partial(
        Row,
        name="memory",
        what="peak memory of the demo, all processes",
        unit="GB",
        target=2.5,
        at_least=False,
    )
    if not can_measure():
        return row(value=None, note="needs Linux's /proc")
    _ = bench.town
    demo = Path(__file__).parents[1] / "examples" / "demo.py"
    seconds = ("3", "1", "0.1") if bench.quick else ("8", "3", "1")
    options = zip(("--duration", "--camera-start", "--camera-duration"), seconds, strict=True)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(demo), "--out", f"{folder}/demo"]
        try:
            peak, took_s = peak_memory_bytes([*command, *(word for pair in options for word in pair)])
        except RuntimeError as error:
            return row(value=None, note=str(error))
    note = f"a drive of {seconds[0]} s, {seconds[2]} s of pictures, in {took_s:.0f} s"
    return row(value=peak / 1e9, note=note)


ROWS: dict[str, Callable[[Bench], Row]] = {
    "lidar": lidar,
    "lidar_rate": lidar_rate,
    "camera": camera,
    "physics": physics,
    "driving": driving,
    "start": start,
    "steps_state": steps("state", 500.0),
    "steps_lidar": steps("lidar", None),
    "steps_paper": steps("paper", None),
    "memory": memory,
}
"""All rows by name."""


def _compared(name: str, what: str, times: dict[str, Timing], target: float, note: str) -> Row:
    ours, naive = times["ours"], times["naive"]
    return Row(
        name=name,
        what=what,
        value=naive.median_s / ours.median_s,
        unit="× faster",
        target=target,
        ours=ours,
        naive=naive,
        note=note,
        detail={"ratio_of_least": naive.least_s / ours.least_s, "ratio_of_cpu": naive.cpu_s / ours.cpu_s},
    )


def _hundred() -> TrafficConfig:
    return TrafficConfig(vehicles=ACTORS_IN_TOWN - 10, walkers=10, seed=SEED)
