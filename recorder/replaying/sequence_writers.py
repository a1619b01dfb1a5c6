"""Encoders and writers of a sequence, in every format, and the files that all sequences of a drive share."""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.files.output_paths import path_below
from carlaloc_env.faults.faults import Faults
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig, ImuSensor
from carlaloc_env.timeline.timeline import Timeline
from recorder.dataset.checksums import write_checksums
from recorder.dataset.layout import FILM, FORMATS, SEG_BAG, DriveFolder, SequenceFolder
from recorder.dataset.manifest import SequenceDescription
from recorder.episode.traffic_level import traffic_level
from recorder.replaying.conditions import Condition
from recorder.replaying.recipe import Recipe
from recorder.replaying.sample_counts import SampleCounts
from recorder.writers.base import DEFAULT_EPOCH_NS, Encoder, Piece, Writer, write_text
from recorder.writers.calibration.files import calibration_texts, write_calibration
from recorder.writers.formats.colmap import CLEAN_PLATE, ColmapEncoder, ColmapWriter
from recorder.writers.formats.doppler_icp import DopplerIcpEncoder, DopplerIcpWriter
from recorder.writers.formats.euroc import EurocEncoder, EurocWriter
from recorder.writers.formats.euroc_states import write_state_csv
from recorder.writers.formats.kitti import KittiEncoder, KittiWriter
from recorder.writers.formats.nuscenes import NuscenesEncoder, NuscenesWriter
from recorder.writers.formats.opv2v import Opv2vEncoder, Opv2vWriter
from recorder.writers.formats.preview_video import PreviewEncoder, PreviewWriter, shown_streams
from recorder.writers.formats.raw import RawEncoder, RawWriter
from recorder.writers.formats.rinex import RinexEncoder, RinexWriter
from recorder.writers.formats.tum import write_truth
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer
from recorder.writers.topic_profiles import profile_for

if TYPE_CHECKING:
    from recorder.writers.formats.town_ground import TownGround

Streams = tuple[str, ...]
"""Names of all streams that will come."""


@dataclass(frozen=True, slots=True)
class Output:
    """A file or folder of a sequence."""

    encoder: Encoder
    """Makes pieces, anywhere and in any order."""
    writer: Callable[..., Writer]
    """Class of the writer that puts them into the file."""
    path: str
    """Path below the sequence's folder; ``{}`` stands for the sequence's name."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of the writer."""

    def open(self, folder: SequenceFolder) -> Writer:
        """Start writing the file in a sequence's folder.

        Raises:
            WriterError: the file exists or cannot be created.
        """
        path = path_below(folder.path, self.path.format(folder.name))
        writer = self.writer(path, self.encoder, **self.options)
        writer.open()
        return writer


def outputs_of(
    recipe: Recipe,
    streams: Streams,
    about: Mapping[str, str] | None = None,
    condition: Condition | None = None,
) -> list[Output]:
    """Outputs of a sequence, always in the same order.

    Args:
        recipe: Sequences to make of the drive.
        streams: Names of all streams that will come.
        about: Texts by name that files hold of the sequence, where they are written.
        condition: Weather and traffic of the sequence, where they are written.

    Raises:
        WriterError: a format needs a sensor that the rig has not.
    """
    about = about or {}
    calibration = RigCalibration.from_configs(recipe.believed.sensors)
    outputs: list[Output] = []
    for name in dict.fromkeys(recipe.formats):
        path = FORMATS[name].place
        if FORMATS[name].is_bag:
            outputs += _bags(name, recipe, calibration, streams, about)
        elif name == "euroc":
            imu = _imu_sensor(recipe.rig, recipe.seed)
            encoder = EurocEncoder(calibration, biases=imu.bias if imu else None)
            outputs.append(Output(encoder, EurocWriter, path))
        elif name == "kitti":
            outputs.append(Output(KittiEncoder(calibration), KittiWriter, path))
        elif name == "dsec":
            outputs += _dsec(path, calibration, streams)
        elif name == "nuscenes":
            nuscenes = NuscenesEncoder(calibration, streams)
            options = {"ground": partial(_ground, recipe, condition), "about": about}
            outputs.append(Output(nuscenes, NuscenesWriter, path, options))
        elif name == "opv2v":
            options = {"ground": partial(_ground, recipe, condition), "about": about, "agent": recipe.agent}
            outputs.append(Output(Opv2vEncoder(calibration, streams), Opv2vWriter, path, options))
        elif name == "doppler_icp":
            outputs.append(Output(DopplerIcpEncoder(calibration, streams), DopplerIcpWriter, path))
        elif name == "colmap":
            twins = {"twins": _twins(recipe, condition)}
            outputs.append(Output(ColmapEncoder(calibration, streams), ColmapWriter, path, twins))
        elif name == "rinex":
            if not any(isinstance(one, GnssConfig) and one.raw for one in recipe.rig.sensors):
                raise WriterError("rinex needs a sensor of kind gnss with raw: true; add it to the rig")
            outputs.append(Output(RinexEncoder(), RinexWriter, path))
        else:
            outputs.append(Output(RawEncoder(), RawWriter, path))
    if recipe.preview:
        outputs += _film(calibration, streams, about)
    return outputs


def _bags(
    name: str, recipe: Recipe, calibration: RigCalibration, streams: Streams, about: Mapping[str, str]
) -> list[Output]:
    """The bag of a format; two of a LiDAR with the topics of the paper's release."""
    family, _, kind = name.partition("_")
    encoder: Callable[..., Encoder] = Ros1Encoder
    writer: Callable[..., Writer] = Rosbag1Writer
    options: dict[str, Any] = {"compression": kind or "none"}
    if family == "rosbag2":
        texts = calibration_texts(calibration, profile_for(recipe.topics, calibration.sensors))
        encoder, writer = Ros2Encoder, Rosbag2Writer
        options = {"storage": kind or "mcap", "about": about, "attachments": texts}
    profiles = {"": recipe.topics}
    if recipe.topics == "paper" and "lidar_semantic" in streams:
        profiles[SEG_BAG] = "paper_seg"
    extras = {"truth_tf": recipe.truth_tf, "clock": recipe.clock}
    return [
        Output(
            encoder(calibration, profile=profile, streams=streams, **extras),
            writer,
            begin + FORMATS[name].place,
            options,
        )
        for begin, profile in profiles.items()
    ]


def _ground(recipe: Recipe, condition: Condition | None) -> "TownGround":
    """The town's mask and parked cars; the parts of towns are imported where they are needed."""
    from carlaloc_env.town.build import load_town
    from recorder.writers.formats.town_ground import ground_of

    return ground_of(load_town(recipe.town), parked_cars=condition is None or condition.traffic.parked_cars)


def _twins(recipe: Recipe, condition: Condition | None) -> dict[str, str]:
    """Sequences that show the same views, by name: the one without traffic, and those of other weathers."""
    if condition is None:
        return {}
    twins = {}
    if condition.traffic.fraction > 0.0:
        twins[CLEAN_PLATE] = replace(condition, traffic=traffic_level("static")).name
    for other in recipe.conditions_of(condition.traffic):
        if other.weather_name != condition.weather_name:
            twins[other.weather_name] = other.name
    return twins


def _dsec(path: str, calibration: RigCalibration, streams: Streams) -> list[Output]:
    # Imported where it is asked for: every worker would hold the libraries of HDF5.
    from recorder.writers.formats.dsec import DsecEncoder, DsecWriter
    from recorder.writers.formats.dsec_disparity import DsecDisparityEncoder, DsecDisparityWriter

    outputs = [
        Output(DsecEncoder(stream), DsecWriter, f"{path}/events/{stream.removeprefix('events_')}/events.h5")
        for stream in streams
        if stream.startswith("events_")
    ]
    if len(calibration.cameras) >= 2 and f"depth_{calibration.cameras[0].name}" in streams:
        encoder = DsecDisparityEncoder(calibration)
        outputs.append(Output(encoder, DsecDisparityWriter, f"{path}/disparity"))
    return outputs


def _film(calibration: RigCalibration, streams: Streams, about: Mapping[str, str]) -> list[Output]:
    """The film of the first camera and the LiDAR; none of a rig without either."""
    camera, lidar = next(iter(calibration.cameras), None), calibration.lidar
    shown = shown_streams(
        streams, camera=camera.name if camera else None, lidar=lidar.name if lidar else None
    )
    if not shown:
        return []
    first = lidar if camera is None or next(iter(shown.values())) == "cloud" else camera
    assert first is not None
    options = {"rate_hz": first.rate_hz, "caption": about.get("name", "").replace("_", " ")}
    return [Output(PreviewEncoder(shown), PreviewWriter, FILM, options)]


class SequenceWriters:
    """All writers of a sequence together; the folder gets its final name when all files are whole.

    Args:
        drive: Folder of the drive.
        condition: Weather and traffic.
        recipe: Sequences to make of the drive.
        streams: Names of all streams that will come.
    """

    def __init__(self, drive: DriveFolder, condition: Condition, recipe: Recipe, streams: Streams) -> None:
        self._condition, self._rig = condition, recipe.rig
        self._folder = drive.sequence(condition.name)
        self._part = self._folder.part
        about = {
            "name": condition.name,
            "town": drive.path.name,
            "weather": json.dumps({"name": condition.weather_name, **condition.weather.to_mapping()}),
            "traffic": json.dumps(asdict(condition.traffic)),
            "rig": recipe.rig.name,
            "topics": recipe.topics,
            "noise_seed": str(recipe.seed),
            "epoch_ns": str(DEFAULT_EPOCH_NS),
            **({"faults": json.dumps(condition.faults.to_mapping())} if condition.faults else {}),
        }
        self._outputs = outputs_of(recipe, streams, about, condition)
        self._writers: list[Writer] = []

    def open(self) -> None:
        """Start writing; what a killed run has left is removed."""
        shutil.rmtree(self._part.path, ignore_errors=True)
        self._part.path.mkdir(parents=True)
        for output in self._outputs:
            self._writers.append(output.open(self._part))

    def place(self, number: int, piece: Piece) -> None:
        """Give a piece to the writer with this number."""
        self._writers[number].place(piece)

    def close(self, counts: SampleCounts) -> None:
        """Complete all files, describe them, note their checksums, and give the folder its final name."""
        for writer in self._writers:
            writer.close()
        description = describe(
            self._condition, rig=self._rig, samples=counts.samples(), movers=counts.shares()
        )
        write_text(self._part.description, description.to_yaml())
        write_checksums(self._part.path)
        self._part.path.rename(self._folder.path)

    def abort(self) -> None:
        """Remove what was written."""
        for writer in self._writers:
            writer.abort()
        shutil.rmtree(self._part.path, ignore_errors=True)


def describe(
    condition: Condition, *, rig: SensorRig, samples: Mapping[str, int], movers: Mapping[str, float]
) -> SequenceDescription:
    """Description of a sequence for ``sequence.yaml``."""
    return SequenceDescription(
        name=condition.name,
        weather={"name": condition.weather_name, **condition.weather.to_mapping()},
        traffic=asdict(condition.traffic),
        rig=rig.name,
        epoch_ns=DEFAULT_EPOCH_NS,
        samples=samples,
        movers=movers,
        faults=condition.faults.to_mapping(),
        readout_ms={
            camera.name: camera.shutter.readout_ms
            for camera in rig.sensors
            if isinstance(camera, CameraConfig) and camera.shutter is not None and camera.shutter.readout_ms
        },
    )


def write_shared(
    drive: DriveFolder,
    rig: SensorRig,
    timeline: Timeline,
    span_ns: tuple[int, int],
    *,
    topics: str,
    seed: int,
    faults: Faults,
) -> None:
    """Write calibration and ground truth of a drive, the same for all its sequences.

    Args:
        drive: Folder of the drive in the dataset.
        rig: The sensors.
        timeline: The drive.
        span_ns: First stamp and end (not included) of the ground truth [ns].
        topics: Topic profile that the calibration files name.
        seed: Seed of the noise; the table of states holds the IMU's true biases.
        faults: Those of the calibration change its files; truth is that of the true rig.
    """
    believed = RigCalibration.from_configs(rig.believed(faults).sensors)
    write_calibration(drive.calibration, believed, profile=topics)
    calibration = RigCalibration.from_configs(rig.sensors)
    stamps = np.arange(span_ns[0], span_ns[1], TICK_NS)
    write_truth(drive.ground_truth, timeline, stamps, {"base_link": np.eye(4), **calibration.frames})
    imu = _imu_sensor(rig, seed)
    body = imu.config.mount.T_base_sensor if imu is not None else np.eye(4)
    biases = imu.bias(stamps.tolist()) if imu is not None else None
    write_state_csv(drive.states, timeline.ego_motion(stamps).at_mount(body), biases=biases)


def _imu_sensor(rig: SensorRig, seed: int) -> ImuSensor | None:
    config = next((config for config in rig.sensors if isinstance(config, ImuConfig)), None)
    return ImuSensor(config, seed) if config is not None else None
