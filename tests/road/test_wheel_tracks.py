"""The map of wheel tracks: distances and heights of lanes, bridges, and what lies beyond."""

import numpy as np
import pytest

from carlaloc_env.core.array_types import Array
from carlaloc_env.road.wheel_tracks import CELL_MIN_M, REACH_M, TRACK_M, WheelTracks, no_tracks


def lane(along: Array, height_m: float, *, northwards: bool = False) -> Array:
    across = np.zeros_like(along)
    return np.stack([*((across, along) if northwards else (along, across)), across + height_m], 1)


ALONG = np.arange(-50.0, 50.0, 0.5)


def test_distance_is_that_of_the_lanes_middle_to_a_cell() -> None:
    rng = np.random.default_rng(1)
    points = np.stack([rng.uniform(-45, 45, 500), rng.uniform(-9, 9, 500), np.full(500, 2.5)], axis=1)
    away_m, above_m = WheelTracks.of(lane(ALONG, 2.0)).at(points)
    expected = np.minimum(np.abs(points[:, 1]), REACH_M)
    np.testing.assert_allclose(away_m, expected, atol=0.71 * CELL_MIN_M + 0.02)
    np.testing.assert_allclose(above_m[expected < REACH_M - 0.5], 0.5, atol=1e-6)


def test_wheels_of_one_lane_clear_the_middle_of_another() -> None:
    tracks = WheelTracks.of(np.concatenate([lane(ALONG, 0.0), lane(ALONG, 0.0, northwards=True)]))
    points = np.array([[0.0, y, 0.0] for y in (0.0, TRACK_M, 10.0)])
    # The middle of the crossing, a track of the lane from the west, and the middle of the other alone.
    np.testing.assert_allclose(tracks.at(points)[0], [0.0, TRACK_M, 0.0], atol=0.71 * CELL_MIN_M + 0.02)


def test_lanes_under_bridges_are_left_to_the_bridge() -> None:
    """No snow falls on them; a lane that a ramp crosses lower than a lorry is high stays."""
    for height_m, seen_m in ((6.0, 6.0), (1.0, 0.0)):
        tracks = WheelTracks.of(np.concatenate([lane(ALONG, 0.0), lane(ALONG, height_m, northwards=True)]))
        _, above_m = tracks.at(np.array([[0.3, 0.3, 0.0], [30.0, 0.0, 0.0]]))
        assert -above_m[0] == pytest.approx(seen_m) or height_m == 1.0
        assert above_m[1] == pytest.approx(0.0)


def test_nothing_is_near_beyond_the_map_and_without_lanes() -> None:
    for tracks in (WheelTracks.of(lane(ALONG, 0.0)), WheelTracks.of(np.zeros((0, 3))), no_tracks()):
        away_m, above_m = tracks.at(np.array([[4000.0, -4000.0, 0.0]]))
        assert away_m[0] == REACH_M
        assert above_m[0] > 1e3
