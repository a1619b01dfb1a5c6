"""Streams of random numbers: keyed, independent, of the right distribution."""

import numpy as np
import pytest

from carlaloc_env.core.clock import stream


def test_same_key_same_numbers_in_any_order() -> None:
    """Sampling order and other streams change nothing."""
    forward = {t: stream(7, "lidar/range", t).standard_normal(5) for t in range(20)}
    stream(7, "radar", 3).standard_normal(1000)
    for t in reversed(range(20)):
        assert np.array_equal(stream(7, "lidar/range", t).standard_normal(5), forward[t])


@pytest.mark.parametrize(
    "other", [(8, "imu", 5, 0), (7, "imu2", 5, 0), (7, "imu", 6, 0), (7, "imu", 5, 1), (7, "imu", -5, 0)]
)
def test_every_part_of_the_key_matters(other: tuple[int, str, int, int]) -> None:
    assert not np.array_equal(stream(7, "imu", 5, 0).random(4), stream(*other).random(4))


def test_neighbouring_stamps_never_share_numbers() -> None:
    """A stamp's counter is so far from its neighbours' that a whole sweep fits between them."""
    a = stream(1, "lidar/range", 0).random(100_000)
    b = stream(1, "lidar/range", 1).random(100_000)
    assert len(np.intersect1d(a, b)) == 0


def test_streams_are_uncorrelated() -> None:
    """Correlation of two streams lies within 4 / sqrt(n) of zero."""
    n = 200_000
    rows = [
        stream(1, "a", 0).standard_normal(n),
        stream(1, "a", 1).standard_normal(n),
        stream(1, "b", 0).standard_normal(n),
        stream(2, "a", 0).standard_normal(n),
    ]
    corr = np.corrcoef(rows) - np.eye(4)
    assert np.abs(corr).max() < 4 / np.sqrt(n)


def test_first_numbers_over_stamps_are_standard_normal() -> None:
    """One number per stamp, as GNSS draws them, is as normal as one long stream."""
    x = np.array([stream(3, "gnss/position", 200_000_000 * k).standard_normal() for k in range(4000)])
    assert abs(x.mean()) < 4 / np.sqrt(len(x))
    assert abs(x.var() - 1) < 4 * np.sqrt(2 / len(x))
    assert abs(np.corrcoef(x[:-1], x[1:])[0, 1]) < 4 / np.sqrt(len(x))
