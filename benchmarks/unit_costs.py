"""What a second of driving costs in the dataset factory, part by part, in processor time of one core.

`recorder/factory/time_estimate.py` holds these figures and tells from them how long a dataset
takes.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from bench import Bench
from scenario import SEED, TOWN
from timing import time_calls

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.samples import Sample
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera.config import CameraConfig
from carlaloc_env.sensors.lidar.config import LidarConfig
from carlaloc_env.sensors.radar.config import RadarConfig
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.world import traffic_of_town
from carlaloc_env.weather.schedule import weather_of
from recorder.dataset.layout import SequenceFolder
from recorder.devices.registry import open_device
from recorder.replaying.sequence_writers import outputs_of
from recorder.replaying.units import Recipe
from recorder.writers.base import Piece

WEATHERS = ("ClearNoon", "FoggyNoon", "RainyNight")


def main(repeat: int) -> None:
    """Print all costs."""
    bench = Bench(repeat=repeat, quick=False)
    noon = weather_of("ClearNoon")
    _print("town: load [s]", _cpu(lambda: SensorStage(load_town(TOWN), seed=SEED, weather=noon), 1))
    _print("driving among the town's traffic [s/s]", _driving(bench))
    rig = rig_by_name("paper")
    camera = next(c for c in rig.sensors if isinstance(c, CameraConfig))
    plain = replace(camera, outputs=("rgb", "depth", "semantic"))
    mpx = plain.pinhole.width_px * plain.pinhole.height_px / 1e6
    once = {name: _conditions(bench, plain, (name,)) / mpx for name in WEATHERS}
    twice = {name: _conditions(bench, plain, (name, "CloudyNoon")) / mpx for name in WEATHERS}
    for name in WEATHERS:
        _print(f"camera, {name} alone [s/Mpx]", once[name])
    cloudy = _conditions(bench, plain, ("CloudyNoon",)) / mpx
    for name in WEATHERS:
        _print(f"camera, {name} as a further weather [s/Mpx]", twice[name] - cloudy)
    events = replace(camera, outputs=("rgb", "depth", "semantic", "events"))
    _print(
        "events of a weather [s/Mpx]", _conditions(bench, events, ("ClearNoon",)) / mpx - once["ClearNoon"]
    )
    lidar = next(c for c in rig.sensors if isinstance(c, LidarConfig))
    _print("LiDAR [s/Mray]", _plain(bench, lidar) / lidar.rays * 1e6)
    radar = next(c for c in rig.sensors if isinstance(c, RadarConfig))
    _print("radar [s/scan]", _plain(bench, radar))
    samples = [*_samples(bench, plain), *_samples(bench, lidar)]
    for name, topics, preview in (
        ("rosbag1", "standard", False),
        ("rosbag2", "standard", False),
        ("rosbag2", "compact", False),
        ("rosbag2", "compact_full", False),
        ("euroc", "standard", False),
        ("kitti", "standard", False),
        ("dsec", "standard", False),
        ("raw", "standard", False),
        ("preview", "standard", True),
    ):
        formats = () if preview else (name,)
        encode, place, size = _writing(bench, samples, formats, topics, preview=preview)
        _print(f"{name} {topics}: encode [s/instant of a camera and the LiDAR, {size / 1e6:.2f} MB]", encode)
        _print(f"{name} {topics}: place [s/instant]", place)


def _print(what: str, value: float) -> None:
    print(f"{what:<75} {value:8.4f}", flush=True)


def _cpu(call: Callable[[], object], repeat: int, warm_up: int = 0) -> float:
    return time_calls({"it": call}, repeat, warm_up=warm_up)["it"].cpu_s


def _driving(bench: Bench) -> float:
    world = DrivingWorld(bench.town, traffic_of_town(bench.town, "dynamic", SEED))
    driver = open_device("scripted", SEED)
    world.reset()

    def second() -> None:
        for _ in range(200):
            world.tick(driver.read(world.driver_view()))

    cost = _cpu(second, 3 * bench.repeat, warm_up=2)
    driver.close()
    world.close()
    return cost


def _conditions(bench: Bench, config: CameraConfig, names: tuple[str, ...]) -> float:
    sensor: Any = config.build(bench.stage)
    weathers = [weather_of(name) for name in names]
    stamps = itertools.cycle(sorted(bench.drive.stamps_ns))
    return _cpu(
        lambda: sensor.measure_conditions(bench.drive.timeline, next(stamps), weathers), 4 * bench.repeat, 4
    )


def _plain(bench: Bench, config: LidarConfig | RadarConfig) -> float:
    return _cpu(bench.sweep(config.build(bench.stage)), 4 * bench.repeat, 4)


def _samples(bench: Bench, config: CameraConfig | LidarConfig) -> list[Sample]:
    stamp = min(bench.drive.stamps_ns)
    return list(config.build(bench.stage).measure(bench.drive.timeline, [stamp]))


def _writing(
    bench: Bench, samples: list[Sample], formats: tuple[str, ...], topics: str, *, preview: bool
) -> tuple[float, float, int]:
    """Processor time of encoding and of placing an instant [s], and its pieces' size [bytes]."""
    rig = rig_by_name("paper")
    recipe = Recipe(
        episode=Path(), town=Path(), conditions=(), rig=rig, camera_ns=(0, 0), seed=SEED, quality="medium",
        formats=formats, topics=topics, preview=preview,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        outputs = outputs_of(recipe, tuple(s.sensor for s in samples))
        writers = [output.place(SequenceFolder(Path(folder) / "s"), {}) for output in outputs]
        (Path(folder) / "s").mkdir()
        for writer in writers:
            writer.open()
        encode = _cpu(lambda: [w.encoder.encode(s) for w in writers for s in samples], 2 * bench.repeat, 1)
        pieces = [
            (writer, piece) for writer in writers for s in samples for piece in writer.encoder.encode(s)
        ]
        later = itertools.count(samples[0].stamp_ns, STEP_NS)

        def place() -> None:
            stamp = next(later)
            for writer, piece in pieces:
                writer.place(Piece(stamp, piece.place, piece.kind, piece.data))

        cost = _cpu(place, 6 * bench.repeat, 1)
        for writer in writers:
            writer.abort()
    return encode, cost, sum(len(piece.data) for _, piece in pieces)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="calls that are timed (3)")
    main(parser.parse_args().repeat)
