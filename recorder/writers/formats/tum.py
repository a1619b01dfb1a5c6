"""Trajectories in the TUM format: one line "time tx ty tz qx qy qz qw" per pose."""

from collections.abc import Mapping
from pathlib import Path

from numpy.typing import ArrayLike

from carlaloc_env.core.files.output_paths import path_below
from carlaloc_env.timeline.motion import Motion
from carlaloc_env.timeline.timeline import Timeline
from recorder.evaluation.trajectory_files import tum_text
from recorder.writers.base import DEFAULT_EPOCH_NS, write_text


def write_tum(path: str | Path, motion: Motion) -> Path:
    """Write the poses of a frame in the world.

    Args:
        path: New file.
        motion: Motion of the frame.

    Raises:
        WriterError: the file exists or cannot be written.
    """
    return write_text(path, tum_text(DEFAULT_EPOCH_NS + motion.stamp_ns, motion.position_m, motion.quat_xyzw))


def write_truth(
    folder: str | Path, timeline: Timeline, stamps_ns: ArrayLike, frames: Mapping[str, ArrayLike]
) -> list[Path]:
    """Write ``<frame>.tum`` for every frame on the car.

    Args:
        folder: Where the files go.
        timeline: The drive.
        stamps_ns: Times [ns], shape (M,).
        frames: Maps each frame's coordinates to `base_link`, shape (4, 4), by the frame's name.

    Raises:
        WriterError: a file exists or cannot be written.
    """
    motion = timeline.ego_motion(stamps_ns)
    return [
        write_tum(path_below(folder, f"{name}.tum"), motion.at_mount(T_base_frame))
        for name, T_base_frame in frames.items()
    ]
