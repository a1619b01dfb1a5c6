"""Compare effects on SLAM systems here with those on roads, by the bands of `plan.csv`.

python docs/findings/effects/effects.py PASS=FOLDER[,FOLDER] …   from folders that `carlaloc benchmark` wrote
python docs/findings/effects/effects.py                          prints the table of the runs kept here

A pass is a rig over some drives: `hdl64e`, `aeries2`, `snow`, `snow64`, `rain`, `air`, `cameras`, `real`,
`flu`, `flu640`. `runs.csv` keeps each run's drift in space and in the plane: KITTI's mean over segments of
100 to 400 m, which all routes here hold. An effect is the median over towns and systems of a ratio within the
same town. A failed run is infinitely wrong.
"""

import csv
import json
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from recorder import Trajectory, read_tum
from recorder.dataset.sequence import SlamSequence

HERE = Path(__file__).resolve().parent
SEGMENTS_M, FIRST_EVERY = (100.0, 200.0, 300.0, 400.0), 10
"""Lengths of the segments [m], and the poses between two beginnings."""


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
    plane_percent: float
    """The same without the error along the sensor's upward axis."""
    ape_m: float
    """APE [m]; inf: the run failed."""


def runs_of(name: str, folder: Path) -> Iterator[Run]:
    """The runs of a pass."""
    for path in sorted((folder / "runs").rglob("result.json")):
        score = json.loads(path.read_text("utf-8"))["score"]
        drive = folder / "drives" / score["dataset"] / score["town"]
        space = plane = ape_m = math.inf
        if score["failed"] is None:
            sequence = SlamSequence(drive / f"{score['weather']}_{score['traffic']}")
            truth, ape_m = read_tum(sequence.truth_file(score["frame"])), score["ape_m"]
            space, plane = drifts_percent(truth, read_tum(path.with_name("estimate.tum")))
        yield Run(
            of=name,
            **{key: score[key] for key in ("town", "weather", "traffic", "cloud", "method")},
            drift_percent=space,
            plane_percent=plane,
            ape_m=ape_m,
        )


def drifts_percent(truth: Trajectory, estimate: Trajectory) -> tuple[float, float]:
    """Drift of an estimate in space and in the plane [%]; NaN: the route holds no segment."""
    stamp_ns = estimate.stamp_ns
    within = (stamp_ns >= truth.stamp_ns[0]) & (stamp_ns <= truth.stamp_ns[-1])
    paths = [path.at(stamp_ns[within]) for path in (truth, estimate)]
    steps_m = np.linalg.norm(np.diff(paths[0].position_m, axis=0), axis=1)
    way_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    errors = []
    for length_m in SEGMENTS_M:
        first = np.arange(0, len(way_m), FIRST_EVERY)
        last = np.searchsorted(way_m, way_m[first] + length_m)
        first, last = first[last < len(way_m)], last[last < len(way_m)]
        true, found = (
            Rotation.from_quat(path.quat_xyzw[first]).apply(
                path.position_m[last] - path.position_m[first], inverse=True
            )
            for path in paths
        )
        errors.append((found - true) / length_m)
    error = np.concatenate(errors)
    if not len(error):
        return math.nan, math.nan
    return 100.0 * np.linalg.norm(error, axis=1).mean(), 100.0 * np.linalg.norm(error[:, :2], axis=1).mean()


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
    """Another system in place of one, in clear air."""

    def chosen(name: str) -> Chosen:
        return lambda run: run.method == name and run.weather == "ClearNoon"

    return chosen(method), chosen(other), False


def weather(other: str, *methods: str) -> tuple[Chosen, Chosen, bool]:
    """Another weather in place of clear air, for all systems or some."""

    def chosen(name: str) -> Chosen:
        return lambda run: run.weather == name and (not methods or run.method in methods)

    return chosen("ClearNoon"), chosen(other), True


def masked() -> tuple[Chosen, Chosen, bool]:
    """Without movers in place of among them."""
    return (lambda run: run.cloud == "raw"), (lambda run: run.cloud == "seg"), True


THREE = {"Town03", "Town04", "Town05"}
SNOW, ICP = {"Town03", "Town07"}, ("kiss_icp", "genz_icp", "small_gicp")
IN_PLANE = {"4", "5", "5d", "15s", "15h", "15t", "15u", "15r", "15n", "15f"}
"""Effects whose published drifts are in the plane."""
EFFECTS: dict[str, tuple[str, str, set[str], tuple[Chosen, Chosen, bool]]] = {
    "1": ("hdl64e", "drift_percent", THREE, between("kiss_icp", "kiss_not_deskewed")),
    "4": ("hdl64e", "drift_percent", {"Town04"}, between("kiss_icp", "kiss_40m")),
    "7": ("hdl64e", "drift_percent", THREE, between("kiss_icp", "kiss_quarter")),
    "7b": ("hdl64e", "drift_percent", THREE, between("kiss_icp", "kiss_half")),
    "10": ("hdl64e", "drift_percent", THREE, between("kiss_icp", "kiss_fixed")),
    "5": ("aeries2", "drift_percent", {"Town04"}, between("kiss_40m", "kiss_40m_doppler")),
    "5d": ("aeries2", "drift_percent", {"Town04"}, between("icp_40m", "icp_40m_doppler")),
    "15s": ("snow", "drift_percent", SNOW, weather("SnowyNoon", *ICP)),
    "15h": ("snow", "drift_percent", SNOW, weather("SnowyNoon_snowfall-5", *ICP)),
    "15t": ("snow64", "drift_percent", SNOW, weather("SnowyNoon")),
    "15u": ("snow64", "drift_percent", SNOW, weather("SnowyNoon_snowfall-5")),
    "15f": ("rain", "drift_percent", {"Town10"}, weather("ClearNight_fog_density-0")),
    "15r": ("rain", "drift_percent", {"Town10"}, weather("ClearNoon_rain_mmph-25")),
    "18": ("cameras", "ape_m", {"Town05"}, weather("ClearNight", "stereo_vo", "orbslam3_stereo")),
    "20": ("real", "ape_m", {"Town05"}, between("orbslam3_stereo", "orbslam3_stereo_inertial")),
    "20q": ("cameras", "ape_m", {"Town05"}, between("orbslam3_stereo", "orbslam3_stereo_inertial")),
    "15n": ("rain", "drift_percent", {"Town10"}, weather("ClearNight")),
    "22": ("flu", "ape_m", {"Town05"}, masked()),
    "22q": ("flu640", "ape_m", {"Town05"}, masked()),
}
"""Of each effect: pass, measure, towns, and both sides of the ratio."""


MOTORWAY = {"6": ("kiss_icp", "small_gicp"), "6l": ("loam",)}
"""Systems of the effects of a motorway."""


def motorway(runs: list[Run], measure: str, methods: tuple[str, ...]) -> list[float]:
    """Town04 over the median of the other towns, for each system."""
    found = []
    for method in methods:
        mine = {
            run.town: getattr(run, measure) for run in runs if run.of == "hdl64e" and run.method == method
        }
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
            measures = ("drift_percent", "plane_percent", "ape_m")
            values: dict[str, Any] = row | {key: float(row[key]) for key in measures}
            runs.append(Run(**values))
    for word in passes:
        name, _, folder = word.partition("=")
        runs = [run for run in runs if run.of != name]
        runs += [run for part in folder.split(",") for run in runs_of(name, Path(part))]
    if passes:
        with kept.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(Run.__slots__)
            for run in runs:
                cells = (getattr(run, key) for key in Run.__slots__)
                writer.writerow([f"{cell:.5g}" if isinstance(cell, float) else cell for cell in cells])
    for row in csv.DictReader((HERE / "plan.csv").open(encoding="utf-8")):
        found = {
            measure: measured(row["effect"], runs, measure) for measure in ("drift_percent", "plane_percent")
        }
        if any(found.values()):
            sys.stdout.write(table_row(row, found))


def measured(effect: str, runs: list[Run], measure: str) -> list[float]:
    """The ratios of an effect; APE in place of drift where the plan has it."""
    if effect in MOTORWAY:
        return motorway(runs, measure, MOTORWAY[effect])
    if effect not in EFFECTS:
        return []
    of, usual, towns, (first, second, by_method) = EFFECTS[effect]
    mine = [run for run in runs if run.of == of and run.town in towns]
    return ratios(mine, usual if usual == "ape_m" else measure, first, second, by_method=by_method)


def table_row(row: dict[str, str], found: dict[str, list[float]]) -> str:
    """An effect beside its band, as a row of Markdown: in space, in the plane, and each ratio that counts."""
    counts = found["plane_percent" if row["effect"] in IN_PLANE else "drift_percent"]
    high = math.inf if row["high"] == "lost" else float(row["high"])
    verdict = "inside" if float(row["low"]) <= median(counts) <= high else "outside"
    here = " | ".join(f"{median(found[key]):.2f}" for key in ("drift_percent", "plane_percent"))
    each, band = ", ".join(f"{value:.2f}" for value in counts), f"{row['low']} to {row['high']}"
    return f"| {row['effect']} | {row['question']} | {band} | {here} | {each} | {verdict} |\n"


if __name__ == "__main__":
    main(sys.argv[1:])
