"""Answers of the demo: errors by system, weather and condition, their spread over seeds, and sentences."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from recorder.benchmark.run import BenchmarkResult
from recorder.dataset.sequence import RAW
from recorder.evaluation.path_errors import PathErrors

SEEDS = Path(__file__).with_name("seeds.csv")
"""Errors over ten seeds of noise; docs/scripts/make_demo_seeds.py makes it."""
STATIC, DYNAMIC, MASKED = "nothing moves", "among traffic", "movers masked"
CONDITIONS = (STATIC, DYNAMIC, MASKED)
"""What a sequence shows, and the same sequence without the pixels or points of movers."""
MATTERS = 2.0
"""Factor from which the demo says that a condition matters: beyond the spread of seeds."""
Key: TypeAlias = tuple[str, str]
"""Title of a system, and a weather."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Errors of a system in a weather."""

    title: str
    """Title of the system."""
    weather: str
    """Name of the weather."""
    ape_m: Mapping[str, float]
    """Position error (APE, RMSE) by condition [m]."""
    errors: Mapping[str, PathErrors]
    """Errors along the path by condition."""
    range_m: Mapping[str, tuple[float, float]]
    """Least and largest error over ten seeds by condition [m]; empty without kept ones."""
    meaning: str
    """What they mean."""


def answers_of(result: BenchmarkResult) -> list[Answer]:
    """Answers of a benchmark: of each system and weather, in the order of their runs."""
    ape_m: dict[Key, dict[str, float]] = {}
    errors: dict[Key, dict[str, PathErrors]] = {}
    for score, (job, path_errors) in zip(result.scores, result.errors(), strict=True):
        key = job.system.title, score.weather
        condition = condition_of(score.traffic, score.cloud)
        ape_m.setdefault(key, {})[condition] = score.ape_m
        errors.setdefault(key, {})[condition] = path_errors
    kept = kept_ranges()
    answers = []
    for key, by_condition in ape_m.items():
        ordered = {name: by_condition[name] for name in CONDITIONS if name in by_condition}
        clear = ape_m.get((key[0], "ClearNoon"), {})
        answers.append(
            Answer(
                title=key[0],
                weather=key[1],
                ape_m=ordered,
                errors={name: errors[key][name] for name in ordered},
                range_m=kept.get(key, {}),
                meaning=meaning_of(ordered, clear if key[1] != "ClearNoon" else {}),
            )
        )
    return answers


def answer_to_first(answers: Sequence[Answer]) -> str:
    """The answer to the demo's question, by its first system: what movers do, and what helps."""
    first = answers[0]
    static, dynamic, masked = (first.ape_m.get(condition, np.nan) for condition in CONDITIONS)
    return (
        f"Over the same metres {first.title}'s position error is {static:.2f} m where nothing moves, "
        f"{dynamic:.2f} m among traffic, and {masked:.2f} m among traffic with the movers masked."
    )


def condition_of(traffic: str, cloud: str) -> str:
    """The demo's name of a run's condition."""
    if cloud != RAW:
        return MASKED
    return STATIC if traffic == "static" else DYNAMIC


def kept_ranges(path: Path = SEEDS) -> dict[Key, dict[str, tuple[float, float]]]:
    """Least and largest errors over the seeds of a kept file, by system, weather and condition [m]."""
    found: dict[Key, dict[str, list[float]]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            by_condition = found.setdefault((row["title"], row["weather"]), {})
            condition = condition_of(row["traffic"], row["cloud"])
            by_condition.setdefault(condition, []).append(float(row["ape_m"]))
    return {
        key: {name: (min(each), max(each)) for name, each in by_condition.items()}
        for key, by_condition in found.items()
    }


def meaning_of(ape_m: Mapping[str, float], clear_m: Mapping[str, float]) -> str:
    """A sentence of what errors mean.

    Args:
        ape_m: Errors by condition [m].
        clear_m: Those of the same system at a clear noon; empty where these are they.
    """
    static = ape_m.get(STATIC, np.nan)
    if clear_m:
        return _compared(static / clear_m.get(STATIC, np.nan), "This weather", "where nothing moves")
    text = _compared(ape_m.get(DYNAMIC, np.nan) / static, "Traffic", "here")
    if MASKED in ape_m and ape_m[DYNAMIC] > MATTERS * max(ape_m[MASKED], static):
        share = 1.0 - ape_m[MASKED] / ape_m[DYNAMIC]
        text += f" Masks of the movers take {share:.0%} of it away."
    return text


def _compared(ratio: float, subject: str, where: str) -> str:
    if np.isnan(ratio):
        return ""
    if ratio >= MATTERS:
        return f"{subject} multiplies the error by {ratio:.1f} {where}."
    if ratio <= 1.0 / MATTERS:
        return f"{subject} divides the error by {1.0 / ratio:.1f} {where}."
    return f"{subject} does not mislead this system {where}."
