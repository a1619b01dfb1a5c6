"""Compare effects on SLAM systems here with those on roads, by the bands of `plan.csv`.

python docs/findings/effects/effects.py PASS=FOLDER[,FOLDER] …   from folders that `carlaloc benchmark` wrote
python docs/findings/effects/effects.py                          prints the table of the runs kept here

A pass is a rig over some drives: `hdl64e`, `aeries2`, `snow`, `rain`, `cameras`. `runs.csv` keeps each run's
drift: KITTI's mean over segments of 100 to 400 m, which all routes here hold. An effect is the median over
towns and systems of a ratio within the same town. A run that fails is infinitely wrong.
"""

import csv
import json
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from recorder import evaluate, read_tum
from recorder.evaluation.associate import Association

HERE = Path(__file__).resolve().parent
SEGMENTS_M = (100.0, 400.0)
"""Shortest and longest segments [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A system over a drive."""

    of: str
    """Name of the pass."""
    town: str
    weather: str
    traffic: str
    cloud: str
    method: str
    drift_percent: float
    """Drift over segments of 100 to 400 m [%]; inf: the run failed."""
    ape_m: float
    """APE [m]; inf: the run failed."""


def runs_of(name: str, folder: Path) -> Iterator[Run]:
    """The runs of a pass."""
    for path in sorted((folder / "runs").rglob("result.json")):
        score = json.loads(path.read_text("utf-8"))["score"]
        where = folder / "drives" / score["dataset"] / score["town"] / "ground_truth"
        failed = score["failed"] is not None
        yield Run(
            of=name,
            **{key: score[key] for key in ("town", "weather", "traffic", "cloud", "method")},
            drift_percent=math.inf if failed else drift_percent(path.with_name("estimate.tum"), where, score),
            ape_m=math.inf if failed else score["ape_m"],
        )


def drift_percent(estimate: Path, where: Path, score: dict[str, str]) -> float:
    """Drift of an estimate over the segments that are compared [%]; NaN: the route holds none."""
    truth = read_tum(where / f"{score['frame']}.tum")
    result = evaluate(truth, read_tum(estimate), association=Association.INTERPOLATED)
    low_m, high_m = SEGMENTS_M
    rows = [segment for segment in result.segments if low_m <= segment.length_m <= high_m]
    count = sum(row.segments for row in rows)
    return sum(row.translation_percent * row.segments for row in rows) / count if count else math.nan


Chosen = Callable[[Run], bool]


def ratios(runs: list[Run], measure: str, first: Chosen, second: Chosen, *, by_method: bool) -> list[float]:
    """Second over first within each town, and each system where the ratio is not between systems."""
    found = []
    for key in sorted({(run.town, run.method if by_method else "") for run in runs}):
        alike = [run for run in runs if (run.town, run.method if by_method else "") == key]
        values = [[getattr(run, measure) for run in alike if chosen(run)] for chosen in (first, second)]
        if all(values) and not any(math.isnan(v) for v in values[0] + values[1]):
            found.append(median(values[1]) / median(values[0]))
    return found


def between(method: str, other: str) -> tuple[Chosen, Chosen, bool]:
    """Another system in place of one."""
    return (lambda run: run.method == method), (lambda run: run.method == other), False


def weather(other: str) -> tuple[Chosen, Chosen, bool]:
    """Another weather in place of clear air."""
    return (lambda run: run.weather == "ClearNoon"), (lambda run: run.weather == other), True


THREE = {"Town03", "Town04", "Town05"}
EFFECTS: dict[str, tuple[str, str, set[str], tuple[Chosen, Chosen, bool]]] = {
    "1": (
        "hdl64e",
        "drift_percent",
        {"Town03", "Town04", "Town05"},
        between("kiss_icp", "kiss_not_deskewed"),
    ),
    "4": ("hdl64e", "drift_percent", {"Town04"}, between("kiss_icp", "kiss_40m")),
    "7": ("hdl64e", "drift_percent", THREE, between("kiss_icp", "kiss_quarter")),
    "7b": ("hdl64e", "drift_percent", THREE, between("kiss_icp", "kiss_half")),
    "10": ("hdl64e", "drift_percent", THREE, between("kiss_icp", "kiss_fixed")),
    "5": ("aeries2", "drift_percent", {"Town04"}, between("kiss_40m", "kiss_40m_doppler")),
    "15s": ("snow", "drift_percent", {"Town03", "Town07"}, weather("SnowyNoon")),
    "15r": ("rain", "drift_percent", {"Town10"}, weather("ClearNoon:rain_mmph=25")),
    "15n": ("rain", "drift_percent", {"Town10"}, weather("ClearNight")),
}
"""Of each effect: pass, measure, towns, and both sides of the ratio."""


def motorway(runs: list[Run]) -> list[float]:
    """Town04 over the median of the other towns, for each system that is no variant."""
    found = []
    for method in ("kiss_icp", "small_gicp", "rko_lio"):
        mine = {run.town: run.drift_percent for run in runs if run.of == "hdl64e" and run.method == method}
        streets = [value for town, value in mine.items() if town != "Town04"]
        if streets and "Town04" in mine:
            found.append(mine["Town04"] / median(streets))
    return found


def main(passes: list[str]) -> None:
    """Keep new passes, and print a row of Markdown for each effect that was run."""
    kept = HERE / "runs.csv"
    runs: list[Run] = []
    if kept.exists():
        for row in csv.DictReader(kept.open(encoding="utf-8")):
            drift, ape_m = float(row.pop("drift_percent")), float(row.pop("ape_m"))
            runs.append(Run(**row, drift_percent=drift, ape_m=ape_m))
    for word in passes:
        name, _, folder = word.partition("=")
        runs = [run for run in runs if run.of != name]
        runs += [run for part in folder.split(",") for run in runs_of(name, Path(part))]
    if passes:
        with kept.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(Run.__slots__)
            for run in runs:
                values = (getattr(run, key) for key in Run.__slots__)
                writer.writerow([f"{v:.5g}" if isinstance(v, float) else v for v in values])
    for row in csv.DictReader((HERE / "plan.csv").open(encoding="utf-8")):
        if row["effect"] == "6":
            found = motorway(runs)
        elif row["effect"] in EFFECTS:
            of, measure, towns, (first, second, by_method) = EFFECTS[row["effect"]]
            mine = [run for run in runs if run.of == of and run.town in towns]
            found = ratios(mine, measure, first, second, by_method=by_method)
        else:
            continue
        if found:
            here, high = median(found), math.inf if row["high"] == "lost" else float(row["high"])
            verdict = "inside" if float(row["low"]) <= here <= high else "outside"
            each = ", ".join(f"{value:.2f}" for value in found)
            band = f"{row['low']} to {row['high']}"
            sys.stdout.write(
                f"| {row['effect']} | {row['question']} | {band} | {here:.2f} | {each} | {verdict} |\n"
            )


if __name__ == "__main__":
    main(sys.argv[1:])
