"""Compare effects of movers and weather with those in the CARLA-Loc paper, and write the findings.

python docs/findings/findings.py --work DIR         drives, runs what is not done yet, then writes
python docs/findings/findings.py SCORES [SCORES …]  only writes, from folders that `carlaloc benchmark` wrote

A finding is the ratio of two conditions' errors, medians over runs, in every pair of a town. The paper's
systems have the errors of its Tables II and IV (APE [m], one run each), ours those of a benchmark. We claim a
direction if two thirds of the pairs or more show it, beyond the spread of runs, and two thirds have a known
spread. Finished steps are not repeated by the next start, so that it may be ended at any time.
"""

import argparse
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import pandas as pd
from paper_findings import NONE, PAIRS_MIN, answers_table, direction, doubt, kind_of
from ratio_picture import draw_ratios

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from recorder.benchmark.cells import CONDITION, cells, ratios
from recorder.benchmark.score import Score
from recorder.benchmark.tables import (
    counted,
    error_table,
    failure_table,
    frame_of,
    markdown_table,
    times,
    titles_of,
)
from recorder.slam.systems import SYSTEMS

HERE = Path(__file__).resolve().parent
PAGE, FIGURES, PICTURE = "findings.md", "findings/figures", "pictures/findings.png"
"""Below the folder of docs: the page of answers, the folder of all figures, and ratios of each town."""
LIDAR_METHODS = "kiss_icp,small_gicp,genz_icp,rko_lio"
CAMERA_METHODS = "stereo_vo"
"""ORB-SLAM3 needs a separate Python and a vocabulary: name it in --camera-methods."""
BEGIN, END = "<!-- figures: made by docs/findings/findings.py -->", "<!-- end of figures -->"
"""`write_findings` writes the part of the page between these lines, people the rest."""
_PATH = r"(?:/[\w.+-]+)+/([\w.+-]+)"


def read_results(files: Sequence[Path]) -> pd.DataFrame:
    """Runs of one or several benchmarks, from their ``results.csv``.

    Raises:
        EvaluationError: a file cannot be read, or is none.
    """
    scores = []
    for file in files:
        try:
            table = pd.read_csv(file, dtype={"version": str}, keep_default_na=False, na_values=["nan"])
            scores += [_score(row) for row in table.to_dict("records")]
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise EvaluationError(f"cannot read {file} ({error}); give a results.csv of benchmark") from error
    if not scores:
        raise EvaluationError("no runs; give folders that benchmark wrote")
    return frame_of(scores)


def _score(row: dict[Any, Any]) -> Score:
    known = {field.name: row[field.name] for field in fields(Score) if field.name in row}
    # Tables of before this column.
    known.setdefault("visual", row["method"] in SYSTEMS and SYSTEMS[row["method"]].is_visual)
    return Score(**known | {"failed": row["failed"] or None})


def paper_runs() -> pd.DataFrame:
    """The paper's tables as runs; weather of the LiDAR's is called ``-``, since it has none."""
    tables = [pd.read_csv(HERE / "paper" / name) for name in ("visual.csv", "lidar.csv")]
    runs = pd.concat([table.melt(CONDITION, var_name="method", value_name="word") for table in tables])
    runs = runs.merge(pd.read_csv(HERE / "paper" / "systems.csv"), on="method")
    ape_m = pd.to_numeric(runs["word"], errors="coerce")
    return runs.assign(
        ape_m=ape_m,
        failed=ape_m.isna().map({True: "fail", False: None}),
        visual=runs["kind"].str.startswith("stereo"),
    )


def verdict(ratio: Any) -> str:
    """Result of a row of `ratios`, in words."""
    said, why = direction(ratio), doubt(ratio)
    if not why or said == NONE or ratio.pairs < PAIRS_MIN:
        return why if ratio.pairs < PAIRS_MIN else said
    return why if why.startswith("rests") else f"{said}; {why}"


def findings_tables(runs: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """A table for each comparison: the paper's systems first, then ours, of the same kind together."""
    ours = runs.assign(kind=runs["method"].map(kind_of))
    tables = [_compared(paper_runs(), "paper"), _compared(ours, "here")]
    every = pd.concat(tables).sort_values(["kind", "from", "system"], ascending=[True, False, True])
    return [
        (what, every[every["compared"] == what].drop(columns="compared"))
        for what in sorted(set(tables[1]["compared"]), key=_order)
    ]


def _compared(runs: pd.DataFrame, source: str) -> pd.DataFrame:
    ratio = ratios(cells(runs))
    kinds = runs.drop_duplicates("method").set_index("method")["kind"]
    return pd.DataFrame(
        {
            "compared": ratio["what"],
            "kind": ratio["method"].map(kinds),
            "system": ratio["method"].map(titles_of(runs)),
            "from": source,
            "median": times(ratio["median"]),
            "range": times(ratio["low"]) + "–" + times(ratio["high"]),
            "larger": counted(ratio["larger"], ratio["pairs"]),
            "result": [verdict(row) for row in ratio.itertuples()],
        }
    )


def _order(what: str) -> tuple[int, str]:
    return (0 if what.startswith("dynamic") else 1 if what.startswith("seg") else 2), what


def figure_tables(runs: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """All figures by name of their file, without paths of the machine that found them."""
    # To lack labels or a bag is no failure of a system.
    runs = runs[~runs["failed"].fillna("").str.contains("; replay ", regex=False)]
    runs = runs.assign(failed=runs["failed"].str.replace(_PATH, r"\1", regex=True))
    tables: dict[str, pd.DataFrame] = {}
    if compared := findings_tables(runs):
        tables["ratios"] = pd.concat(dict(compared), names=["compared", None]).reset_index(level=0)
    for name, visual in (("errors_visual", True), ("errors_lidar", False)):
        ours = runs[runs["visual"] == visual]
        if len(ours):
            tables[name] = error_table(ours, by_weather=visual).replace(r"\*\*", "", regex=True)
    return tables | {"failures": failure_table(runs)}


def write_findings(runs: pd.DataFrame, docs: Path) -> None:
    """Put answers into their page in the place of older ones, write the figures, and draw the picture.

    Raises:
        EvaluationError: the page has no place for answers, or a file cannot be written.
    """
    page, figures = docs / PAGE, docs / FIGURES
    try:
        before, rest = page.read_text(encoding="utf-8").split(BEGIN)
        after = rest.split(END)[1]
        made = markdown_table(answers_table(runs))
        page.write_text(f"{before}{BEGIN}\n\n{made}\n{END}{after}", encoding="utf-8")
        figures.mkdir(exist_ok=True)
        for name, table in figure_tables(runs).items():
            table.to_csv(figures / f"{name}.csv", index=False, lineterminator="\n")
    except (OSError, ValueError, IndexError) as error:
        raise EvaluationError(f"{page} cannot be written or lacks the line {BEGIN} or {END}") from error
    draw_ratios(runs, docs / PICTURE)


def main() -> None:
    """Make what is missing and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scores", type=Path, nargs="*", help="folders of results")
    parser.add_argument("--work", type=Path, help="folder for drives and results")
    parser.add_argument("--duration", help="length of a drive that is read [s]; else the routes")
    parser.add_argument("--noise-seeds", default="3", help="seeds of sensor noise (3)")
    parser.add_argument("--workers", default="1", help="runs at a time, on cores of their own (1)")
    parser.add_argument("--lidar-methods", default=LIDAR_METHODS)
    parser.add_argument("--camera-methods", default=CAMERA_METHODS, help="'' for none")
    parser.add_argument("--docs", type=Path, default=HERE.parent, help="folder of the pages")
    arguments = parser.parse_args()
    folders = list(arguments.scores)
    if arguments.work is not None:
        folders += _scored(arguments)
    if not folders:
        parser.error("give folders of results, or --work")
    try:
        write_findings(read_results([folder / "results.csv" for folder in folders]), arguments.docs)
    except CarlaLocError as error:
        sys.exit(f"findings: {error}")
    print(arguments.docs / PAGE)


def _scored(arguments: argparse.Namespace) -> list[Path]:
    """Folders of results of LiDAR and of camera systems over the standard drives."""
    weathers = ["--weather", "ClearNoon,FoggyNoon,RainyNight"]
    found = []
    for rig, options, methods in (
        ("lidar", [], arguments.lidar_methods),
        ("flu", weathers, arguments.camera_methods),
    ):
        if methods:
            common = ["--traffic", "static,dynamic", "--noise-seeds", arguments.noise_seeds]
            length = ["--duration", arguments.duration] if arguments.duration else []
            runs = ["--methods", methods, "--workers", arguments.workers]
            found.append(arguments.work / rig)
            _carlaloc(
                "benchmark", "--standard", "--out", str(found[-1]), "--rig", rig,
                *options, *common, *length, *runs,
            )  # fmt: skip
    return found


def _carlaloc(*words: str) -> None:
    print("carlaloc", *words, flush=True)
    status = subprocess.run([sys.executable, "-m", "recorder.cli.main", *words], check=False).returncode
    if status:
        sys.exit(status)


if __name__ == "__main__":
    main()
