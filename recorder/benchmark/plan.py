"""Plan of a benchmark: sequences of a folder or of drives, and a job for each system and repetition."""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.faults.faults import Faults
from carlaloc_env.rigs.rig import SensorRig
from recorder.dataset.layout import SequenceFolder, sequences_below
from recorder.dataset.manifest import DatasetManifest, SequenceDescription
from recorder.dataset.sequence import RAW, SEGMENTED, SlamSequence
from recorder.slam.system import System
from recorder.streaming.drive import DriveConfig, DriveStream, describe_drives

STATIC = ("static", "empty")
"""Levels of traffic without movers."""
DRIVES = "drives"
"""Folder of the descriptions of drives, below the benchmark's folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkSequence:
    """A sequence and its condition."""

    path: Path
    """Its folder; of a drive that is read as it is made, it has all but the sensor data."""
    dataset: str
    """Folder of its dataset below the one that was searched; datasets of other noise seeds differ in it."""
    town: str
    """Town."""
    weather: str
    """Name of the weather, with the faults behind it where there are some."""
    traffic: str
    """Name of the traffic level."""
    digest: str
    """A text that is another one where its data are."""
    stream: DriveStream | None = None
    """What its sensor data are made of as they are read; None: they lie in the folder."""
    labelled: bool
    """Whether its clouds have labels."""
    lidar: str | None = None
    """The LiDAR that is asked for; None: the first one that its data have."""
    masked: bool
    """Whether images of two cameras have labels."""
    weather_matters_to_lidar: bool
    """Whether sweeps differ from weather to weather."""
    faults: str = ""
    """Faults of the sensors, in words."""
    findings: str = ""
    """What `recorder.dataset.sequence.faults_of` found in its data before a run."""

    @property
    def movers(self) -> float:
        """Largest share of movers of its streams, 0–1; of a drive, known when it has been read."""
        described = SequenceDescription.read(SequenceFolder(self.path))
        return max(described.movers.values(), default=0.0)

    @property
    def epoch_ns(self) -> int:
        """Stamp of the beginning of its drive, of which it may be a stretch [ns]."""
        return SequenceDescription.read(SequenceFolder(self.path)).epoch_ns

    @property
    def key(self) -> str:
        """Its place below the folder that was searched."""
        return Path(self.dataset, self.town, self.path.name).as_posix()

    @property
    def is_static(self) -> bool:
        """Whether nothing moves in it."""
        return self.traffic in STATIC


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One system over one sequence, once."""

    sequence: BenchmarkSequence
    """The sequence."""
    method: str
    """Name or file of the system."""
    system: System
    """The system."""
    cloud: str
    """`RAW` or `SEGMENTED` points."""
    run: int
    """Number of the repetition, from 1."""

    @property
    def title(self) -> str:
        """Name of the system, with its clouds where they are not raw."""
        return self.system.title + ("" if self.cloud == RAW else f" {self.cloud}")

    @property
    def folder(self) -> Path:
        """Where its results lie, below the benchmark's folder."""
        name = self.system.name + ("" if self.cloud == RAW else f"_{self.cloud}")
        name += f"_{self.sequence.lidar}" if self.sequence.lidar else ""
        return Path("runs", self.sequence.key, name, f"{self.run}")


def find_sequences(folder: Path, lidar: str | None = None) -> list[BenchmarkSequence]:
    """All finished sequences below a folder, by dataset, town, weather and traffic.

    Args:
        folder: The folder.
        lidar: Name of the LiDAR that is read; None: that of the rig's first.

    Raises:
        ConfigError: there is none that moves, or a description cannot be read.
        EvaluationError: a rig has no such LiDAR.
    """
    sequences = [one for one in sequences_below(folder) if not _is_fixed(one)]
    if not sequences:
        raise ConfigError(f"{folder} holds no sequence; give a folder that `carlaloc replay --out` wrote")
    return [_sequence(one.path, folder, lidar) for one in sequences]


def _is_fixed(sequence: SequenceFolder) -> bool:
    """Whether a unit by the road carries the sensors, so that there is no motion to find."""
    drive = sequence.drive
    return "roadside" in DatasetManifest.read(drive.dataset.path).drives.get(drive.path.name, {})


def _sequence(path: Path, root: Path, lidar: str | None) -> BenchmarkSequence:
    sequence = SlamSequence(path, lidar=lidar)
    described = sequence.description
    faults = Faults.from_mapping(described.faults).label
    return BenchmarkSequence(
        path=path,
        dataset=Path(os.path.relpath(path.parent.parent, root)).as_posix(),
        town=path.parent.name,
        weather=_with_faults(str(described.weather["name"]), faults),
        faults=faults,
        traffic=str(described.traffic["name"]),
        digest=hashlib.sha256(sequence.files.checksums.read_bytes()).hexdigest() + (lidar or ""),
        lidar=lidar,
        labelled=bool(sequence.rig.of_kind("lidar")) and sequence.has_labelled_scans,
        masked=sum(name.startswith("semantic_") for name in described.samples) >= 2,
        weather_matters_to_lidar=_weather_matters_to_lidar(sequence.rig),
    )


def sequences_of(drives: DriveConfig, out: Path) -> list[BenchmarkSequence]:
    """All conditions and seeds of some drives, each described below a folder.

    Raises:
        CarlaLocError: a drive cannot be read, or an option does not fit it.
    """
    return [sequence_of(stream, out / DRIVES) for stream in describe_drives(drives, out / DRIVES)]


def sequence_of(stream: DriveStream, root: Path) -> BenchmarkSequence:
    """A drive under one condition, described below a folder."""
    rig, path = stream.plan.rig, stream.folder.path
    return BenchmarkSequence(
        path=path,
        dataset=path.parent.parent.relative_to(root).as_posix(),
        town=path.parent.name,
        weather=_with_faults(stream.condition.weather_name, stream.condition.faults.label),
        faults=stream.condition.faults.label,
        traffic=stream.condition.traffic.name,
        digest=stream.digest,
        stream=stream,
        labelled=_labels(rig, "lidar") >= 1,
        masked=_labels(rig, "camera") >= 2,
        weather_matters_to_lidar=_weather_matters_to_lidar(rig),
    )


def _with_faults(weather: str, faults: str) -> str:
    return f"{weather} {faults}".rstrip()


def _labels(rig: SensorRig, kind: str) -> int:
    """Number of sensors of a kind that give semantic labels."""
    return sum("semantic" in getattr(sensor, "outputs", ()) for sensor in rig.of_kind(kind))


def _weather_matters_to_lidar(rig: SensorRig) -> bool:
    return any(bool(getattr(lidar, "weather", False)) for lidar in rig.of_kind("lidar"))


def plan_jobs(
    sequences: Sequence[BenchmarkSequence],
    systems: Sequence[tuple[str, System]],
    *,
    runs: int,
    clouds: Sequence[str],
) -> list[Job]:
    """Jobs of all systems over all sequences whose results can be new.

    Where the weather does not matter to the LiDAR, its sweeps are the same bytes in all weathers, so that
    systems without cameras run in the first of them. Clouds and images without movers are taken of dynamic
    sequences with labels, for systems that can be given them.

    Args:
        sequences: Where to run.
        systems: What to run: the word that names it, and the system.
        runs: Repetitions.
        clouds: Which of `RAW` and `SEGMENTED` systems are run on.
    """
    jobs = []
    seen: set[tuple[str, ...]] = set()
    for sequence in sequences:
        for word, system in systems:
            alike = (sequence.dataset, sequence.town, sequence.traffic, sequence.faults, word)
            if not system.is_visual and not sequence.weather_matters_to_lidar:
                if alike in seen:
                    continue
                seen.add(alike)
            for cloud in clouds:
                labelled = sequence.masked if system.is_visual else sequence.labelled
                if cloud == SEGMENTED and (sequence.is_static or not labelled or not system.takes_seg):
                    continue
                jobs += [
                    Job(sequence=sequence, method=word, system=system, cloud=cloud, run=run + 1)
                    for run in range(runs)
                ]
    return jobs
