"""A recording of rerun or a page for browsers: of an episode, a sequence or a town, as a path holds it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import ConfigError, UsageError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX
from carlaloc_env.town.build import load_town
from recorder.dataset.layout import SEQUENCE, is_sequence, sequence_at
from recorder.dataset.sequence import SlamSequence
from recorder.dataset.trajectories import named_apart, read_trajectory
from recorder.episode.episode import Episode, open_episode
from recorder.episode.episode_town import town_of
from recorder.evaluation.associate import Association
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.path_errors import PathErrors
from recorder.evaluation.trajectory_files import read_tum
from recorder.view.episode_recording import record_episode
from recorder.view.scene_page import page_of_episode, page_of_sequence, page_of_town
from recorder.view.sequence_view import PERIOD_S, record_sequence
from recorder.view.town_recording import record_town


def write_view(
    source: Path,
    out: Path,
    *,
    map: Path | None = None,
    estimates: Sequence[Path] = (),
    frame: str = "lidar",
    period_s: float = PERIOD_S,
    drive: Path | None = None,
    overwrite: bool = False,
) -> str:
    """Write a recording of rerun (.rrd) or a page for browsers (.html).

    Args:
        source: Episode (.mcap), folder of a sequence, or town.
        out: The file.
        map: Map of an episode that was driven on a file.
        estimates: Estimated trajectories of a sequence.
        frame: Whose poses they are: `lidar`, `imu`, `camera` or `base_link`.
        period_s: Time between two clouds of a sequence [s].
        drive: Drive of a sequence (.mcap), whose movers its page shows.
        overwrite: Replace an older file.

    Returns:
        `episode`, `sequence` or `town`.

    Raises:
        ConfigError: the source is none of them.
        UsageError: there are estimates or a drive, but no sequence.
        OutputError: the file may not be written.
        MissingDependencyError: rerun is not installed.
    """
    is_page = out.suffix.lower() == ".html"
    if (estimates or drive) and not is_sequence(source):
        raise UsageError("--estimate and --drive are for sequences; give the folder of one")
    if source.suffix == EPISODE_SUFFIX or source.name.endswith(".recording"):
        episode = open_episode(source)
        write_episode = page_of_episode if is_page else record_episode
        write_episode(episode, town_of(episode, map), out, overwrite=overwrite)
        return "episode"
    if is_sequence(source):
        sequence = SlamSequence(sequence_at(source).path)
        errors = _errors(sequence, estimates, frame)
        shown: dict[str, Any] = {"estimates": errors, "period_s": period_s, "overwrite": overwrite}
        if drive is not None and Episode.load(drive).header.map_name != sequence.files.path.parent.name:
            raise ConfigError(
                f"{drive} is no drive in {sequence.files.path.parent.name}; give that of {source}"
            )
        if is_page:
            page_of_sequence(sequence, out, drive=None if drive is None else Episode.load(drive), **shown)
        else:
            record_sequence(sequence, out, **shown)
        return "sequence"
    if source.is_dir() and not (source / "town.xodr").is_file():
        raise ConfigError(f"{source} is no sequence and no town; give a folder that holds {SEQUENCE}")
    write_town = page_of_town if is_page else record_town
    write_town(load_town(source), out, overwrite=overwrite)
    return "town"


def _errors(sequence: SlamSequence, estimates: Sequence[Path], frame: str) -> list[PathErrors]:
    """Errors of estimates along the path."""
    if not estimates:
        return []
    truth = read_tum(sequence.truth_file(frame))
    trajectories = named_apart(estimates, [read_trajectory(path) for path in estimates])
    return [
        PathErrors.of(evaluate(truth, trajectory, association=Association.INTERPOLATED))
        for trajectory in trajectories
    ]
