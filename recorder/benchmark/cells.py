"""Scores of a condition brought together: the median and range of what did not fail."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from recorder.benchmark.score import Score
from recorder.dataset.sequence import SEGMENTED


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Condition:
    """A row of a table."""

    town: str
    weather: str
    traffic: str
    cloud: str

    @property
    def traffic_label(self) -> str:
        """The paper's letters: s, d, and seg(d) for clouds without movers."""
        short = {"static": "s", "dynamic": "d", "empty": "e"}.get(self.traffic, self.traffic)
        return f"seg({short})" if self.cloud == SEGMENTED else short


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """All runs of one system under one condition."""

    values: tuple[float, ...]
    """Figures of the runs that did not fail, sorted."""
    failed: int
    """Number of those that did."""
    missing: int = 0
    """Number of those that did neither, but have no such figure, as drift on a way shorter than a segment."""

    @property
    def is_fail(self) -> bool:
        """Whether half of the runs or more failed."""
        return self.failed > 0 and self.failed * 2 >= self.failed + self.missing + len(self.values)

    @property
    def median(self) -> float:
        """Median of the runs that did not fail; NaN if the cell counts as failed or nothing was measured."""
        return float("nan") if self.is_fail or not self.values else float(np.median(self.values))

    @property
    def text(self) -> str:
        """Median, range of several runs, and how many failed."""
        if self.is_fail:
            return "fail"
        if not self.values:
            return "–"
        text = figure(self.median)
        if len(self.values) > 1:
            text += f" ({figure(self.values[0])}–{figure(self.values[-1])})"
        runs = self.failed + self.missing + len(self.values)
        return text + (f", {self.failed} of {runs} fail" if self.failed else "")


def figure(value: float) -> str:
    """A figure with the paper's two decimals, or three where it is small."""
    return f"{value:.3f}" if abs(value) < 1.0 else f"{value:.2f}"


Table = dict[Condition, dict[str, Cell]]
"""Cells by condition and method."""


def cells(scores: Sequence[Score], value: Callable[[Score], float] = lambda score: score.ape_m) -> Table:
    """Cells of all conditions, runs and noise seeds of a condition together.

    Args:
        scores: Runs.
        value: The figure to bring together; the position error [m] when left out.
    """
    grouped: dict[Condition, dict[str, list[Score]]] = defaultdict(lambda: defaultdict(list))
    for score in scores:
        condition = Condition(
            town=score.town, weather=score.weather, traffic=score.traffic, cloud=score.cloud
        )
        grouped[condition][score.method].append(score)
    return {
        condition: {
            method: Cell(
                values=tuple(sorted(v for v in of_good if math.isfinite(v))),
                missing=sum(not math.isfinite(v) for v in of_good),
                failed=sum(s.failed is not None for s in found),
            )
            for method, found in methods.items()
            for of_good in [[value(s) for s in found if s.failed is None]]
        }
        for condition, methods in sorted(grouped.items(), key=lambda item: _order(item[0]))
    }


def _order(condition: Condition) -> tuple[str, str, int, str]:
    """As in the paper: town, weather, static before seg(d) before dynamic."""
    place = 0 if condition.traffic in ("static", "empty") else 2 - (condition.cloud == SEGMENTED)
    return condition.town, condition.weather, place, condition.traffic


def best(row: dict[str, Cell]) -> set[str]:
    """Methods whose median, as printed, is the smallest of a row with several."""
    medians = {method: figure(cell.median) for method, cell in row.items() if math.isfinite(cell.median)}
    if len(row) < 2 or not medians:
        return set()
    least = min(medians.values(), key=float)
    return {method for method, text in medians.items() if text == least}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratio:
    """How one condition compares with another, over all pairs that have both."""

    method: str
    what: str
    """Which conditions are compared."""
    values: tuple[float, ...]
    """Ratios of medians, sorted."""
    repeated: int
    """Pairs in which both conditions have several runs; of the others the spread is not known."""
    within_range: int
    """Repeated pairs whose ranges overlap, so that nothing can be said of them."""

    @property
    def median(self) -> float:
        """Median of the ratios."""
        return float(np.median(self.values))


def ratios(table: Table) -> list[Ratio]:
    """Dynamic to static, seg(d) to dynamic, and each weather to clear noon."""
    found: dict[tuple[str, str], list[tuple[Cell, Cell]]] = defaultdict(list)
    for condition, row in table.items():
        for other, base in table.items():
            what = _compared(condition, other)
            if what is None:
                continue
            for method in row.keys() & base.keys():
                if math.isfinite(row[method].median) and base[method].median > 0:
                    found[method, what].append((row[method], base[method]))
    return [
        Ratio(
            method=method,
            what=what,
            values=tuple(sorted(a.median / b.median for a, b in pairs)),
            repeated=sum(len(a.values) > 1 and len(b.values) > 1 for a, b in pairs),
            within_range=sum(
                a.values[0] <= b.values[-1] and b.values[0] <= a.values[-1]
                for a, b in pairs
                if len(a.values) > 1 and len(b.values) > 1
            ),
        )
        for (method, what), pairs in sorted(found.items())
    ]


def _compared(condition: Condition, base: Condition) -> str | None:
    if condition.town != base.town:
        return None
    same_weather = condition.weather == base.weather
    if same_weather and base.traffic in ("static", "empty") and condition.cloud == base.cloud:
        return f"{condition.traffic} / {base.traffic}" if condition.traffic != base.traffic else None
    if same_weather and condition.cloud == SEGMENTED and base.cloud != SEGMENTED:
        return "seg(d) / d" if condition.traffic == base.traffic else None
    alike = condition.traffic == base.traffic and condition.cloud == base.cloud
    if alike and not same_weather and base.weather == "ClearNoon":
        return f"{condition.weather} / ClearNoon ({condition.traffic})"
    return None
