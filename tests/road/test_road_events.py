"""Rectangles in the road as a tyre feels them."""

import numpy as np
import pytest

from carlaloc_env.road.road_events import event_height, event_table, no_events
from carlaloc_env.road.road_profile import LevelGrid, Roughness

FOOT_M = 0.15


def test_a_tyre_feels_the_mean_over_its_footprint() -> None:
    """Against 400 points of a square footprint on a turned cover and a narrow joint."""
    turn = 0.7
    cos, sin = np.cos(turn), np.sin(turn)
    rows = np.array([[3.9, -7.95, cos, sin, 0.3, 0.2, -0.01], [40.0, 3.0, cos, sin, 0.05, 1.7, 0.004]])
    events = event_table(rows, FOOT_M)
    u, v = np.meshgrid(*2 * [FOOT_M * ((np.arange(20) + 0.5) / 20 - 0.5)])
    rng = np.random.default_rng(0)
    for x, y, _, _, length, width, height in rows:
        for a, b in rng.uniform(-1.5, 1.5, (40, 2)) * (length, width):
            on = (np.abs(a + u) < length) & (np.abs(b + v) < width)
            at = x + cos * a - sin * b, y + sin * a + cos * b
            assert event_height(events, *at) == pytest.approx(height * on.mean(), abs=0.06 * abs(height))


def test_elsewhere_the_road_is_as_without() -> None:
    level = LevelGrid.uniform(8.0)
    with_one = Roughness(3, level, np.array([[0.0, 0.0, 1.0, 0.0, 0.3, 0.3, 0.005]]))
    plain = Roughness(3, level, no_events())
    assert with_one.height(0.5, 0.0) == plain.height(0.5, 0.0)
    assert with_one.height(0.0, 0.1) == pytest.approx(plain.height(0.0, 0.1) + 0.005)
