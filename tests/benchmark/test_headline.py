"""The sentence of a report, by hand-made scores, and the runs that its picture shows."""

import pytest
from shared_fixtures.readings.scores import score

from recorder.benchmark.headline import headline
from recorder.benchmark.score import Score
from recorder.benchmark.tables import frame_of

UNKNOWN = "The spread of single runs is not known."


def levels(method: str, static: list[float], dynamic: list[float], lost_m: float = 99.0) -> list[Score]:
    """Runs of a system without and among movers; the errors from a limit on are those of failed ones."""
    by_level = {"static": static, "dynamic": dynamic}
    return [
        score(method, level, v, "lost" if v >= lost_m else None)
        for level, found in by_level.items()
        for v in found
    ]


@pytest.mark.parametrize(
    ("scores", "sentence", "shown"),
    [
        (
            # A ratio of millimetres counts less than one of metres.
            [*levels("vo", [0.142], [1.428]), *levels("gicp", [0.001], [0.02]), *levels("icp", [0.4], [0.3])],
            f"vo loses most: 0.142 m static, 1.43 m among movers (×10.1); T, ClearNoon. {UNKNOWN}",
            [[0], [1]],
        ),
        (
            [*levels("icp", [0.39], [0.31]), *levels("gicp", [0.158], [0.165])],
            "No system loses clearly; gicp is the closest: 0.158 m static, 0.165 m among movers (×1.04); T, "
            f"ClearNoon. {UNKNOWN}",
            [[2], [3]],
        ),
        (
            levels("vo", [0.1, 0.3], [0.2, 0.6]),
            "No system loses clearly; vo is the closest: 0.200 m static, 0.400 m among movers (×2); T, "
            "ClearNoon. The ranges of runs overlap.",
            [[0, 1], [2, 3]],
        ),
        (
            # A run that failed is no part of the median, nor of the picture.
            levels("vo", [0.1, 0.3], [0.4, 0.6, 5.0], 5.0),
            "vo loses most: 0.200 m static, 0.500 m among movers (×2.5); T, ClearNoon. "
            "The ranges of runs do not overlap.",
            [[0, 1], [2, 3]],
        ),
        (
            [*levels("vo", [0.1], [0.9]), *levels("icp", [0.1], [5.0], 5.0)],
            "icp loses most: 0.100 m static, fails among movers; T, ClearNoon. Failed runs: 1 of 1.",
            [[2], [3]],
        ),
        (
            [score("vo", "dynamic", 0.1), score("vo", "dynamic", 0.5, weather="FoggyNoon")],
            f"vo loses most: 0.100 m in ClearNoon, 0.500 m in FoggyNoon (×5); T, dynamic. {UNKNOWN}",
            [[0], [1]],
        ),
        (
            [score("vo", "static", 0.3), score("icp", "static", 0.2), score("gicp", "static", 0.1, "lost")],
            "Position errors: icp 0.200 m, vo 0.300 m, gicp fails; T, ClearNoon, static. "
            "No two conditions have results to compare.",
            [[1], [0], [2]],
        ),
        (
            levels("vo", [1.0], [2.0], 0.0),
            "Every run failed, 2 in all; the first: lost.",
            [],
        ),
    ],
)  # fmt: skip
def test_sentence(scores: list[Score], sentence: str, shown: list[list[int]]) -> None:
    found, runs = headline(frame_of(scores))
    assert found == sentence
    assert [rows.nonzero()[0].tolist() for rows in runs.values()] == shown


def test_labels_are_a_cure_and_no_condition() -> None:
    """Clouds without movers may have larger errors; they are not compared with whole ones."""
    sentence, _ = headline(frame_of([score("a", "dynamic", 0.1), score("a", "dynamic", 0.9, cloud="seg")]))
    assert sentence.endswith("No two conditions have results to compare.")
