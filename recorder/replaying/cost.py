"""Disk and time of a replay, estimated before it begins and again by its first unit."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import DepthImage, Events, FlowImage, NormalImage, Sample
from carlaloc_env.weather.schedule import weather_of
from recorder.dataset.layout import FORMATS
from recorder.replaying.machine_speed import slowness
from recorder.replaying.options import ReplayOptions, rig_of, without_unwritten
from recorder.writers.stream_sizes import Stretch, event_bytes, pixels_hz, sky_of, stream_sizes

SIZE_ERROR, TIME_FACTOR = 0.1, 1.5
"""Largest error of a size, as a part of it, and the factor within which the CPU time is right."""
SURE, COMPACT_ERROR = 0.05, 0.35
"""Largest error of what a bag holds as it is, and of the topics `compact`."""
STREAM_ERRORS: dict[type[Sample] | None, float]
STREAM_ERRORS = {DepthImage: 0.35, FlowImage: 0.35, NormalImage: 0.35, Events: 0.5}
"""Largest errors of streams whose size depends on the scene, until the first unit is weighed."""
FILM_PANEL_BYTES, FILM_PICTURE_BYTES, STILL_BYTES = 640 * 360 * 3.0, 2e4, 4.5e5
"""Size of a panel of the film in a spool, of a picture of the film, and of the picture beside it [bytes]."""
COMMAND_S, PROCESS_S, STAGE_S, CASTING_S, DRAWING_S = 4.0, 1.0, 1.5, 1.0, 5.0
"""CPU time on the reference machine of the command, of a process, of its sensors of a level, and more of
those with rays and with pictures [s]."""
LEVEL_S, RAY_S, RADAR_RAY_S = 0.2, 0.35e-6, 2e-6
DRAW_S, SHADE_S, EVENT_S, FILM_S = 1.1e-7, 7.5e-8, 2e-8, 0.006
"""The same of a second under a level, a LiDAR's ray, a radar's; of a pixel, its light in a weather, its
events, a panel of the film [s]; by the figures of docs/performance.md."""
EVENT_BYTE_S = 2e-8
BYTE_S = {
    "rosbag1": 7e-9, "rosbag1_lz4": 1.2e-8, "rosbag1_bz2": 2e-7, "rosbag2": 1.6e-8, "rosbag2_sqlite3": 9e-9,
    "euroc": 6e-8, "kitti": 5e-8, "dsec": 3e-8, "nuscenes": 4e-8, "opv2v": 4e-8, "colmap": 6e-8, "raw": 8e-8,
    "compact": 3e-7, "doppler_icp": 5e-8, "rinex": 5e-8,
}  # fmt: skip
"""The same of a byte of events, of a byte of a format, and of one of the topics `compact` in a bag [s]."""


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
    """CPU time of all processes on a machine that has built the town before [s]."""
    processes: int
    """Processes that share the work."""
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
            + f"{size} (±{self.size_error:.0%}); {time}, {_time(self.cpu_s)} of CPU time "
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
    sensors: list[list[Any]] = [list(rig.of_kind(kind)) for kind in ("camera", "lidar", "radar")]
    cameras, lidars, radars = sensors
    clouds_hz = sum(s.rate_hz for s in lidars[:1])
    rays_s = RAY_S * sum(s.rays * s.rate_hz for s in lidars)
    rays_s += RADAR_RAY_S * sum(s.columns * s.rows * s.rate_hz for s in radars)
    panels = sum(weathers if output == "rgb" else 1 for s in cameras[:1] for output in s.outputs[:3])
    stage_s = STAGE_S + CASTING_S * bool(rays_s) + DRAWING_S * bool(cameras)
    written = error = assembled_s = 0.0
    made_s, spools = stage_s * len(stretches) * max(processes, levels), []
    for stretch in stretches:
        spooled = 0.0
        for size in stream_sizes(rig, options.formats, options.topics, skies, stretch):
            spooled += size.spooled
            written += levels * size.written
            is_bag = FORMATS[size.format_name].is_bag
            is_compact = is_bag and options.topics.startswith("compact")
            largest = SURE if size.is_sure else STREAM_ERRORS.get(size.kind, SIZE_ERROR)
            error += levels * size.written * (COMPACT_ERROR if is_compact else largest)
            time_s = levels * size.written * BYTE_S["compact" if is_compact else size.format_name]
            made_s, assembled_s = made_s + time_s * (not is_bag), assembled_s + time_s * is_bag
        pictures = cameras[0].rate_hz * stretch.images_s if cameras else clouds_hz * stretch.whole_s
        if options.preview and cameras + lidars:
            written += levels * weathers * (STILL_BYTES + FILM_PICTURE_BYTES * pictures)
            spooled += FILM_PANEL_BYTES * (pictures * panels + clouds_hz * stretch.whole_s)
            shown = sum(len(s.outputs[:3]) for s in cameras[:1]) + len(lidars[:1])
            assembled_s += levels * weathers * pictures * FILM_S * shown
        spools.append(spooled)
        drawn_s = levels * (stretch.images_s + stretch.past_s)
        made_s += levels * stretch.whole_s * (LEVEL_S + rays_s)
        made_s += drawn_s * sum(map(pixels_hz, cameras)) * (DRAW_S + weathers * SHADE_S)
        event_pixels = drawn_s * sum(pixels_hz(s) for s in cameras if "events" in s.outputs)
        made_s += event_pixels * sum(
            EVENT_S + EVENT_BYTE_S * event_bytes(k, stretch.speed_mps) for k in skies
        )
    # Processes begin the next level before the last one is assembled.
    unit_share = options.unit_s / max(stretch.whole_s for stretch in stretches)
    return ReplayCost(
        written_bytes=written,
        spooled_bytes=max(spools) * min(levels, 1.0 + 2.0 * (processes - 1) * unit_share),
        size_error=max(SIZE_ERROR, error / max(written, 1.0)),
        cpu_s=slowness() * (COMMAND_S + processes * PROCESS_S + made_s + assembled_s),
        seen_s=levels * (sum(s.images_s for s in stretches) or sum(s.whole_s for s in stretches)),
        processes=processes,
    )
