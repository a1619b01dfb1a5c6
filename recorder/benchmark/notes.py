"""Notes on sequences before systems run: which of several sensors they read, and a start in motion."""

from collections.abc import Iterator, Sequence

import numpy as np

from recorder.benchmark.plan import BenchmarkSequence
from recorder.dataset.manifest import DatasetManifest
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.trajectory_files import read_tum
from recorder.replaying.options import rig_of
from recorder.replaying.start_at_rest import motion_at_start, motion_at_start_of
from recorder.slam.system import System

_READ = {"lidar": ("lidar", 1), "imu": ("imu", 1), "stereo": ("camera", 2)}
"""Kind of sensor, and how many of them a system reads, by what it needs."""


def notes_on(sequences: Sequence[BenchmarkSequence], systems: Sequence[System]) -> list[str]:
    """Lines on sequences, each once."""
    needs = sorted({need for system in systems for need in system.needs})
    return list(dict.fromkeys(line for one in sequences for line in _notes(one, needs)))


def _notes(one: BenchmarkSequence, needs: Sequence[str]) -> Iterator[str]:
    sequence = SlamSequence(one.path, lidar=one.lidar)
    rig = sequence.rig if one.stream is None else rig_of(one.stream.plan.config)
    for kind, count in (_READ[need] for need in needs if need in _READ):
        names = [sensor.name for sensor in rig.of_kind(kind)]
        if len(names) > count:
            read, others = ", ".join(names[:count]), ", ".join(names[count:])
            yield f"rig {rig.name}: systems read {kind} {read}, the first, not {others}"
    if note := _start(one, sequence):
        yield f"{one.town} {note}"


def _start(one: BenchmarkSequence, sequence: SlamSequence) -> str:
    if one.stream is not None:
        plan = one.stream.plan
        return motion_at_start_of(plan.timeline, plan.config.start_s)
    drive = sequence.files.drive
    truth = read_tum(drive.truth("base_link"))
    begin_s = float(DatasetManifest.read(drive.dataset.path).drives[one.town].get("stretch_s", (0.0,))[0])
    at_s = begin_s + (truth.stamp_ns - truth.stamp_ns[0]) / 1e9
    speed_mps = np.linalg.norm(np.gradient(truth.position_m, at_s, axis=0), axis=1)
    return motion_at_start(at_s, speed_mps, begin_s)
