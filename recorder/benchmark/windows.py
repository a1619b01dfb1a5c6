"""Finds the stretch of a drive in which movers or weather hurt each system most, by errors within windows."""

import numpy as np
import pandas as pd

from carlaloc_env.core.array_types import Array
from recorder.benchmark.cells import CONDITION, cells, figure, losses_of
from recorder.benchmark.run import BenchmarkResult
from recorder.benchmark.tables import Tables, condition_of, frame_of, times
from recorder.evaluation.path_errors import PathErrors

PERIOD_NS, STEP = 100_000_000, 5
"""Time between samples of a window [ns], and samples between the beginnings of windows."""
_PAIR = ["title", "drive", *CONDITION, "weather_base", "traffic_base"]
_FIGURES = ["start_s", "length_s", "error_m", "error_base_m", "ratio"]
"""Columns of windows: the pair of conditions, and its figures."""


def hurt_windows(result: BenchmarkResult, length_s: float) -> pd.DataFrame:
    """The window of each pair of conditions in which the error grows most, the largest growth first.

    Pairs and growth are those of `losses_of`, within a drive. Errors are medians over runs, diverged ones
    too, and noise seeds. Windows without a clear growth are left out.

    Args:
        result: Result of the benchmark.
        length_s: Length of windows [s].

    Returns:
        A row a pair: ``title``, ``drive`` (folder of its datasets), ``town``, ``weather``, ``traffic``,
        ``cloud``, those of the other condition, ``…_base``, the second of the drive at which the window
        begins, ``start_s``, its length, ``length_s``, errors as in `window_errors`, ``error_m`` and
        ``error_base_m``, and their ``ratio``.

    Raises:
        EvaluationError: errors of a run are gone.
    """
    errors, runs = dict(result.errors()), frame_of(result.scores).assign(failed=None)
    found = [window_errors(errors[job], job.sequence.epoch_ns, length_s) for job in errors]
    runs = runs[[job in errors for job in result.jobs]]
    # Datasets of one drive differ in the noise seed alone.
    runs["drive"] = runs["dataset"].str.replace(r"(^|/)seed\d+$", "", regex=True)
    runs["start_s"], runs["error_m"] = ([part[k] for part in found] for k in (0, 1))
    windows = runs.explode(["start_s", "error_m"]).astype({"start_s": float, "error_m": float})
    by = ["title", "drive", "start_s"]
    losses = losses_of(cells(windows, "error_m", by), by).assign(length_s=length_s)
    losses = losses.rename(columns={"median": "error_m", "median_base": "error_base_m"})
    return losses[losses["clear"]].drop_duplicates(_PAIR, ignore_index=True)[[*_PAIR, *_FIGURES]]


def window_tables(windows: pd.DataFrame) -> Tables:
    """The table of `hurt_windows` with its title; none where there are no windows."""
    if windows.empty:
        return []
    table = {
        "system": windows["title"],
        "drive": (windows["town"] + " " + windows["drive"].str.strip(".")).str.strip(),
        "condition": condition_of(windows),
        "start [s]": windows["start_s"].map("{:g}".format),
        "error [m]": windows["error_m"].map(figure),
        "compared with": condition_of(windows, "_base"),
        "its error [m]": windows["error_base_m"].map(figure),
        "ratio": times(windows["ratio"]),
    }
    title = "Windows of {:g} s in which movers or weather hurt most, each fitted alone"
    return [(title.format(windows["length_s"].iloc[0]), pd.DataFrame(table))]


def window_errors(errors: PathErrors, epoch_ns: int, length_s: float) -> tuple[Array, Array]:
    """Position errors of an estimate within windows, each after an SE(3) fit of the window alone.

    Errors after a fit of the whole path are not local: a jump changes them everywhere. Both paths are
    interpolated at equal times. The fit is that of `recorder.evaluation.align.umeyama`, of all windows at
    once.

    Args:
        errors: The estimate and the truth.
        epoch_ns: Stamp of the beginning of the drive [ns].
        length_s: Length of windows [s].

    Returns:
        Beginnings [s of the drive] and errors, RMSE [m], shape (W,).
    """
    time_ns = errors.stamp_ns - epoch_ns
    sample = np.arange(-(-time_ns[0] // PERIOD_NS), time_ns[-1] // PERIOD_NS + 1)
    count = round(length_s * 1e9 / PERIOD_NS) + 1
    first = int(-sample[0] % STEP)
    if len(sample) < first + count:
        return np.zeros(0), np.zeros(0)

    ways = (errors.estimate_m, errors.truth_m)
    both = np.array([[np.interp(sample * PERIOD_NS, time_ns, axis) for axis in way_m.T] for way_m in ways])
    windows = np.lib.stride_tricks.sliding_window_view(both, count, axis=2)[:, :, first::STEP].swapaxes(1, 2)
    x, y = windows - windows.mean(axis=3, keepdims=True)
    U, _, Vt = np.linalg.svd(y @ x.swapaxes(1, 2))
    U[..., 2] *= np.linalg.det(U @ Vt)[:, None]
    rmse_m = np.sqrt(np.mean(np.sum((y - U @ Vt @ x) ** 2, axis=1), axis=1))
    return sample[first::STEP][: len(x)] * (PERIOD_NS / 1e9), rmse_m
