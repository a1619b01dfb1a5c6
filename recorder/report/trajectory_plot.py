"""Draws trajectories from above, and their position errors over time."""

from collections.abc import Sequence
from pathlib import Path

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.output_paths import check_output_file
from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.metrics import Metric
from recorder.report.canvas import COLOURS, new_figure, save_figure


def plot_trajectories(
    results: Sequence[EvaluationResult], path: str | Path, *, title: str = "", overwrite: bool = False
) -> Path:
    """Draw estimates over their truth from above, and the position error over time, as a PNG.

    Args:
        results: Results of one drive, each with the position error (`Metric.APE_TRANSLATION`).
        path: New image (.png).
        title: Line above the image.
        overwrite: Whether an older one is replaced.

    Raises:
        OutputError: the image exists, or its name is not that of an image.
        EvaluationError: there is nothing to draw, or the image cannot be written.
        MissingDependencyError: matplotlib is not installed.
    """
    check_output_file(path, suffixes=(".png",), overwrite=overwrite)
    if not results or any(Metric.APE_TRANSLATION not in result.values for result in results):
        raise EvaluationError("no position errors to draw; evaluate with Metric.APE_TRANSLATION")
    figure = new_figure(13.0, 6.0)
    above, over_time = figure.subplots(1, 2)
    longest = max(results, key=lambda result: result.matched).truth
    start_ns = min(int(result.truth.stamp_ns[0]) for result in results)
    above.plot(longest.position_m[:, 0], longest.position_m[:, 1], color="black", lw=2.5, label="truth")
    above.plot(*longest.position_m[0, :2], "o", color="black", ms=7)
    for k, result in enumerate(results):
        colour = COLOURS[k % len(COLOURS)]
        statistics = result.statistics[Metric.APE_TRANSLATION]
        xy = result.estimate.position_m
        label = f"{result.estimate.name}: RMSE {statistics.rmse:.3f} m, {result.coverage:.0%} of poses"
        above.plot(xy[:, 0], xy[:, 1], color=colour, lw=1.3, label=label)
        seconds = (result.truth.stamp_ns - start_ns) * 1e-9
        over_time.plot(seconds, result.values[Metric.APE_TRANSLATION], color=colour, lw=1.2)
    fits = ", ".join(dict.fromkeys(result.alignment.value for result in results))
    above.set(xlabel="east [m]", ylabel="north [m]", title=title or "Trajectories")
    above.set_aspect("equal", adjustable="datalim")
    above.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), frameon=False, fontsize=9)
    over_time.set(
        xlabel="time [s]", ylabel="|p_est − p_truth| [m]", title=f"Position error after alignment: {fits}"
    )
    over_time.set_ylim(bottom=0)
    for axes in (above, over_time):
        axes.grid(alpha=0.3)
    return save_figure(figure, Path(path))
