"""One sequence of a dataset: its folder, its writers, and what all sequences of a drive share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.output_paths import path_below
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Events, Sample
from carlaloc_env.sensors.camera.config import CameraConfig
from carlaloc_env.sensors.inertial.imu import ImuConfig, ImuSensor
from carlaloc_env.timeline.timeline import Timeline
from recorder.generation.conditions import Condition
from recorder.generation.dataset_manifest import as_yaml, checksums
from recorder.generation.mover_share import MoverShare
from recorder.writers.base import DEFAULT_EPOCH_NS, Writer, write_text
from recorder.writers.calibration.files import write_calibration
from recorder.writers.formats.dsec import DsecWriter
from recorder.writers.formats.euroc import EurocWriter
from recorder.writers.formats.euroc_states import write_state_csv
from recorder.writers.formats.kitti import KittiWriter
from recorder.writers.formats.preview_video import PreviewWriter
from recorder.writers.formats.tum import write_truth
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.rosbag1 import Rosbag1Writer
from recorder.writers.ros.rosbag2 import Rosbag2Writer
from recorder.writers.topics import profile_by_name


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetSequence:
    """A condition and the folder its data goes to."""

    condition: Condition
    """Weather and traffic."""
    folder: Path
    """Final name of the folder; while it is written it stands as `.<name>.part` beside it."""

    @property
    def part(self) -> Path:
        """Folder while it is being written."""
        return self.folder.with_name(f".{self.folder.name}.part")


@dataclass(frozen=True, slots=True, kw_only=True)
class _WriterContext:
    """What a format needs to make its writer."""

    folder: Path
    name: str
    calibration: RigCalibration
    streams: tuple[str, ...]
    topics: str
    imu: ImuSensor | None


def _rosbag1(m: _WriterContext) -> Writer:
    target = path_below(m.folder, f"{m.name}.bag")
    return Rosbag1Writer(target, m.calibration, profile=m.topics, streams=m.streams)


def _rosbag2(m: _WriterContext) -> Writer:
    return Rosbag2Writer(m.folder / f"{m.name}_ros2", m.calibration, profile=m.topics, streams=m.streams)


def _rosbag2_sqlite3(m: _WriterContext) -> Writer:
    return Rosbag2Writer(
        m.folder / f"{m.name}_sqlite3", m.calibration, storage="sqlite3", profile=m.topics, streams=m.streams
    )


def _euroc(m: _WriterContext) -> Writer:
    return EurocWriter(m.folder / "mav0", m.calibration, biases=m.imu.bias if m.imu else None)


def _kitti(m: _WriterContext) -> Writer:
    return KittiWriter(m.folder / "kitti", m.calibration)


def _dsec(m: _WriterContext) -> list[Writer]:
    streams = [stream for stream in m.streams if stream.startswith("events_")]
    return [DsecWriter(path_below(m.folder, f"{stream}.h5"), stream=stream) for stream in streams]


_WRITERS: dict[str, Callable[[_WriterContext], Writer | list[Writer]]] = {
    "rosbag1": _rosbag1,
    "rosbag2": _rosbag2,
    "rosbag2_sqlite3": _rosbag2_sqlite3,
    "euroc": _euroc,
    "kitti": _kitti,
    "dsec": _dsec,
}
"""Dataset formats by name."""


def without_unwritten(rig: SensorRig, formats: Sequence[str], topics: str) -> SensorRig:
    """The rig without event cameras if no format holds events: they cost more than all else.

    Args:
        rig: The sensors.
        formats: Names of dataset formats.
        topics: Topic profile of bags.
    """
    in_bags = any(rule.sample is Events for rule in profile_by_name(topics).rules)
    if "dsec" in formats or (in_bags and any(name.startswith("rosbag") for name in formats)):
        return rig
    sensors = tuple(
        replace(config, outputs=tuple(output for output in config.outputs if output != "events"))
        if isinstance(config, CameraConfig) and set(config.outputs) - {"events"}
        else config
        for config in rig.sensors
    )
    return replace(rig, sensors=sensors)


class WriterGroup:
    """All writers of one sequence, as one; the folder gets its final name when all are whole."""

    def __init__(self, sequence: DatasetSequence, writers: list[Writer], summary: dict[str, Any]) -> None:
        self._sequence = sequence
        self._writers = writers
        self._summary = summary
        self._counts: dict[str, int] = {}
        self._movers = MoverShare()

    def open(self) -> None:
        """Start writing."""
        self._sequence.part.mkdir(parents=True, exist_ok=True)
        for writer in self._writers:
            writer.open()

    def write(self, sample: Sample) -> None:
        """Give a sample to every writer."""
        self._counts[sample.sensor] = self._counts.get(sample.sensor, 0) + 1
        self._movers.count(sample)
        for writer in self._writers:
            writer.write(sample)

    def close(self) -> None:
        """Complete all files, note their checksums, and give the folder its final name."""
        for writer in self._writers:
            writer.close()
        part = self._sequence.part
        summary = {
            **self._summary,
            "samples": dict(sorted(self._counts.items())),
            "movers": self._movers.shares(),
            "sha256": checksums(part),
        }
        write_text(part / "sequence.yaml", as_yaml(summary))
        part.rename(self._sequence.folder)

    def abort(self) -> None:
        """Remove what was written."""
        for writer in self._writers:
            writer.abort()


def sequence_writers(
    sequence: DatasetSequence,
    rig: SensorRig,
    streams: tuple[str, ...],
    *,
    formats: Sequence[str],
    topics: str,
    preview: bool,
    seed: int,
) -> WriterGroup:
    """Writers of one sequence.

    Args:
        sequence: Where to.
        rig: The sensors.
        streams: Names of all streams that will come.
        formats: Names of dataset formats.
        topics: Topic profile of bags.
        preview: Whether a film is made.
        seed: Seed of the noise; EuRoC's table of states holds the IMU's true biases.
    """
    calibration = RigCalibration.from_configs(rig.sensors)
    context = _WriterContext(
        folder=sequence.part,
        name=sequence.folder.name,
        calibration=calibration,
        streams=streams,
        topics=topics,
        imu=_imu_sensor(rig, seed),
    )
    writers: list[Writer] = []
    for name in dict.fromkeys(formats):
        made = _WRITERS[name](context)
        writers += made if isinstance(made, list) else [made]
    if preview and calibration.cameras:
        camera = calibration.cameras[0]
        writers.append(
            PreviewWriter(
                sequence.part / "preview.mp4",
                camera=camera.name,
                rate_hz=camera.rate_hz,
                caption=sequence.condition.name.replace("_", ", "),
            )
        )
    summary = {
        "name": sequence.folder.name,
        "weather": {"name": sequence.condition.weather_name, **sequence.condition.weather.to_mapping()},
        "traffic": asdict(sequence.condition.traffic),
        "rig": rig.name,
        "epoch_ns": DEFAULT_EPOCH_NS,
    }
    return WriterGroup(sequence, writers, summary)


def write_shared(
    town_dir: Path,
    rig: SensorRig,
    timeline: Timeline,
    span_ns: tuple[int, int],
    *,
    topics: str,
    seed: int,
) -> None:
    """Write calibration and ground truth of a drive, the same for all its sequences.

    Args:
        town_dir: Folder of the town in the dataset.
        rig: The sensors.
        timeline: The drive.
        span_ns: First stamp and end (not included) of the ground truth [ns].
        topics: Topic profile that the calibration files name.
        seed: Seed of the noise; the table of states holds the IMU's true biases.
    """
    calibration = RigCalibration.from_configs(rig.sensors)
    write_calibration(town_dir / "calibration", calibration, profile=topics)
    stamps = np.arange(span_ns[0], span_ns[1], TICK_NS)
    folder = town_dir / "ground_truth"
    write_truth(folder, timeline, stamps, {"base_link": np.eye(4), **calibration.frames})
    imu = _imu_sensor(rig, seed)
    body = imu.config.mount.T_base_sensor if imu is not None else np.eye(4)
    biases = imu.bias(stamps.tolist()) if imu is not None else None
    write_state_csv(folder / "state.csv", timeline.ego_motion(stamps).at_mount(body), biases=biases)


def _imu_sensor(rig: SensorRig, seed: int) -> ImuSensor | None:
    config = next((config for config in rig.sensors if isinstance(config, ImuConfig)), None)
    return ImuSensor(config, seed) if config is not None else None
