"""Events of bands in the order of time, against a stable sort."""

from __future__ import annotations

import numpy as np
import pytest

from carlaloc_env.sensors.event_camera.time_sorting import Slots


@pytest.mark.parametrize("room", [0, 900, 4000, 100_000])
def test_events_come_by_time_and_then_by_band(room: int) -> None:
    """With room for none, some or all of them; bands come in any order, and one is empty."""
    draw, span_us = np.random.default_rng(3), 50_000
    many = [1200, 0, 5000, 40, 1500]
    times = [draw.integers(0, span_us + 1, count) // 7 * 7 for count in many]
    codes = [draw.integers(0, 1 << 27, count) for count in many]
    slots = Slots(len(many), span_us, room)
    for band in (3, 0, 4, 1, 2):
        slots.take(band, times[band].astype(np.int32), codes[band].astype(np.uint32))
    found = slots.by_time(10**9)
    t, code = np.concatenate(times), np.concatenate(codes)
    order = np.argsort(t, kind="stable")
    np.testing.assert_array_equal(found["t"], 10**9 + 1000 * t[order])
    np.testing.assert_array_equal(found["x"], code[order] >> 1 & 0xFFFF)
    np.testing.assert_array_equal(found["y"], code[order] >> 17)
    np.testing.assert_array_equal(found["p"], code[order] & 1)
