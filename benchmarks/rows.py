"""What is measured: one function per row of the table."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
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
            self.town, ACTORS_IN_RANGE, steps=20 if self.quick else 100, sweeps=1 if self.quick else 4
        )

    @cached_property
    def stage(self) -> SensorStage:
        """What sensors of this project look at."""
        return SensorStage(self.town, seed=SEED, weather=weather_by_name("ClearNoon"))

    @cached_property
    def naive(self) -> NaiveWorld:
        """The same town and actors in PyBullet."""
        drive = self.drive
        place = drive.timeline.ego_motion([drive.stamps_ns[0]]).position_m[0]
        world = NaiveWorld(self.town, drive.timeline.catalog, place)
        world.move_actors(drive.timeline.actors_at(drive.stamps_ns[0]))
        return world

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
    naive = bench.naive
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


def camera(bench: Bench) -> Row:
    """Colour, depth and semantics of one camera."""
    config = next(c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig))
    T = bench.drive.timeline.ego_motion([bench.drive.stamps_ns[0]]).T_world_frame[0]
    T = T @ config.mount.T_base_sensor
    naive = bench.naive
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

    naive_world = NaiveWorld(bench.town, timeline.catalog, state.position_m)

    def naive() -> None:
        for frame in frames:
            naive_world.move_actors(frame)
            naive_world.step()

    times = time_calls({"ours": ours, "naive": naive}, 3 * bench.repeat)
    tick, naive_tick = times["ours"].per(ticks), times["naive"].per(len(frames))
    naive_world.close()
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
    views = time_calls({"driver": lambda: driver.read(world.driver_view())}, 20 * bench.repeat, STEP_TICKS)[
        "driver"
    ]
    ticks = 4 * STEP_TICKS

    def drive() -> None:
        controls = driver.read(world.driver_view())
        for _ in range(ticks):
            world.tick(controls)

    tick = time_calls({"drive": drive}, 3 * bench.repeat)["drive"].per(ticks)
    driver.close()
    world.close()
    return Row(
        name="driving",
        what=f"tick of the whole driving world, {ACTORS_IN_TOWN} actors",
        value=TICK_S / tick.median_s,
        unit="× real time",
        ours=tick,
        note=f"with traffic; the scripted driver takes another {1e3 * views.median_s:.2f} ms a tick",
        detail={"driver_s": views.median_s},
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
    what = "peak memory of the demo, all processes"
    limit = {"unit": "GB", "target": 2.5, "at_least": False}
    if not can_measure():
        return Row(name="memory", what=what, value=None, note="needs Linux's /proc", **limit)
    _ = bench.town
    demo = Path(__file__).parents[1] / "examples" / "demo.py"
    seconds = ("3", "1", "0.1") if bench.quick else ("8", "3", "1")
    options = zip(("--duration", "--camera-start", "--camera-duration"), seconds, strict=True)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(demo), "--out", f"{folder}/demo"]
        try:
            peak, took_s = peak_memory_bytes([*command, *(word for pair in options for word in pair)])
        except RuntimeError as error:
            return Row(name="memory", what=what, value=None, note=str(error), **limit)
    return Row(
        name="memory",
        what=what,
        value=peak / 1e9,
        note=f"a drive of {seconds[0]} s, {seconds[2]} s of pictures, in {took_s:.0f} s",
        **limit,
    )


ROWS: dict[str, Callable[[Bench], Row]] = {
    "lidar": lidar,
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
