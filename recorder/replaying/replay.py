"""Replay an episode through a sensor rig, under any weather and traffic, and write datasets.

The drive is cut into units that workers make in any order; sequences are assembled from them. All is written
into a working folder and gets its final names when all is whole.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from recorder.dataset.manifest import SequenceDescription
from recorder.replaying.cost import ReplayCost, size_of
from recorder.replaying.options import ReplayConfig, ReplayOptions, rig_of
from recorder.replaying.plan import ReplayPlan, plan_replay
from recorder.replaying.working_folder import FOLDER, WorkingFolder

__all__ = ["Progress", "ReplayConfig", "ReplayOptions", "ReplayResult", "replay", "rig_of"]

Progress = Callable[[float, float], None]
"""Called with seconds of sensor data done and seconds in all, over all traffic levels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayResult:
    """The written sequences."""

    out: Path
    """Folder of the dataset."""
    sequences: tuple[Path, ...]
    """Folder of each sequence."""
    ground_truth: Path
    """Folder of the true trajectories."""
    samples: dict[str, int]
    """Number of samples of each stream, over all sequences."""


def replay(
    config: ReplayConfig,
    progress: Progress | None = None,
    *,
    later_s: Sequence[float] = (),
    announce: Callable[[ReplayCost], object] | None = None,
) -> ReplayResult:
    """Replay an episode and write all its sequences.

    A replay that was killed, interrupted or ran out of disk resumes from its finished units, and ends with
    the same bytes.

    Args:
        config: Configuration of the replay.
        progress: Called about every second with the progress of all levels.
        later_s: Lengths of further drives that will be replayed like this one [s]; if they
            do not fit on the disk, too, the replay is refused.
        announce: Called with size and time of these replays before anything is made, and again as the first
            unit shows them; without it, the second is logged.

    Raises:
        ConfigError: an unknown rig, weather, format or level, or a stretch outside the drive.
        EpisodeError: the episode cannot be read, or its map has changed since or must be given.
        OutputError: `out` is no folder.
        WriterError: a sequence exists already or cannot be written; the disk is too small; another run is at
            work in the folder, or has left an unfinished dataset of another configuration there.
    """
    plan = plan_replay(config)
    with WorkingFolder(config.out, plan.town.name, plan.origin, plan.request) as work:
        if not work.is_done:
            begun = plan.check_room()
            cost = plan.cost(later_s)
            cost.check(config.out, kept_bytes=size_of(work.path))
            if announce is not None:
                announce(cost)
            # Imported after all checks: this imports the renderer and the writers.
            from recorder.replaying.run import ReplayRun

            on_progress = progress or (lambda done_s, total_s: None)
            ReplayRun(plan, work, on_progress, cost, announce).run(with_shared=not begun)
            work.publish()
    return _result(plan)


def finished_replay(config: ReplayConfig) -> ReplayResult | None:
    """The result of a replay whose sequences are all whole already; None: there is work left.

    Raises:
        CarlaLocError: as of `replay`.
    """
    plan = plan_replay(config)
    is_whole = all(folder.description.is_file() for folder in plan.sequences)
    return _result(plan) if is_whole and not (config.out / FOLDER).exists() else None


def _result(plan: ReplayPlan) -> ReplayResult:
    samples: Counter[str] = Counter()
    for folder in plan.sequences:
        samples.update(SequenceDescription.read(folder).samples)
    return ReplayResult(
        out=plan.config.out,
        sequences=tuple(folder.path for folder in plan.sequences),
        ground_truth=plan.drive.ground_truth,
        samples=dict(sorted(samples.items())),
    )
