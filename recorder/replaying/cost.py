"""Disk and time of a replay, estimated before it begins and again by its first unit."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import DepthImage, Events, FlowImage, Image, NormalImage, PointCloud, Sample
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.weather.schedule import weather_of
from recorder.dataset.layout import FORMATS
from recorder.replaying.machine_speed import slowness
from recorder.replaying.options import ReplayOptions, rig_of, without_unwritten
from recorder.writers.stream_sizes import (
    EVENT_BYTES,
    EVENT_BYTES_PER_MPS,
    element_bytes,
    large_streams,
    other_bytes_s,
    pixels_hz,
    sky_of,
)

SIZE_ERROR, TIME_FACTOR = 0.1, 1.5
"""Largest error of a size, as a part of it, and the factor within which the processor time is right."""
STREAM_ERRORS: dict[type[Sample], float] = {DepthImage: 0.25, FlowImage: 0.3, NormalImage: 0.3, Events: 0.5}
"""Largest errors of streams whose size depends on the scene, until the first unit is weighed."""
FILM_PANEL_BYTES, FILM_PICTURE_BYTES, STILL_BYTES = 640 * 360 * 3.0, 2e4, 4.5e5
"""Size of a panel of the film in a spool, of a picture of the film, and of the picture beside it [bytes]."""
COMMAND_S, PROCESS_S, STAGE_S, CASTING_S, DRAWING_S = 6.0, 3.0, 3.0, 3.0, 8.0
LEVEL_S, RAY_S, DRAW_S, SHADE_S, EVENT_S, BYTE_S = 0.3, 1e-6, 50e-9, 80e-9, 80e-9, 4e-9
"""CPU time on the reference machine [s]: of the command; of a process; of its sensors of a level, of
those with rays and pictures more; of a second, a ray, a pixel, its light in a weather, its events, a byte."""


class Stretch(NamedTuple):
    """What of a drive is replayed."""

    whole_s: float
    """Length of all sensors' stretch [s]."""
    images_s: float
    """Length of the pictures [s]."""
    past_s: float = 0.0
    """Length of the images that cameras must see before [s]."""
    speed_mps: float = 5.0
    """Mean speed during the pictures [m/s]."""
    actors: float = 150.0
    """Number of the traffic's actors, the mean of all levels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayCost:
    """Disk and time that a replay takes, estimated by rig, topics, formats, conditions, length and cores."""

    written_bytes: float
    """Size of all sequences."""
    spooled_bytes: float
    """Size of the spools beside them, which are deleted in the end."""
    size_error: float = SIZE_ERROR
    """Largest error of the sizes, as a part of them."""
    cpu_s: float
    """Processor time of all processes on a machine that has built the town before [s]."""
    processes: int
    """Processes that share the work."""
    made_cpu_s: float
    """Part of it in which sensors are built and samples made [s]."""
    seen_s: float
    """Length of all pictures, or of all sensors' stretches where there are none, over all levels [s]."""
    weighed_s: float = 0.0
    """Length of the stretch that was made and weighed [s]; 0: nothing is made yet."""

    @property
    def seconds(self) -> float:
        """Time until all is written [s]."""
        return COMMAND_S + (self.cpu_s - COMMAND_S) / max(1.0, 0.9 * self.processes)

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
        if (1.0 - self.size_error) * needed > free + kept_bytes:
            raise WriterError(
                f"needs about {needed / 1e9:.1f} GB (±{self.size_error:.0%}), and {free / 1e9:.1f} GB are "
                f"free in {out}; make room, or choose a shorter stretch, fewer conditions or --topics compact"
            )

    def __str__(self) -> str:
        size = f"about {self.written_bytes / 1e9:.2f} GB and at times {self.spooled_bytes / 1e9:.2f} GB more"
        time = f"about {_time(self.seconds)} with {self.processes} processes"
        return (
            (f"by its first {self.weighed_s:.3g} s: " if self.weighed_s else "")
            + f"{size} (±{self.size_error:.0%}); {time}, {_time(self.cpu_s)} of processor time "
            + f"(a factor of {TIME_FACTOR})"
        )


def _time(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds > 90 else f"{seconds:.0f} s"


def existing_folder(folder: Path) -> Path:
    """The folder, or the nearest above it that exists."""
    return next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())


def size_of(folder: Path) -> int:
    """Size of all files below a folder [bytes]."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def replay_cost(options: ReplayOptions, stretches: Sequence[Stretch], processes: int) -> ReplayCost:
    """Disk and time that replays of some drives take.

    Args:
        options: Conditions, rig, topics and formats.
        stretches: What is replayed of each drive.
        processes: Processes that share the work.
    """
    rig = without_unwritten(rig_of(options), options.formats, options.topics)
    skies = [sky_of(weather_of(name)) for name in options.weathers]
    levels, weathers = len(options.traffic), len(skies)
    streams = [stream for _, stream, _ in large_streams(rig)]
    radars: list[Any] = list(rig.of_kind("radar"))
    radars_hz = sum(s.rate_hz for s in radars)
    lidars = [s for s in rig.sensors if isinstance(s, LidarConfig)]
    clouds_hz = lidars[0].rate_hz if lidars else 0.0
    rays_hz = sum(s.rays * s.rate_hz for s in lidars)
    rays_hz += sum(s.columns * s.rows * s.rate_hz for s in radars)
    cameras = [s for s in rig.sensors if isinstance(s, CameraConfig)]
    all_pixels_hz = sum(pixels_hz(s) for s in cameras)
    event_pixels_hz = sum(pixels_hz(s) for s in cameras if "events" in s.outputs)
    written = error = cpu_s = 0.0
    spools = []
    for stretch in stretches:
        spooled = 0.0
        for kind, stream, elements_hz in large_streams(rig):
            length_s = stretch.whole_s if kind is PointCloud else stretch.images_s
            for name in options.formats:
                for number, sky in enumerate(skies):
                    whole, packed = element_bytes(options.topics, name, kind, stream, streams, sky)
                    count = length_s * elements_hz
                    if kind is Events:
                        count *= EVENT_BYTES[sky] + EVENT_BYTES_PER_MPS[sky] * stretch.speed_mps
                    written += levels * count * packed
                    # What an uncompressed bag takes of a picture is no guess.
                    is_sure = kind is not Events and FORMATS[name].is_bag and packed == whole
                    error += (
                        levels * count * packed * (0.05 if is_sure else STREAM_ERRORS.get(kind, SIZE_ERROR))
                    )
                    spooled += count * whole * (number == 0 or kind in (Image, Events))
        for name in options.formats:
            other = stretch.whole_s * other_bytes_s(options.topics, name, radars_hz, stretch.actors)
            written += levels * weathers * other
            error += levels * weathers * other * SIZE_ERROR
            spooled += other
        if options.preview and streams:
            pictures = cameras[0].rate_hz * stretch.images_s if cameras else clouds_hz * stretch.whole_s
            written += levels * weathers * (STILL_BYTES + FILM_PICTURE_BYTES * pictures)
            panels = [weathers if output == "rgb" else 1 for s in cameras[:1] for output in s.outputs[:3]]
            spooled += FILM_PANEL_BYTES * pictures * sum(panels)
            spooled += FILM_PANEL_BYTES * clouds_hz * stretch.whole_s
        drawn_s = stretch.images_s + stretch.past_s
        cpu_s += levels * (
            stretch.whole_s * (LEVEL_S + rays_hz * RAY_S)
            + drawn_s * all_pixels_hz * (DRAW_S + weathers * SHADE_S)
            + drawn_s * event_pixels_hz * weathers * EVENT_S
        )
        spools.append(spooled)
    longest_s = max(stretch.whole_s for stretch in stretches)
    stages = len(stretches) * max(processes, levels)
    cpu_s += stages * (STAGE_S + (CASTING_S if rays_hz else 0.0) + (DRAWING_S if cameras else 0.0))
    return ReplayCost(
        written_bytes=written,
        spooled_bytes=max(spools) * min(levels, 1.0 + (processes - 1) * options.unit_s / longest_s),
        size_error=max(SIZE_ERROR, error / max(written, 1.0)),
        cpu_s=slowness() * (COMMAND_S + processes * PROCESS_S + cpu_s + written * BYTE_S),
        made_cpu_s=slowness() * cpu_s,
        seen_s=levels * (sum(s.images_s for s in stretches) or sum(s.whole_s for s in stretches)),
        processes=processes,
    )
