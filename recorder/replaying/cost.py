"""Disk and time of a replay, estimated before it begins."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Events, Image, PointCloud
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.replaying.options import ReplayOptions, rig_of, without_unwritten
from recorder.writers.stream_sizes import element_bytes, large_streams, pixels_hz

SIZE_ERROR, TIME_FACTOR = 0.3, 2
"""Largest error of an estimated size, as a part of it, and the factor within which the time is right."""
OTHER_BYTES_S = 1e6
"""Size of a second of everything else in a format [bytes]."""
START_S, LEVEL_S, RAY_S, DRAW_S, SHADE_S, BYTE_S = 25.0, 0.3, 1e-6, 50e-9, 80e-9, 4e-9
"""CPU time of a process until it works, a second, a ray, a pixel, its light in a weather, a byte [s];
fitted to the totals of docs/performance.md and docs/formats.md."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayCost:
    """Disk and time that a replay takes, estimated by rig, topics, formats, conditions, length and cores."""

    written_bytes: float
    """Size of all sequences."""
    spooled_bytes: float
    """Size of the spools beside them, which are deleted in the end."""
    seconds: float
    """Time of a machine that has built the town before [s]."""
    processes: int
    """Processes that share the work."""

    def check(self, out: Path, *, kept_bytes: int = 0) -> None:
        """Refuse a replay that the disk cannot hold, even if the estimate is too large by all its error.

        Args:
            out: Folder of the dataset.
            kept_bytes: Size of what an earlier run has left there.

        Raises:
            WriterError: it does not fit.
        """
        needed = self.written_bytes + self.spooled_bytes
        free = shutil.disk_usage(existing_folder(out)).free
        if (1.0 - SIZE_ERROR) * needed > free + kept_bytes:
            raise WriterError(
                f"needs about {needed / 1e9:.1f} GB (±{SIZE_ERROR:.0%}), and {free / 1e9:.1f} GB are free in "
                f"{out}; make room, or choose a shorter stretch, fewer conditions, --topics slam or compact"
            )

    def __str__(self) -> str:
        time = f"{self.seconds / 60:.0f} min" if self.seconds > 90 else f"{self.seconds:.0f} s"
        return (
            f"about {self.written_bytes / 1e9:.2f} GB and at times {self.spooled_bytes / 1e9:.2f} GB more "
            f"(±{SIZE_ERROR:.0%}); about {time} with {self.processes} processes (a factor of {TIME_FACTOR})"
        )


def existing_folder(folder: Path) -> Path:
    """The folder, or the nearest above it that exists."""
    return next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())


def size_of(folder: Path) -> int:
    """Size of all files below a folder [bytes]."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def replay_cost(
    options: ReplayOptions, lengths_s: Sequence[tuple[float, float]], processes: int
) -> ReplayCost:
    """Disk and time that replays of some drives take.

    Args:
        options: Conditions, rig, topics and formats.
        lengths_s: Length of each drive's stretch and of its images [s].
        processes: Processes that share the work.
    """
    rig = without_unwritten(rig_of(options), options.formats, options.topics)
    levels, weathers = len(options.traffic), len(options.weathers)
    whole_s, images_s = (sum(lengths) for lengths in zip(*lengths_s, strict=True))
    longest = max(lengths_s)
    written = levels * weathers * whole_s * OTHER_BYTES_S * len(options.formats)
    spooled = 0.0
    streams = [stream for _, stream, _ in large_streams(rig)]
    for kind, stream, elements_hz in large_streams(rig):
        of_cloud = kind is PointCloud
        for name in options.formats:
            whole, packed = element_bytes(options.topics, name, kind, stream, streams)
            written += levels * weathers * (whole_s if of_cloud else images_s) * elements_hz * packed
            times = weathers if kind in (Image, Events) else 1
            spooled += times * longest[0 if of_cloud else 1] * elements_hz * whole
    radars: list[Any] = list(rig.of_kind("radar"))
    rays_hz = sum(s.rays * s.rate_hz for s in rig.sensors if isinstance(s, LidarConfig))
    rays_hz += sum(s.columns * s.rows * s.rate_hz for s in radars)
    all_pixels_hz = sum(pixels_hz(s) for s in rig.sensors if isinstance(s, CameraConfig))
    cpu_s = levels * (
        whole_s * (LEVEL_S + rays_hz * RAY_S) + images_s * all_pixels_hz * (DRAW_S + weathers * SHADE_S)
    )
    seconds = START_S + (cpu_s + written * BYTE_S) / max(1.0, 0.75 * processes)
    return ReplayCost(written_bytes=written, spooled_bytes=spooled, seconds=seconds, processes=processes)
