"""Names of all files and folders of a dataset; every other module asks here.

```
DIR/dataset.yaml  SHA256SUMS  episodes/TOWN.mcap      what it holds, checksums, recorded drives
DIR/TOWN/calibration/  ground_truth/                  shared by all sequences of a drive
DIR/TOWN/WEATHER_TRAFFIC/sequence.yaml  SHA256SUMS    one sequence: its description, its checksums,
    preview.mp4  preview.png                          a film, and one of its images,
    bags, mav0/, kitti/, dsec/, nuscenes/, colmap/,   and its data, in the formats of `FORMATS`
    opv2v/, doppler_icp/, gnss/, raw/
```
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.files.atomic_files import part_path
from carlaloc_env.core.files.output_paths import path_below

DATASET, SEQUENCE, CHECKSUMS = "dataset.yaml", "sequence.yaml", "SHA256SUMS"
"""Descriptions of a dataset and of a sequence; checksums of all files below a folder."""
CALIBRATION, GROUND_TRUTH, EPISODES = "calibration", "ground_truth", "episodes"
"""Folders that the sequences of a drive share, and that of recorded drives."""
FILM = "preview.mp4"
"""Film of a sequence; one of its images has the same name and the ending ``.png``."""
SEG_BAG = "LIOseg_"
"""Beginning of the name of a bag of clouds without movers, as in the CARLA-Loc release."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """A format of sequences."""

    about: str
    """One line for people."""
    place: str
    """Its file or folder in that of the sequence; ``{}`` stands for the sequence's name."""
    is_bag: bool = False
    """Whether it is a ROS bag."""


FORMATS = {
    "rosbag1": Format(about="ROS 1 bag, not compressed", place="{}.bag", is_bag=True),
    "rosbag1_lz4": Format(about="ROS 1 bag, chunks by LZ4", place="{}_lz4.bag", is_bag=True),
    "rosbag1_bz2": Format(about="ROS 1 bag, chunks by bzip2: slow", place="{}_bz2.bag", is_bag=True),
    "rosbag2": Format(about="ROS 2 bag, MCAP with zstd chunks", place="{}_ros2", is_bag=True),
    "rosbag2_sqlite3": Format(about="ROS 2 bag, SQLite", place="{}_sqlite3", is_bag=True),
    "euroc": Format(about="EuRoC (ASL) folder mav0: grey images, IMU, true states", place="mav0"),
    "kitti": Format(about="KITTI odometry and SemanticKITTI, with labels of moving objects", place="kitti"),
    "dsec": Format(
        about="DSEC: events and identity maps of each event camera, disparity of a pair", place="dsec"
    ),
    "nuscenes": Format(
        about="nuScenes v1.0: samples with boxes and labels, sweeps, a mask of the map", place="nuscenes"
    ),
    "opv2v": Format(
        about="OPV2V: clouds, boxes and poses of each agent in CARLA's axes, for OpenCOOD", place="opv2v"
    ),
    "colmap": Format(
        about="COLMAP and nerfstudio: pictures, exact poses, seed points, masks, clean plates", place="colmap"
    ),
    "doppler_icp": Format(
        about="Doppler-ICP: points with rates of range, their LiDAR's place and poses", place="doppler_icp"
    ),
    "rinex": Format(
        about="raw GNSS: RINEX 3.04, NMEA, options for RTKLIB, truth of every signal", place="gnss"
    ),
    "raw": Format(about="PNG, PLY and npz, a folder or table a stream", place="raw"),
}
"""All formats by name."""


def check_formats(formats: tuple[str, ...]) -> None:
    """Refuse unknown formats.

    Raises:
        ConfigError: a format is unknown; the message names the nearest.
    """
    for name in formats:
        if name == "minari":
            raise ConfigError("Minari holds steps, actions and rewards, no samples; use `carlaloc minari`")
        if name not in FORMATS:
            raise ConfigError(unknown_name("format", name, FORMATS))


@dataclass(frozen=True, slots=True)
class SequenceFolder:
    """Paths of the files of a sequence."""

    path: Path
    """The folder, or a temporary folder beside it (``.NAME.part``)."""

    @property
    def name(self) -> str:
        """Weather and traffic level."""
        return self.path.name.removeprefix(".").removesuffix(".part")

    @property
    def part(self) -> SequenceFolder:
        """The folder while it is being written."""
        return SequenceFolder(part_path(self.path.with_name(self.name)))

    @property
    def drive(self) -> DriveFolder:
        """The folder of its drive."""
        return DriveFolder(self.path.parent)

    @property
    def description(self) -> Path:
        """``sequence.yaml``; where there is none, the sequence is not whole."""
        return self.path / SEQUENCE

    @property
    def checksums(self) -> Path:
        """``SHA256SUMS`` of the sequence."""
        return self.path / CHECKSUMS

    @property
    def film(self) -> Path:
        """Film of the sequence."""
        return self.path / FILM

    def place(self, format_name: str, *, begin: str = "") -> Path:
        """File or folder of a format.

        Args:
            format_name: One of `FORMATS`.
            begin: Beginning of a bag's name, such as `SEG_BAG`.
        """
        return path_below(self.path, begin + FORMATS[format_name].place.format(self.name))

    @property
    def bags(self) -> list[Path]:
        """Existing bags, those without movers last."""
        names = [name for name, form in FORMATS.items() if form.is_bag]
        places = [self.place(name, begin=begin) for begin in ("", SEG_BAG) for name in names]
        return [path for path in places if path.exists()]


@dataclass(frozen=True, slots=True)
class DriveFolder:
    """Paths of a drive's sequences and shared files."""

    path: Path
    """The folder; its name is that of the town."""

    @property
    def dataset(self) -> DatasetFolder:
        """The folder of its dataset."""
        return DatasetFolder(self.path.parent)

    @property
    def calibration(self) -> Path:
        """Folder of calibration files."""
        return self.path / CALIBRATION

    @property
    def ground_truth(self) -> Path:
        """Folder of true trajectories."""
        return self.path / GROUND_TRUTH

    @property
    def states(self) -> Path:
        """True states of the IMU, in EuRoC's columns."""
        return self.ground_truth / "state.csv"

    def truth(self, frame: str) -> Path:
        """True trajectory of a frame (TUM)."""
        return self.ground_truth / f"{frame}.tum"

    def sequence(self, name: str) -> SequenceFolder:
        """The folder of a sequence."""
        return SequenceFolder(path_below(self.path, name, link=True))


@dataclass(frozen=True, slots=True)
class DatasetFolder:
    """Paths of the drives and descriptions of a dataset."""

    path: Path
    """The folder."""

    @property
    def description(self) -> Path:
        """``dataset.yaml``."""
        return self.path / DATASET

    @property
    def checksums(self) -> Path:
        """``SHA256SUMS`` of all files."""
        return self.path / CHECKSUMS

    def drive(self, town: str) -> DriveFolder:
        """The folder of a drive."""
        return DriveFolder(path_below(self.path, town, link=True))

    def episode(self, town: str) -> Path:
        """The recorded drive of a town, where the dataset holds it."""
        return path_below(self.path / EPISODES, f"{town}.mcap")


def whole_path(path: Path) -> Path:
    """Absolute path; links stay, since a drive or a sequence may be one to another disk."""
    return Path(os.path.normpath(path.absolute()))


def files_below(folder: str | Path) -> list[Path]:
    """All files below a folder, by their paths; folders that are links are followed, each once."""
    files, places = list[Path](), set[Path]()
    for root, folders, names in os.walk(folder, followlinks=True):
        if (place := Path(root).resolve()) in places:
            folders.clear()
            continue
        places.add(place)
        files += [file for name in names if (file := Path(root, name)).is_file()]
    return sorted(files)


def is_sequence(path: Path) -> bool:
    """Whether a path is the folder of a finished sequence, or the description in it."""
    return path.name == SEQUENCE or (path / SEQUENCE).is_file()


def sequence_at(path: Path) -> SequenceFolder:
    """The sequence of a folder, or of the description in it."""
    return SequenceFolder(path.parent if path.name == SEQUENCE else path)


def sequences_below(root: str | Path) -> list[SequenceFolder]:
    """Finished sequences of all datasets below a folder, by their paths."""
    folders = [file.parent for file in files_below(root) if file.name == SEQUENCE]
    hidden = [any(part.startswith(".") for part in path.relative_to(root).parts) for path in folders]
    return [SequenceFolder(path) for path, skip in zip(folders, hidden, strict=True) if not skip]
