"""One stereo frame of the paper's rig among many cars: `python benchmarks/stereo.py [TOWN ...]`.

Colour, depth and semantics of both cameras, under one weather and under three. Prints the shortest
wall-clock and CPU times; on an idle machine with two cores the wall-clock time is a good half of the
CPU time.
"""

import argparse
from functools import partial

import numpy as np
from timing import time_calls

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.transforms import transform
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.snapshot import Snapshot
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.standing_traffic import standing_traffic
from carlaloc_env.weather.presets import PRESETS

ACTORS = 60
WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")
TARGETS_S = {1: 0.35, 3: 0.60}
CLEAR_M = 8.0


def ahead(town: Town, stage: SensorStage, T_world_base: np.ndarray) -> tuple[Instances, int]:
    """The ego and the actors nearest in front of it, and how many those are."""
    catalog, frame = standing_traffic(town.network, 1000)
    way = frame.position_m - T_world_base[:3, 3]
    forward, aside = way @ T_world_base[:3, 0], way @ T_world_base[:3, 1]
    shown = np.flatnonzero((forward > CLEAR_M) & (np.abs(aside) < forward))
    shown = shown[np.argsort(forward[shown], kind="stable")][:ACTORS]
    snapshot = Snapshot(
        stamp_ns=0,
        T_world_base=T_world_base,
        catalog=catalog.take(shown),
        actors=frame.take(shown),
        signals=np.ones(int(town.outline.lenses.signal.max(initial=-1)) + 1, np.uint8),
    )
    return instances_at(stage.library, town.outline.lenses, snapshot), len(shown)


class Instant:
    """One stereo frame at a share of a town's route."""

    def __init__(self, name: str, *, share: float, quality: str) -> None:
        town = load_town(name)
        assert town.route is not None
        self.stage = SensorStage(town, seed=1, weather=PRESETS["ClearNoon"], quality=quality)
        at = town.route.at(np.array([share * town.route.length_m]))
        heading = float(at.heading_rad[0])
        self._T = transform(at.position_m[0], [0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)])
        self._seen, self.actors = ahead(town, self.stage, self._T)
        self._cameras = [c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig)]
        self.renderer = self.stage.renderer()

    def draw(self, weathers: tuple[str, ...]) -> None:
        """Colour, depth and labels of both cameras."""
        for camera in self._cameras:
            gbuffer = self.renderer.draw(camera.pinhole, self._T @ camera.mount.T_base_sensor, self._seen)
            gbuffer.depth_m()
            gbuffer.labels()
            weather = [PRESETS[one] for one in weathers]
            self.renderer.shade_all(gbuffer, weather, stamp_ns=10**9, seed=1)


def measure(name: str, share: float, quality: str, repeat: int) -> None:
    """Time the stereo frames at a share of a town's route and print a line for each."""
    instant = Instant(name, share=share, quality=quality)
    sets = [*((one,) for one in WEATHERS), WEATHERS]
    calls = {" + ".join(weathers): partial(instant.draw, weathers) for weathers in sets}
    for what, timing in time_calls(calls, repeat).items():
        target = TARGETS_S[3 if "+" in what else 1]
        print(
            f"{name}, {instant.actors} actors, {quality}: {what:<36} least {timing.least_s:.2f} s, "
            f"CPU {timing.cpu_s:.2f} s, target {target:.2f} s"
        )
    instant.stage.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("towns", nargs="*", help="Town03 and Town10 when left out")
    parser.add_argument("--at", type=float, default=0.3, help="share of the route (0.3)")
    parser.add_argument("--quality", default="medium", help="low, medium or high")
    parser.add_argument("--repeat", type=int, default=5, help="calls that are timed (5)")
    arguments = parser.parse_args()
    for town_name in arguments.towns or ("Town03", "Town10"):
        measure(town_name, arguments.at, arguments.quality, arguments.repeat)
