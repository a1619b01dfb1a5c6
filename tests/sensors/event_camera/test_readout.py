"""Read-out of events: the order of time against a stable sort, the limit of its rate, counts."""

import numpy as np
from shared_fixtures.readings.bag_samples import batch_of

from carlaloc_env.samples import EVENT
from carlaloc_env.sensors.event_camera.read_out import by_time, limit_rate


def test_events_come_by_time_and_then_by_band() -> None:
    """Of several bands, one of which is empty."""
    draw, span_us = np.random.default_rng(3), 50_000
    many = [1200, 0, 5000, 40, 1500]
    times = [(draw.integers(0, span_us + 1, count) // 7 * 7).astype(np.int32) for count in many]
    codes = [draw.integers(0, 1 << 27, count).astype(np.uint32) for count in many]
    found = by_time(times, codes, 10**9, span_us)
    t, code = np.concatenate(times), np.concatenate(codes)
    order = np.argsort(t, kind="stable")
    np.testing.assert_array_equal(found["t"], 10**9 + 1000 * t[order].astype(np.int64))
    np.testing.assert_array_equal(found["x"], code[order] >> 1 & 0xFFFF)
    np.testing.assert_array_equal(found["y"], code[order] >> 17)
    np.testing.assert_array_equal(found["p"], code[order] & 1)


def test_rate_limit_thins_busy_slots_evenly() -> None:
    events = np.zeros(9000, EVENT)
    events["t"] = np.concatenate([np.linspace(1, 1_000_000, 8000), np.linspace(1_000_001, 2e6, 1000)])
    kept = limit_rate(events, 0, 2e6)
    early = kept["t"] <= 1_000_000
    assert early.sum() == 2000
    assert (~early).sum() == 1000
    assert np.diff(kept["t"][early]).max() < 1100


def test_counts_of_an_observation() -> None:
    events = np.array([(5, 3, 1, 1), (6, 3, 1, 1), (7, 0, 0, 0)], EVENT)
    counts = batch_of(events, size_px=(4, 2)).observed()
    assert counts.shape == (2, 4, 2)
    assert counts[1, 3, 0] == 2
    assert counts[0, 0, 1] == 1
    assert counts.sum() == 3
