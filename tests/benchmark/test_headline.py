"""The sentence of a report, by hand-made scores, and the runs that its picture shows."""

import pytest
from shared_fixtures.readings.scores import score

from recorder.benchmark.headline import headline
from recorder.benchmark.score import Score
from recorder.benchmark.tables import frame_of

ONCE = "The spread of single runs is not known."
NO_PAIR = "No two conditions have results to compare."


def levels(method: str, static_m: list[float], dynamic_m: list[float], lost_m: float = 5.0) -> list[Score]:
    """Runs of a system without and among movers; those with an error from a limit on failed."""
    found = [("static", v) for v in static_m] + [("dynamic", v) for v in dynamic_m]
    return [score(method, level, v, "lost" if v >= lost_m else None) for level, v in found]


@pytest.mark.parametrize(
    ("scores", "sentence", "shown"),
    [
        # A ratio of millimetres counts less than one of metres.
        (levels("gicp", [0.001], [0.02]) + levels("vo", [0.142], [1.428]) + levels("icp", [0.39], [0.31]),
         f"vo loses most: 0.142 m static, 1.43 m among movers (×10.1); T, ClearNoon. {ONCE}", [[2], [3]]),
        (levels("icp", [0.39], [0.31]) + levels("gicp", [0.158], [0.165]),
         "No system loses clearly; gicp is the closest: 0.158 m static, 0.165 m among movers (×1.04); "
         f"T, ClearNoon. {ONCE}", [[2], [3]]),
        (levels("vo", [0.1, 0.3], [0.2, 0.6]),
         "No system loses clearly; vo is the closest: 0.200 m static, 0.400 m among movers (×2); "
         "T, ClearNoon. The ranges of runs overlap.", [[0, 1], [2, 3]]),
        # A run that failed is no part of the median, nor of the picture.
        (levels("vo", [0.1, 0.3], [0.4, 0.6, 9.0]),
         "vo loses most: 0.200 m static, 0.500 m among movers (×2.5); T, ClearNoon. "
         "The ranges of runs do not overlap.", [[0, 1], [2, 3]]),
        (levels("vo", [0.1], [0.9]) + levels("icp", [0.1], [9.0]),
         "icp loses most: 0.100 m static, fails among movers; T, ClearNoon. Failed runs: 1 of 1.",
         [[2], [3]]),
        ([score("vo", "dynamic", 0.1), score("vo", "dynamic", 0.5, weather="FoggyNoon")],
         f"vo loses most: 0.100 m in ClearNoon, 0.500 m in FoggyNoon (×5); T, dynamic. {ONCE}", [[0], [1]]),
        (levels("vo", [0.3], []) + levels("icp", [0.2], []) + levels("gicp", [9.0], []),
         f"Position errors: icp 0.200 m, vo 0.300 m, gicp fails; T, ClearNoon, static. {NO_PAIR}",
         [[1], [0], [2]]),
        # Labels are a cure and no condition.
        ([score("a", "dynamic", 0.1), score("a", "dynamic", 0.9, cloud="seg")],
         f"Position errors: a 0.900 m; T, ClearNoon, dynamic, seg. {NO_PAIR}", [[1]]),
        (levels("vo", [9.0], [9.0]), "Every run failed, 2 in all; the first: lost.", []),
    ],
)  # fmt: skip
def test_the_sentence_and_its_runs(scores: list[Score], sentence: str, shown: list[list[int]]) -> None:
    found, runs = headline(frame_of(scores))
    assert found == sentence
    assert [rows.nonzero()[0].tolist() for rows in runs.values()] == shown
