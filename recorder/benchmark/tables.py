"""Tables of runs in the paper's layout: Markdown, LaTeX, CSV and Parquet."""

from collections.abc import Sequence
from dataclasses import asdict, fields
from importlib.util import find_spec
from pathlib import Path

import pandas as pd

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write, write_whole
from recorder.benchmark.cells import CONDITION, best, cells, ratios, traffic_label
from recorder.benchmark.score import Score
from recorder.dataset.sequence import RAW

RULE = (
    "A run fails when it ends with an error or passes its time limit, when it has poses for less than 80 % "
    "of the frames or of the time, or when its APE is more than 0.1 m and half of that of an estimate that "
    "never moves. A cell fails when half of its runs do."
)
LETTERS = (
    "s: static, nothing moves. d: dynamic, among all traffic. e: empty, without parked cars, too. "
    "seg(d): d without the LiDAR's points on vehicles and walkers."
)
_FIGURES = {
    "ape_m": "APE [m], RMSE",
    "rpe_paper_m": "RPE as in the paper [m], RMSE",
    "attitude_deg": "attitude [deg], RMSE",
    "kitti_percent": "drift over KITTI's segments [%]",
}
"""Figures of a run that have a table, with their titles."""
Tables = Sequence[tuple[str, pd.DataFrame]]
"""Tables of words, with their titles."""
_TEX = {sign: f"\\{sign}" for sign in "&%$#_{}"} | {"\\": r"\textbackslash{}", "×": r"$\times$", "–": "--"}


def frame_of(scores: Sequence[Score]) -> pd.DataFrame:
    """A row for each run with all of its metrics."""
    columns = [field.name for field in fields(Score)]
    return pd.DataFrame([asdict(score) for score in scores], columns=columns)


def write_tables(runs: pd.DataFrame, tables: Tables, out: Path) -> list[Path]:
    """Write ``results.csv``, ``tables.md``, ``tables.tex``; with pyarrow ``results.parquet``, too.

    Args:
        runs: Runs.
        tables: Their tables, by `all_tables`.
        out: Folder that they are written to.

    Raises:
        EvaluationError: a file cannot be written.
    """
    texts = {"results.csv": csv_text(runs), "tables.md": markdown(tables), "tables.tex": latex(tables)}
    written = [out / name for name in texts]
    for path, text in zip(written, texts.values(), strict=True):
        write_whole(path, text, EvaluationError)
    if find_spec("pyarrow") is not None:
        written.append(out / "results.parquet")
        with atomic_write(written[-1], EvaluationError) as part:
            runs.to_parquet(part, index=False)
    return written


def csv_text(runs: pd.DataFrame) -> str:
    """A line for each run with all of its metrics."""
    text: str = runs.assign(failed=runs["failed"].fillna("")).to_csv(index=False, na_rep="nan")
    return text


def markdown(tables: Tables) -> str:
    """Tables as Markdown."""
    parts = ["# Benchmark", "", RULE, "", LETTERS, ""]
    for title, table in tables:
        parts += [f"## {title}", "", markdown_table(table), ""]
    return "\n".join(parts)


def markdown_table(table: pd.DataFrame) -> str:
    """A table of words as Markdown."""
    rows = [[word.replace("|", "\\|") for word in row] for row in [list(table), *table.to_numpy().tolist()]]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], f"|{' --- |' * len(table.columns)}", *lines[1:]])


def latex(tables: Tables) -> str:
    """Tables as LaTeX with booktabs."""
    parts = ["% \\usepackage{booktabs}", f"% {RULE}"]
    for title, table in tables:
        words = table.rename(columns=_tex).map(_tex)
        parts.append(words.to_latex(index=False, caption=_tex(title), column_format="l" * len(table.columns)))
    return "\n".join(parts)


def _tex(word: str) -> str:
    text = "".join(_TEX.get(sign, sign) for sign in word)
    return f"\\textbf{{{text.strip('*')}}}" if text.startswith("**") else text


def all_tables(runs: pd.DataFrame) -> Tables:
    """Titles and words: errors of visual and LiDAR systems as in Tables II and IV, ratios, and costs."""
    tables = []
    for visual in sorted(runs["visual"].unique(), reverse=True):
        part, name = runs[runs["visual"] == visual], "Visual" if visual else "LiDAR"
        for column, title in _FIGURES.items():
            tables.append((f"{name} systems: {title}", error_table(part, column, by_weather=visual)))
    tables.append(("Ratios of APE", ratio_table(runs)))
    tables.append(("Cost", cost_table(runs)))
    tables.append(("Why runs failed", failure_table(runs)))
    tables.append(("Findings about data and estimates", failure_table(runs, "findings")))
    return [(title, table.loc[:, (table != "").any()]) for title, table in tables if len(table)]


def titles_of(runs: pd.DataFrame) -> pd.Series:
    """Titles of methods, in their order."""
    return runs.drop_duplicates("method").set_index("method")["title"]


def error_table(runs: pd.DataFrame, column: str = "ape_m", *, by_weather: bool) -> pd.DataFrame:
    """A row for each town, weather and traffic level, a column for each system, the best in bold.

    Systems without any figure have no column, and conditions without any no row.

    Args:
        runs: Runs.
        column: The figure.
        by_weather: Whether the weather is a column although there is one alone.
    """
    cell = cells(runs, column)
    cell = cell[(cell["text"] != "–").groupby(cell["method"]).transform("any")]
    cell["text"] = cell["text"].where(~best(cell), "**" + cell["text"] + "**")
    rows = pd.MultiIndex.from_frame(cell[CONDITION].drop_duplicates())
    titles = titles_of(runs[runs["method"].isin(cell["method"])])
    words = cell.set_index([*CONDITION, "method"])["text"].unstack().reindex(rows)[titles.index].fillna("–")
    words.columns = titles
    table = words.reset_index()
    table["traffic"] = [traffic_label(*labels) for labels in table[["traffic", "cloud"]].to_numpy()]
    shown = by_weather or table["weather"].nunique() > 1
    return table.drop(columns=["cloud"] if shown else ["cloud", "weather"])


def ratio_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Ratios with their median, range, and pairs whose ranges overlap."""
    ratio = ratios(cells(runs))
    within = counted(ratio["within"], ratio["repeated"]).where(ratio["repeated"] > 0, "one run: not known")
    return pd.DataFrame(
        {
            "system": ratio["method"].map(titles_of(runs)),
            "compared": ratio["what"],
            "median": times(ratio["median"]),
            "range": times(ratio["low"]) + "–" + times(ratio["high"]),
            "pairs": ratio["pairs"].astype(str),
            "larger": counted(ratio["larger"], ratio["pairs"]),
            "within the spread of runs": within,
        }
    )


def condition_of(rows: pd.DataFrame, suffix: str = "") -> pd.Series:
    """Weather and traffic of rows in words, by columns with a suffix; clouds where they are not raw."""
    cloud = (" " + rows["cloud"]).where(rows["cloud"] != RAW, "")
    return rows[f"weather{suffix}"] + " " + rows[f"traffic{suffix}"] + cloud


def times(values: pd.Series) -> pd.Series:
    """Ratios as words; empty where there is none."""
    return _words(values, "×{:.2f}")


def counted(some: pd.Series, of_all: pd.Series) -> pd.Series:
    """Counts as words: how many of how many."""
    return some.astype(str) + " of " + of_all.astype(str)


def _words(values: pd.Series, form: str) -> pd.Series:
    return pd.Series(["" if pd.isna(value) else form.format(value) for value in values], values.index, object)


def cost_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Time, processor time and memory of each system, medians over the runs that ended and were measured."""
    every = runs.groupby("method", sort=False)
    ended = runs[(runs["version"] != "") & (runs["cores"] > 0)].groupby("method", sort=False)
    median = ended[["frame_median_s", "frame_p99_s", "real_time", "cpu_s", "peak_memory_mb"]].median()
    median = median.reindex(every["title"].first().index)
    return pd.DataFrame(
        {
            "system": every["title"].first(),
            "version": ended["version"].first().reindex(median.index).fillna(every["version"].first()),
            "ms a frame": _words(1e3 * median["frame_median_s"], "{:.1f}"),
            "99 %": _words(1e3 * median["frame_p99_s"], "{:.1f}"),
            "of real time": times(median["real_time"]),
            "CPU-s": _words(median["cpu_s"], "{:.1f}"),
            "peak MB": _words(median["peak_memory_mb"], "{:.0f}"),
            "cores": _words(ended["cores"].first().reindex(median.index), "{:.0f}"),
            "runs": every.size().astype(str),
            "failed": every["failed"].count().astype(str),
        }
    )


def failure_table(runs: pd.DataFrame, column: str = "failed") -> pd.DataFrame:
    """A row for each system and condition of which runs failed: how many, and why.

    Args:
        runs: Runs.
        column: Column of the reasons: ``failed`` or ``findings``.
    """
    runs = runs.assign(**{column: runs[column].where(runs[column] != "")})
    condition = condition_of(runs).rename("condition")
    groups = runs.groupby([runs["title"], runs["town"], condition], sort=False)[column]
    table = groups.agg(
        lost="count", runs="size", reason=lambda reasons: "; ".join(reasons.dropna().unique())
    ).reset_index()
    table = table[table["lost"] > 0].rename(columns={"title": "system"})
    table.insert(3, "failed" if column == "failed" else "runs", counted(table.pop("lost"), table.pop("runs")))
    return table
