"""Traffic levels as users write them."""

import pytest

from carlaloc_env.traffic import traffic_config
from recorder.episode.traffic_level import LEVEL_WORDS, LEVELS, traffic_level


def test_levels_of_drives_and_replays_are_the_same() -> None:
    assert LEVELS == traffic_config.LEVELS
    assert set(LEVELS) < set(LEVEL_WORDS)


@pytest.mark.parametrize(
    ("text", "fraction", "parked"),
    [("dynamic", 1.0, True), ("static", 0.0, True), ("empty", 0.0, False), ("0.25", 0.25, True)],
)
def test_only_empty_leaves_out_parked_cars(text: str, fraction: float, parked: bool) -> None:
    level = traffic_level(text)
    assert (level.fraction, level.parked_cars) == (fraction, parked)
