"""Time to make frames for systems that read a drive in place of a dataset."""

import tempfile
from dataclasses import replace
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
    """A sweep with the noise of three seeds, beside real time, on one core."""
    rig = rig_by_name("paper")
    ours = _frame(bench, sensors_for(rig, "lidar"), "lidar", WEATHERS[:1])
    period_s = 1.0 / rig.of_kind("lidar")[0].rate_hz
    return Row(
        name="stream_lidar",
        what="sweeps of a drive for a system, noise of 3 seeds",
        value=period_s / ours.cpu_s,
        unit="× real time a core",
        target=2.0,
        ours=ours,
        note="by CPU time; rays are cast once",
    )


def stream_stereo(bench: Bench) -> Row:
    """A stereo pair of 640×360 pixels under three weathers, on all cores."""
    pinhole = Pinhole.from_fov(640, 360, 90.0)
    rig = sensors_for(rig_by_name("flu"), "stereo", masks=False)
    small = replace(rig, sensors=tuple(replace(camera, pinhole=pinhole) for camera in stereo_of(rig)))
    ours = _frame(bench, small, "stereo", WEATHERS)
    return Row(
        name="stream_stereo",
        what="stereo pair of a drive for systems, 640×360, 3 weathers",
        value=ours.least_s,
        unit="s",
        target=0.15,
        at_least=False,
        ours=ours,
        note="the least time of some; geometry is drawn once",
    )


def _frame(bench: Bench, rig: SensorRig, sensor: str, weathers: tuple[str, ...]) -> Timing:
    """Times of one frame of a drive through full traffic."""
    with tempfile.TemporaryDirectory() as name:
        drive = Path(name, "drive.mcap")
        record(RecordConfig(map=TOWN, out=drive, duration_s=8.1, seed=SEED, traffic="dynamic"))
        plan = plan_replay(
            ReplayConfig(episode=drive, out=Path(name, "none"), rig="flu", weathers=weathers, workers=1)
        )
        recipe = replace(plan.recipe, rig=rig)
        job = FrameJob(
            recipe=recipe,
            level=recipe.levels[0],
            span_ns=(FROM_NS, FROM_NS + LENGTH_NS),
            seeds=SEEDS if sensor == "lidar" else SEEDS[:1],
            sensor=sensor,
            imu=None,
        )
        maker = FrameMaker(job)
        try:
            frames = maker.frames()
            repeat = 2 if bench.quick else 8 * bench.repeat
            return time_calls({"frame": lambda: next(frames)}, repeat, warm_up=3)["frame"]
        finally:
            maker.close()
