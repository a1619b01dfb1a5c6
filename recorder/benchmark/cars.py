"""Scores runs over the cars of one drive together: folders ``car1`` … of `carlaloc replay --car all`."""

import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import pandas as pd

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from carlaloc_env.core.files.atomic_files import write_whole
from recorder.benchmark.plan import Job
from recorder.benchmark.run import BenchmarkResult
from recorder.benchmark.tables import Tables
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.together import TogetherResult, evaluate_together, set_out_at
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.worker import ESTIMATE

FILE = "cars.csv"
"""Table of the cars together, in the benchmark's folder."""
_CAR = re.compile(r"(?:(?P<fleet>.*)/)?car(?P<number>\d+)$")


def score_cars(result: BenchmarkResult) -> pd.DataFrame:
    """A row for each drive of several cars, condition, system and repetition; empty where there is none.

    A system that knows one car alone begins each car's path at its own zero: every estimate is set out from
    the true pose of its first frame, as robots are whose starts were measured.
    """
    groups: dict[tuple[Any, ...], dict[int, Job]] = defaultdict(dict)
    for job, score in zip(result.jobs, result.scores, strict=True):
        found = _CAR.match(job.sequence.dataset)
        if found is not None and score.coverage > 0:
            at = job.sequence
            key = (found["fleet"] or "", at.town, at.weather, at.traffic, job.title, job.run)
            groups[key][int(found["number"])] = job
    names = ("dataset", "town", "weather", "traffic", "title", "run")
    rows = [
        {**dict(zip(names, key, strict=True)), **_row(result.out, [cars[n] for n in sorted(cars)])}
        for key, cars in groups.items()
        if len(cars) > 1
    ]
    return pd.DataFrame(rows)


def write_cars(result: BenchmarkResult) -> tuple[list[Path], list[dict[str, Any]]]:
    """Write the table of the cars together, if there are any; its path, and its rows.

    Raises:
        EvaluationError: the file cannot be written.
    """
    table = score_cars(result)
    if not len(table):
        return [], []
    path = result.out / FILE
    write_whole(path, table.to_csv(index=False), EvaluationError)
    rows: list[dict[str, Any]] = table.to_dict("records")
    return [path], rows


def cars_tables(cars: pd.DataFrame) -> Tables:
    """The table of `write_cars` with its title; none where no drive has several cars."""
    if cars.empty:
        return []
    m, deg, failed = "{:.3f}".format, "{:.2f}".format, cars["failed"] != ""
    numbers = {
        "joint [m]": cars["joint_m"].map(m),
        "each in it [m]": cars["joint_of_m"],
        "each alone [m]": cars["alone_m"],
        "between [m]": cars["between_m"].map(m),
        "between [deg]": cars["between_deg"].map(deg),
    }
    table = {
        "system": cars["title"],
        "drive": cars["dataset"].str.cat(cars[["town", "weather", "traffic"]], sep=" ").str.strip(),
        "cars": cars["cars"].map(str),
        **{name: column.mask(failed, "fail") for name, column in numbers.items()},
        **({"failed": cars["failed"]} if failed.any() else {}),
    }
    return [("Cars of one drive together: APE after one fit for all", pd.DataFrame(table))]


def _row(out: Path, jobs: list[Job]) -> dict[str, Any]:
    try:
        found = _together(out, jobs)
    except CarlaLocError as error:
        lost = dict.fromkeys(("joint_m", "between_m", "between_deg"), float("nan"))
        return {"cars": len(jobs), **lost, "joint_of_m": "", "alone_m": "", "failed": str(error)}
    between = [(found.between_m[pair].rmse, found.between_deg[pair].rmse) for pair in found.between_m]
    return {
        "cars": len(jobs),
        "joint_m": found.joint.rmse,
        "joint_of_m": " ".join(f"{one.rmse:.3f}" for one in found.joint_of),
        "alone_m": " ".join(f"{one.rmse:.3f}" for one in found.alone),
        "between_m": max(m for m, _ in between),
        "between_deg": max(deg for _, deg in between),
        "failed": "",
    }


def _together(out: Path, jobs: list[Job]) -> TogetherResult:
    system = jobs[0].system
    truths = [read_tum(SlamSequence(job.sequence.path).truth_file(system.frame)) for job in jobs]
    estimates = [read_tum(out / job.folder / ESTIMATE) for job in jobs]
    placed = [set_out_at(*pair) for pair in zip(truths, estimates, strict=True)]
    return evaluate_together(truths, placed, alignment=system.alignment)
