"""The driving world and the environment: physics, ticks, start, steps, memory."""

import sys
import tempfile
from collections.abc import Callable
from functools import partial

import numpy as np
from bench import Bench, Row
from memory import can_measure, peak_memory_bytes
from scenario import SEED, TOWN, advance
from timing import time_calls

from carlaloc_env.core.clock import STEP_NS, STEP_TICKS, TICK_S, stamp_ns
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import CarlaLocError
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.traffic.traffic_config import TrafficConfig
from recorder.devices.registry import open_device

ACTORS_IN_TOWN = 100
_GENTLE = Controls(throttle=0.3)


def physics(bench: Bench) -> Row:
    """The ego's tick among actors, as the driving world asks for it."""
    world = DrivingWorld(bench.town, _hundred())
    world.reset()
    advance(world, 10 if bench.quick else 60)
    first = world.tick_count // STEP_TICKS * STEP_TICKS - 5 * STEP_TICKS
    timeline, state = world.timeline, world.state
    alone = PhysicsWorld(bench.town.outline.collision_vertices_m, bench.town.outline.collision_triangles)
    ego = EgoCar(alone)
    ego.reset(state.position_m, state.heading_rad)
    ticks = 4 * STEP_TICKS
    frames = [timeline.actors_at(stamp_ns(first + k)) for k in range(0, ticks + 1, STEP_TICKS)]

    def ours() -> None:
        for k in range(ticks):
            if k % STEP_TICKS == 0:
                step = k // STEP_TICKS
                alone.set_actors(frames[step], timeline.catalog, frames[step + 1])
            ego.tick(_GENTLE)
            ego.state()

    naive_world = bench.naive
    naive_world.stand(timeline.catalog, state.position_m)

    def naive() -> None:
        for frame in frames[:-1]:
            naive_world.move_actors(frame)
            naive_world.step()

    times = time_calls({"ours": ours, "naive": naive}, 3 * bench.repeat)
    tick, naive_tick = times["ours"].per(ticks), times["naive"].per(len(frames) - 1)
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
        env = CarlaLocEnv(TOWN, rig=rig_by_name(rig))
        action = np.array([0.0, 0.3], np.float32)

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
    """Peak memory of the demo: first look, parallel replay, SLAM, pictures."""
    row = partial(
        Row,
        name="memory",
        what="peak memory of the demo, all processes",
        unit="GB",
        target=2.8,  # the demo has had 2.54 to 2.64 with two processes
        at_least=False,
    )
    if not can_measure():
        return row(value=None, note="needs Linux's /proc")
    _ = bench.town
    seconds = ("3", "1", "0.1") if bench.quick else ("8", "3", "1")
    options = zip(("--duration", "--camera-start", "--camera-duration"), seconds, strict=True)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "recorder.cli.main", "demo", "--out", f"{folder}/demo"]
        try:
            peak, took_s = peak_memory_bytes([*command, *(word for pair in options for word in pair)])
        except RuntimeError as error:
            return row(value=None, note=str(error))
    note = f"{seconds[0]} s of a drive, {seconds[2]} s of pictures, in {took_s:.0f} s"
    return row(value=peak / 1e9, note=note)


def _hundred() -> TrafficConfig:
    return TrafficConfig(vehicles=ACTORS_IN_TOWN - 10, walkers=10, seed=SEED)
