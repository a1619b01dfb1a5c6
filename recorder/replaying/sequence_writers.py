"""One sequence of a dataset: its folder, its writers, and what all sequences of a drive share."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.files.output_paths import path_below
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Events
from carlaloc_env.sensors.camera.config import CameraConfig
from carlaloc_env.sensors.inertial.imu import ImuConfig, ImuSensor
from carlaloc_env.timeline.timeline import Timeline
from recorder.dataset.manifest import as_yaml, checksums
from recorder.replaying.conditions import Condition
from recorder.replaying.sample_counts import SampleCounts
from recorder.writers.base import DEFAULT_EPOCH_NS, Piece, Writer, write_text
from recorder.writers.calibration.files import calibration_texts, write_calibration
from recorder.writers.formats.dsec_disparity import DsecDisparityWriter
from recorder.writers.formats.euroc import EurocWriter
from recorder.writers.formats.euroc_states import write_state_csv
from recorder.writers.formats.kitti import KittiWriter
from recorder.writers.formats.preview_video import PreviewWriter, shown_streams
from recorder.writers.formats.raw import RawWriter
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
    about: Mapping[str, str]

    def bag_profiles(self) -> list[tuple[str, str]]:
        """Beginning of the name and topic profile of each bag: the paper's release has two for a LiDAR."""
        seg = (
            [("LIOseg_", "paper_seg")] if self.topics == "paper" and "lidar_semantic" in self.streams else []
        )
        return [("", self.topics), *seg]


def _rosbag1(compression: str) -> Callable[[_WriterContext], list[Writer]]:
    end = "" if compression == "none" else f"_{compression}"

    def make(m: _WriterContext) -> list[Writer]:
        return [
            Rosbag1Writer(
                path_below(m.folder, f"{begin}{m.name}{end}.bag"),
                m.calibration,
                profile=profile,
                streams=m.streams,
                compression=compression,
            )
            for begin, profile in m.bag_profiles()
        ]

    return make


def _rosbag2(storage: str, end: str) -> Callable[[_WriterContext], list[Writer]]:
    def make(m: _WriterContext) -> list[Writer]:
        return [
            Rosbag2Writer(
                path_below(m.folder, f"{begin}{m.name}{end}"),
                m.calibration,
                storage=storage,
                profile=profile,
                streams=m.streams,
                about=m.about,
                attachments=calibration_texts(m.calibration, profile_by_name(m.topics)),
            )
            for begin, profile in m.bag_profiles()
        ]

    return make


def _euroc(m: _WriterContext) -> Writer:
    return EurocWriter(m.folder / "mav0", m.calibration, biases=m.imu.bias if m.imu else None)


def _kitti(m: _WriterContext) -> Writer:
    return KittiWriter(m.folder / "kitti", m.calibration)


def _dsec(m: _WriterContext) -> list[Writer]:
    # Imported where it is asked for: every worker would hold the libraries of HDF5.
    from recorder.writers.formats.dsec import DsecWriter

    folder = path_below(m.folder, "dsec")
    names = [stream.removeprefix("events_") for stream in m.streams if stream.startswith("events_")]
    writers: list[Writer] = [
        DsecWriter(path_below(folder / "events", name) / "events.h5", stream=f"events_{name}")
        for name in names
    ]
    if len(m.calibration.cameras) >= 2 and f"depth_{m.calibration.cameras[0].name}" in m.streams:
        writers.append(DsecDisparityWriter(folder / "disparity", m.calibration))
    return writers


def _raw(m: _WriterContext) -> Writer:
    return RawWriter(m.folder / "raw")


_WRITERS: dict[str, Callable[[_WriterContext], Writer | Sequence[Writer]]] = {
    "rosbag1": _rosbag1("none"),
    "rosbag1_lz4": _rosbag1("lz4"),
    "rosbag1_bz2": _rosbag1("bz2"),
    "rosbag2": _rosbag2("mcap", "_ros2"),
    "rosbag2_sqlite3": _rosbag2("sqlite3", "_sqlite3"),
    "euroc": _euroc,
    "kitti": _kitti,
    "dsec": _dsec,
    "raw": _raw,
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
    if {"dsec", "raw"} & set(formats) or (in_bags and any(name.startswith("rosbag") for name in formats)):
        return rig
    sensors = tuple(
        replace(config, outputs=tuple(output for output in config.outputs if output != "events"))
        if isinstance(config, CameraConfig) and set(config.outputs) - {"events"}
        else config
        for config in rig.sensors
    )
    return replace(rig, sensors=sensors)


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceConfig:
    """What the writers of all sequences of a drive are made of."""

    rig: SensorRig
    """The sensors."""
    formats: tuple[str, ...]
    """Names of dataset formats."""
    topics: str
    """Topic profile of bags."""
    preview: bool
    """Whether a film is made."""
    seed: int
    """Seed of the noise; EuRoC's table of states holds the IMU's true biases."""


def writers_of(
    config: SequenceConfig,
    streams: tuple[str, ...],
    folder: Path,
    *,
    caption: str,
    about: Mapping[str, str] | None = None,
) -> list[Writer]:
    """Writers of one sequence, always in the same order.

    Args:
        config: What they are made of.
        streams: Names of all streams that will come.
        folder: Folder of the sequence; its name is that of bags.
        caption: What the film calls itself.
        about: What bags tell of the sequence, texts by name.

    Raises:
        WriterError: a format needs a sensor that the rig has not.
    """
    calibration = RigCalibration.from_configs(config.rig.sensors)
    context = _WriterContext(
        folder=folder,
        name=folder.name.removeprefix(".").removesuffix(".part"),
        calibration=calibration,
        streams=streams,
        topics=config.topics,
        imu=_imu_sensor(config.rig, config.seed),
        about=about or {},
    )
    writers: list[Writer] = []
    for name in dict.fromkeys(config.formats):
        made = _WRITERS[name](context)
        writers += [made] if isinstance(made, Writer) else made
    if config.preview:
        writers += _film(calibration, streams, folder / "preview.mp4", caption)
    return writers


def _film(
    calibration: RigCalibration, streams: tuple[str, ...], path: Path, caption: str
) -> list[PreviewWriter]:
    """The writer of the film of the first camera and the LiDAR; none of a rig without either."""
    camera, lidar = next(iter(calibration.cameras), None), calibration.lidar
    shown = shown_streams(
        streams, camera=camera.name if camera else None, lidar=lidar.name if lidar else None
    )
    if not shown:
        return []
    first = lidar if camera is None or next(iter(shown.values())) == "cloud" else camera
    assert first is not None
    return [PreviewWriter(path, shown=shown, rate_hz=first.rate_hz, caption=caption)]


class WriterGroup:
    """All writers of one sequence, as one; the folder gets its final name when all are whole."""

    def __init__(self, sequence: DatasetSequence, config: SequenceConfig, streams: tuple[str, ...]) -> None:
        self._sequence, self._rig = sequence, config.rig.name
        caption = sequence.condition.name.replace("_", ", ")
        condition = sequence.condition
        about = {
            "name": sequence.folder.name,
            "town": sequence.folder.parent.name,
            "weather": json.dumps({"name": condition.weather_name, **condition.weather.to_mapping()}),
            "traffic": json.dumps(asdict(condition.traffic)),
            "rig": config.rig.name,
            "topics": config.topics,
            "noise_seed": str(config.seed),
            "epoch_ns": str(DEFAULT_EPOCH_NS),
        }
        self._writers = writers_of(config, streams, sequence.part, caption=caption, about=about)

    def open(self) -> None:
        """Start writing; what a killed run has left is removed."""
        shutil.rmtree(self._sequence.part, ignore_errors=True)
        self._sequence.part.mkdir(parents=True)
        for writer in self._writers:
            writer.open()

    def place(self, number: int, piece: Piece) -> None:
        """Give a piece to the writer of a number."""
        self._writers[number].place(piece)

    def close(self, counts: SampleCounts) -> None:
        """Complete all files, note their checksums, and give the folder its final name."""
        for writer in self._writers:
            writer.close()
        part, condition = self._sequence.part, self._sequence.condition
        summary = {
            "name": self._sequence.folder.name,
            "weather": {"name": condition.weather_name, **condition.weather.to_mapping()},
            "traffic": asdict(condition.traffic),
            "rig": self._rig,
            "epoch_ns": DEFAULT_EPOCH_NS,
            "samples": counts.samples(),
            "movers": counts.shares(),
            "sha256": checksums(part),
        }
        write_text(part / "sequence.yaml", as_yaml(summary))
        part.rename(self._sequence.folder)

    def abort(self) -> None:
        """Remove what was written."""
        for writer in self._writers:
            writer.abort()
        shutil.rmtree(self._sequence.part, ignore_errors=True)


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
