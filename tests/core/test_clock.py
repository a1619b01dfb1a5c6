"""The clock against exact rational arithmetic."""

import itertools
from fractions import Fraction

import pytest

from carlaloc_env.core.clock import TICK_NS, Schedule, stamp_ns
from carlaloc_env.core.errors import ConfigError


@pytest.mark.parametrize("rate_hz", [200, 100, 40, 20, 10, 5, 1, 0.5])
def test_schedule_equals_fractions_for_an_hour(rate_hz: float) -> None:
    """No drift: stamp k is exactly k / rate, for an hour of samples."""
    hour_ns = 3600 * 10**9
    period = 10**9 / Fraction(rate_hz)
    assert period.denominator == 1
    assert Schedule.from_hz(rate_hz).stamps_ns_in(0, hour_ns) == list(range(0, hour_ns, period.numerator))


@pytest.mark.parametrize("rate_hz", [200, 20, 5])
def test_spans_partition_time(rate_hz: float) -> None:
    """Spans of odd lengths that follow each other give every stamp once."""
    schedule = Schedule.from_hz(rate_hz)
    borders = [0, 1, 4_999_999, 5_000_000, 35_000_001, 123_456_789, 1_000_000_000, 1_000_000_001]
    parts = [s for a, b in itertools.pairwise(borders) for s in schedule.stamps_ns_in(a, b)]
    assert parts == schedule.stamps_ns_in(0, borders[-1])


@pytest.mark.parametrize("rate_hz", [0, -5, 30, 400, 60, 199])
def test_rate_that_does_not_divide_is_refused(rate_hz: float) -> None:
    with pytest.raises(ConfigError, match="does not divide"):
        Schedule.from_hz(rate_hz)


def test_stamps_are_exact_after_ten_hours() -> None:
    assert stamp_ns(36_000 * 200) == 36_000_000_000_000
    assert TICK_NS * 200 == 1_000_000_000
