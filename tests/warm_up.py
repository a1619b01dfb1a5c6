"""Build and compile once what two processes of tests would both begin with, outside any limit of time.

`make test` runs it in a fresh environment: Town03 and its traffic, and the compiled functions of a drive and
of sensors. They stay in the caches of the user; what is there already is only read.
"""

import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from shared_fixtures.drives.drives import small_cameras
from shared_fixtures.worlds.maps import VILLAGE

from carlaloc_env.core.transforms import rpy_to_quat
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.actors import empty_catalog, empty_frame
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.build import load_town
from carlaloc_env.weather.presets import weather_by_name
from recorder.drive.record import RecordConfig, record

EVERY = ("rgb", "depth", "semantic", "events")
"""Outputs of cameras whose functions are compiled."""


def drive() -> None:
    """One second of Town03 among little traffic."""
    with TemporaryDirectory() as folder:
        record(RecordConfig(map="Town03", out=Path(folder, "drive.mcap"), duration_s=1.0, traffic="0.2"))


def sense() -> None:
    """What a car that stands in a village senses in a tenth of a second of a rainy night."""
    town = load_town(VILLAGE)
    assert town.route is not None
    place = town.route.at(np.zeros(41))
    turned = rpy_to_quat(np.zeros(41), -place.pitch_rad, place.heading_rad)
    timeline = Timeline(empty_catalog(), ego=EgoTrack.from_arrays(place.position_m, turned))
    for _ in range(5):
        timeline.append_step(empty_frame(), np.ones(int(town.outline.lenses.signal.max()) + 1, np.uint8))
    stage = SensorStage(town, seed=1, weather=weather_by_name("HardRainNight"), quality="low")
    rig = small_cameras(rig_by_name("paper"))
    sensors = tuple(replace(s, outputs=EVERY) if isinstance(s, CameraConfig) else s for s in rig.sensors)
    replace(rig, sensors=sensors).build(stage).measure(timeline, -1, 100_000_000)
    stage.close()


def cost_of(work: Callable[[], None]) -> float:
    """Do the work; returns the processor time of this process so far [s]."""
    work()
    return sum(os.times()[:2])


def main() -> None:
    """Both at once; what fails here fails in tests, which say why."""
    print("warm up: Town03, and what drives and senses; some minutes the first time", flush=True)
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        works = {pool.submit(cost_of, work): work for work in (drive, sense)}
        for done in as_completed(works):
            error = done.exception()
            found = f"{done.result():.0f} s of processor time" if error is None else f"left out, {error}"
            print(f"warm up: {works[done].__name__}, {found}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
