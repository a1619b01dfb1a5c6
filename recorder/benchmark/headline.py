"""What a benchmark found, in one sentence computed from its scores: who loses most, where, and how much."""

import numpy as np
import pandas as pd

from recorder.benchmark.cells import CONDITION, cells, figure, losses_of
from recorder.benchmark.tables import titles_of
from recorder.dataset.sequence import RAW


def headline(runs: pd.DataFrame) -> tuple[str, dict[str, np.ndarray]]:
    """The largest loss by movers or weather; without two conditions, the errors under the hardest one.

    Args:
        runs: Runs as in ``results.csv``.

    Returns:
        The sentence with another one on its evidence; and by the words for each cell that it speaks of, which
        runs show it, booleans of shape (runs,).
    """
    if runs["failed"].notna().all():
        return f"Every run failed, {len(runs)} in all; the first: {runs['failed'].iloc[0]}.", {}
    cell, titles = cells(runs), titles_of(runs)
    losses = losses_of(cell)
    if losses.empty:
        at = now = cell.sort_values("median", na_position="first").iloc[-1]
        here = cell[(cell[CONDITION] == now[CONDITION]).all(axis=1)].sort_values("median")
        named = {f"{titles[one['method']]} {_error(one)}": one for _, one in here.iterrows()}
        begin, ratio, end = "Position errors: ", "", "No two conditions have results to compare."
    else:
        loss = losses.sort_values("clear", ascending=False, kind="stable").iloc[0]
        at, now = cell.loc[loss["row_base"]], cell.loc[loss["row"]]
        by = "traffic" if at["weather"] == now["weather"] else "weather"
        words = {name: f"in {name}" for name in cell["weather"]} | {"dynamic": "among movers"}
        named = {f"{_error(one)} {words.get(one[by], one[by])}": one for one in (at, now)}
        ratio = f" (×{loss['ratio']:.3g})" if np.isfinite(loss["ratio"]) else ""
        begin = "{} loses most: " if loss["clear"] else "No system loses clearly; {} is the closest: "
        begin, end = begin.format(titles[loss["method"]]), _evidence(loss)
    place = ", ".join(now[name] for name in CONDITION if now[name] == at[name] != RAW)
    shown = {name: _runs_of(runs, one) for name, one in named.items()}
    return f"{begin}{', '.join(named)}{ratio}; {place}. {end}", shown


def _error(cell: pd.Series) -> str:
    return "fails" if np.isnan(cell["median"]) else f"{figure(cell['median'])} m"


def _evidence(loss: pd.Series) -> str:
    """How sure a loss is."""
    if np.isinf(loss["growth"]):
        return f"Failed runs: {loss['failed']} of {loss['runs']}."
    if not loss["repeated"]:
        return "The spread of single runs is not known."
    return f"The ranges of runs {'overlap' if loss['within'] else 'do not overlap'}."


def _runs_of(runs: pd.DataFrame, cell: pd.Series) -> np.ndarray:
    """Which runs of a cell did not fail; which did, where the cell fails."""
    of_cell = (runs[[*CONDITION, "method"]] == cell[[*CONDITION, "method"]]).all(axis=1)
    return np.asarray(of_cell & (runs["failed"].isna() | np.isnan(cell["median"])))
