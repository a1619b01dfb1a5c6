"""Learning agents: steps per second of the environments."""

import math
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from bench import Bench, Row
from memory import can_measure
from scenario import TOWN
from timing import time_calls

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.cores import usable_cores
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig

HUNDRED = "dynamic,vehicles=100,walkers=0"
GENTLE = np.array([0.0, 0.2], np.float32)
STEP_S = STEP_NS * 1e-9


_WORDS = {
    "state": "rig 'state'",
    "bev": "rig 'bev'",
    "lidar": "the LiDAR of rig 'lidar'",
    "camera": "a camera of 84×84, quality 'low'",
}


def _rigs() -> dict[str, str | SensorRig]:
    lidar = next(config for config in rig_by_name("lidar").sensors if isinstance(config, LidarConfig))
    seat = Mount(position_m=(1.8, 0.0, 1.6), axes="optical")
    camera = CameraConfig(mount=seat, pinhole=Pinhole.from_fov(84, 84, 90.0), outputs=("rgb",))
    return {
        "state": "state",
        "bev": "bev",
        "lidar": SensorRig(name="lidar_alone", sensors=(lidar,)),
        "camera": SensorRig(name="camera_84", sensors=(camera,)),
    }


def learn(rig: str, least: float, traffic: str = HUNDRED, name: str | None = None) -> Callable[[Bench], Row]:
    """Steps of 50 ms a second with a rig, resets included."""

    def row(bench: Bench) -> Row:
        others = "100 others" if traffic == HUNDRED else "237 + 34 others"
        what = f"steps an agent makes, {_WORDS[rig]}, {others}"
        env = CarlaLocEnv(map=TOWN, rig=_rigs()[rig], traffic=traffic, quality="low", info=())
        count = 20 if bench.quick else {"state": 1000, "bev": 400, "lidar": 60, "camera": 100}[rig]
        steps = partial(_steps, env, count)
        times = time_calls({"ours": steps}, bench.repeat)["ours"].per(count)
        env.close()
        rate = 1.0 / times.median_s
        return Row(
            name=name or f"learn_{rig}",
            what=what,
            value=rate,
            unit="steps/s",
            target=least,
            ours=times,
            note=f"{rate * STEP_S:.0f} × real time",
        )

    return row


def _steps(env: Any, count: int) -> None:
    """Some steps, with a reset at the end of every episode and at the beginning."""
    env.reset(seed=1)
    for number in range(count):
        *_, ended, over, _ = env.step(GENTLE)
        if ended or over:
            env.reset(seed=number)


def learn_vector(bench: Bench) -> Row:
    """Two environments in processes of their own against one, steps of both together, in turns."""
    what, count = "two environments in processes of their own, over one", 20 if bench.quick else 400
    rates: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(bench.repeat):
        for number, found in rates.items():
            with _workers(number) as envs:
                actions = np.tile(GENTLE, (number, 1))
                began = time.perf_counter()
                for _ in range(count):
                    envs.step(actions)
                found.append(number * count / (time.perf_counter() - began))
    one, two = (float(np.median(found)) for found in rates.values())
    note = f"{one:.0f} and {two:.0f} steps/s; {len(usable_cores())} cores"
    # Gymnasium's main process allows 1.8; the same code has had 1.45 to 1.80 on two cores.
    return Row(name="learn_vector", what=what, value=two / one, unit="× of one", target=1.4, note=note)


def learn_memory(bench: Bench) -> Row:
    """Private memory of a worker, without the part that it shares with the other one."""
    row = partial(Row, name="learn_memory", what="memory of a worker beyond what is shared", unit="MB")
    if not can_measure():
        return row(value=None, note="needs Linux's /proc")
    with _workers(2) as envs:
        maps = [Path(f"/proc/{worker.pid}/smaps_rollup").read_text() for worker in envs.processes]
    own, all_of_it = (
        max(sum(int(found) for found in re.findall(pattern, text)) for text in maps) * 1024e-6
        for pattern in (r"Private_\w+: +(\d+)", r"Pss: +(\d+)")
    )
    return row(
        value=own, target=700.0, at_least=False, note=f"{all_of_it:.0f} MB with its part of the shared"
    )


@contextmanager
def _workers(number: int) -> Iterator[Any]:
    """Environments in processes of their own, warmed up."""
    envs = gymnasium.make_vec(
        f"CarlaLoc-{TOWN}-v0", num_envs=number, vectorization_mode="async", rig="state", traffic=HUNDRED
    )
    try:
        envs.reset(seed=1)
        for _ in range(20):
            envs.step(np.tile(GENTLE, (number, 1)))
        yield envs
    finally:
        envs.close()


def learn_make(bench: Bench) -> Row:
    """`gymnasium.make` in a fresh process, town and machine code in the cache, over its imports.

    Seconds alone would be those of the machine.
    """
    assert bench.town.name == TOWN  # now it is in the cache
    code = (
        "import time, gymnasium, carlaloc_env; began = time.perf_counter(); "
        "import carlaloc_env.envs.carlaloc_env; imported = time.perf_counter(); "
        f"gymnasium.make('CarlaLoc-{TOWN}-v0', rig='state'); "
        "print(imported - began, time.perf_counter() - began)"
    )
    command = [sys.executable, "-c", code]
    found = [
        [float(word) for word in done.stdout.split()[-2:]]
        for done in (
            subprocess.run(command, capture_output=True, text=True, check=True)
            for _ in range(1 + bench.repeat)
        )
    ]
    imported_s, whole_s = np.median(found[1:], axis=0)
    return Row(
        name="learn_make",
        what="gymnasium.make from the cache, imports included, over these",
        value=float(whole_s / imported_s),
        unit="× the imports",
        target=2.2,
        at_least=False,
        note=f"{whole_s:.1f} s, the first {found[0][1]:.1f} s",
    )


def learn_reset(bench: Bench) -> Row:
    """Resets in the same town, traffic run in for its ten seconds."""
    env = CarlaLocEnv(map=TOWN, rig="state", traffic=HUNDRED)
    times = time_calls({"ours": lambda: env.reset(seed=3)}, 2 * bench.repeat)["ours"]
    env.close()
    return Row(
        name="learn_reset",
        what="reset in the same town, 100 others",
        value=1e3 * times.median_s,
        unit="ms",
        target=50.0,
        at_least=False,
        ours=times,
    )


def learn_beside_highway_env(bench: Bench) -> Row:
    """Seconds simulated in a second among a hundred others, resets included, beside highway-env."""
    what = "seconds simulated in a second among 100 others, over highway-env's"
    row = partial(Row, name="learn_beside", what=what, unit="× highway-env")
    try:
        import highway_env  # noqa: F401  registers its environments
    except ImportError:
        return row(
            value=None,
            note="no highway-env: pip install --no-deps highway-env (else it brings pygame)",
        )
    seconds = 2.0 if bench.quick else 40.0
    theirs = gymnasium.make(
        "highway-v0", config={"vehicles_count": 100, "duration": 40, "policy_frequency": 5}
    ).unwrapped
    ours = CarlaLocEnv(map=TOWN, rig="state", traffic=HUNDRED, frame_skip=4)
    action: Any = theirs.action_space.sample()

    def drive_theirs() -> None:
        theirs.reset(seed=1)
        for number in range(math.ceil(5 * seconds)):
            *_, ended, over, _ = theirs.step(action)
            if ended or over:
                theirs.reset(seed=number)

    times = time_calls(
        {"ours": partial(_steps, ours, math.ceil(5 * seconds)), "theirs": drive_theirs}, bench.repeat
    )
    ours.close()
    theirs.close()
    both = {name: seconds / timing.median_s for name, timing in times.items()}
    note = f"{both['ours']:.0f} and {both['theirs']:.1f} × real time, both with five actions a second"
    return row(value=both["ours"] / both["theirs"], ours=times["ours"], note=note)
