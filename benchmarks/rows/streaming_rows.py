"""Time to make frames for systems that read a drive in place of a dataset."""

import tempfile
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

from bench import Bench, Row
from scenario import SEED, TOWN
from timing import Timing, time_calls

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from recorder.dataset.rig_sensors import stereo_of
from recorder.drive.record import RecordConfig, record
from recorder.replaying.options import ReplayConfig
from recorder.replaying.plan import plan_replay
from recorder.streaming.frames import FrameJob, FrameMaker, sensors_for

SEEDS = (1, 2, 3)
WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
FROM_NS, LENGTH_NS = 2_000_000_000, 6_000_000_000


def stream_lidar(bench: Bench) -> Row:
    """A sweep with the noise of three seeds over one with that of one: rays are cast once."""
    rig = sensors_for(rig_by_name("paper"), "lidar")
    times = _frames(bench, rig, "lidar", {"one": (WEATHERS[:1], SEEDS[:1]), "all": (WEATHERS[:1], SEEDS)})
    period_s = 1.0 / rig.of_kind("lidar")[0].rate_hz
    return Row(
        name="stream_lidar",
        what="sweep of a drive for systems, noise of 3 seeds over that of one",
        value=times["all"].cpu_s / times["one"].cpu_s,
        unit="× one",
        target=1.5,
        at_least=False,
        ours=times["all"],
        note=f"by CPU time; {period_s / times['all'].cpu_s:.1f} × real time a core",
    )


def stream_stereo(bench: Bench) -> Row:
    """A stereo pair of 640×360 pixels under three weathers over one: geometry is drawn once."""
    pinhole = Pinhole.from_fov(640, 360, 90.0)
    rig = sensors_for(rig_by_name("flu"), "stereo", masks=False)
    small = replace(rig, sensors=tuple(replace(camera, pinhole=pinhole) for camera in stereo_of(rig)))
    times = _frames(bench, small, "stereo", {"one": (WEATHERS[:1], SEEDS[:1]), "all": (WEATHERS, SEEDS[:1])})
    return Row(
        name="stream_stereo",
        what="stereo pair of a drive for systems, 640×360, 3 weathers over one",
        value=times["all"].cpu_s / times["one"].cpu_s,
        unit="× one",
        target=2.0,
        at_least=False,
        ours=times["all"],
        note=f"by CPU time; {times['all'].least_s:.3f} s at best on all cores",
    )


def _frames(
    bench: Bench, rig: SensorRig, sensor: str, jobs: dict[str, tuple[tuple[str, ...], tuple[int, ...]]]
) -> dict[str, Timing]:
    """Times of one frame of a drive through full traffic, for jobs of weathers and seeds in turns."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as open_makers:
        drive = Path(name, "drive.mcap")
        record(RecordConfig(map=TOWN, out=drive, duration_s=8.1, seed=SEED, traffic="dynamic"))
        frames = {}
        for job, (weathers, seeds) in jobs.items():
            plan = plan_replay(
                ReplayConfig(episode=drive, out=Path(name, "none"), rig="flu", weathers=weathers, workers=1)
            )
            recipe = replace(plan.recipe, rig=rig)
            maker = FrameMaker(
                FrameJob(
                    recipe=recipe,
                    level=recipe.levels[0],
                    span_ns=(FROM_NS, FROM_NS + LENGTH_NS),
                    seeds=seeds,
                    sensor=sensor,
                    imu=None,
                )
            )
            open_makers.callback(maker.close)
            frames[job] = partial(next, maker.frames())
        return time_calls(frames, 2 if bench.quick else 8 * bench.repeat, warm_up=3)
