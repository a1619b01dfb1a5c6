"""Event pixels against closed forms: ramps, sums, dead times, noise, order."""

from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.event_pixels import SHAPE, SPAN_US, fresh, run, sums, uniform

from carlaloc_env.core import cores
from carlaloc_env.samples import EVENT
from carlaloc_env.sensors.event_camera.pixels import NEVER_US, NoiseEvents, PixelState, Thresholds


@pytest.mark.parametrize(("slope", "threshold"), [(8.0, 0.2), (-31.0, 0.25), (3.9, 0.05)])
def test_ramp_fires_at_slope_over_threshold(slope: float, threshold: float) -> None:
    """A linear ramp of slope s crosses the k-th threshold at k·C/s."""
    before = np.zeros(SHAPE, np.float32)
    events, _ = run(before, before + np.float32(slope * 0.05), thresholds=uniform(threshold, threshold))
    count = int(abs(slope) * 0.05 / threshold + 1e-4)
    assert len(events) == count * before.size
    assert np.all(events["p"] == (slope > 0))
    expected_us = np.ceil(1e6 * threshold / abs(slope) * np.arange(1, count + 1))
    assert np.all(np.abs(np.unique(events["t"]) / 1000 - expected_us) <= 1)


def test_ramp_over_many_pictures_loses_nothing() -> None:
    """The state carries the remainder over: 40 pictures of a ramp give the rate s/C."""
    level, slope = np.zeros(SHAPE, np.float32), 2.7
    state, total = fresh(level), 0
    for k in range(40):
        after = np.full(SHAPE, np.float32(slope * 0.05 * (k + 1)))
        events, state = run(level, after, state=state, start_ns=k * 50_000_000)
        total, level = total + len(events), after
    assert total / level.size == pytest.approx(slope * 2.0 / 0.2, abs=1.0)


def test_sums_of_events_rebuild_the_change_within_a_threshold() -> None:
    generator = np.random.default_rng(4)
    level = generator.normal(0, 1, SHAPE).astype(np.float32)
    thresholds = Thresholds.draw(3, "left", SHAPE, 0.25, 0.35, 0.03)
    first, state, told = level, fresh(level), np.zeros(SHAPE, np.float32)
    for k in range(12):
        after = (level + generator.normal(0, 0.7, SHAPE)).astype(np.float32)
        events, state = run(level, after, state=state, thresholds=thresholds, start_ns=k * 50_000_000)
        on, off = thresholds.on[events["y"], events["x"]], thresholds.off[events["y"], events["x"]]
        told += sums(events, SHAPE, on, off)
        level = after
        error = level - first - told
        assert np.all(error < thresholds.on + 1e-4)
        assert np.all(error > -thresholds.off - 1e-4)


def test_no_event_within_the_refractory_time() -> None:
    generator = np.random.default_rng(5)
    level = np.zeros(SHAPE, np.float32)
    state, parts = fresh(level), []
    for k in range(4):
        after = generator.normal(0, 2, SHAPE).astype(np.float32)
        noise = NoiseEvents.draw(2, "left", k, SHAPE, 200.0, SPAN_US)
        events, state = run(
            level, after, state=state, noise=noise, start_ns=k * 50_000_000, refractory_us=3000
        )
        parts.append(events)
        level = after
    events = np.concatenate(parts)
    order = np.lexsort((events["t"], events["x"], events["y"]))
    events = events[order]
    same = (np.diff(events["x"].astype(int)) == 0) & (np.diff(events["y"].astype(int)) == 0)
    assert same.sum() > 1000
    assert np.diff(events["t"])[same].min() >= 3_000_000


def test_leak_and_shot_noise_in_steady_light() -> None:
    """Leak: positive events only, at its rate. NoiseEvents: Poisson, both signs."""
    shape = (60, 80)
    level = np.zeros(shape, np.float32)
    thresholds, state, leaked = uniform(0.3, 0.3, shape), fresh(level), 0
    for _ in range(100):
        events, state = run(level, level, state=state, thresholds=thresholds, leak_hz=1.5)
        assert np.all(events["p"] == 1)
        leaked += len(events)
    assert leaked / level.size == pytest.approx(1.5 * 5.0, abs=1.0)
    noise = NoiseEvents.draw(9, "left", 77, shape, 20.0, SPAN_US)
    events, _ = run(level, level, thresholds=thresholds, noise=noise)
    expected = 20.0 * 0.05 * level.size
    assert abs(len(events) - expected) < 5 * np.sqrt(expected)
    assert abs(events["p"].mean() - 0.5) < 5 * 0.5 / np.sqrt(expected)


def test_steady_light_without_noise_gives_nothing() -> None:
    level = np.random.default_rng(6).normal(0, 2, SHAPE).astype(np.float32)
    events, state = run(level, level)
    assert len(events) == 0
    np.testing.assert_array_equal(state.reference, level)


@pytest.mark.parametrize("shape", [(37, 61), (33, 49), (9, 8), (8, 9)])
def test_pictures_need_not_hold_whole_tiles(shape: tuple[int, int]) -> None:
    """Up to the last pixel sums rebuild the change, and every noise event comes once, at its own time."""
    generator = np.random.default_rng(13)
    before, after = generator.normal(0, 1, (2, *shape)).astype(np.float32)
    events, _ = run(before, after)
    error = after - before - sums(events, shape, 0.2, 0.2)
    assert np.abs(error).max() < 0.2 + 1e-4
    noise = NoiseEvents.draw(9, "left", 7, shape, 200.0, SPAN_US)
    noisy, _ = run(before, before, noise=noise)
    got = np.stack([noisy["t"] // 1000, noisy["y"], noisy["x"], noisy["p"]], axis=-1).astype(int)
    width = shape[1]
    want = np.stack([noise.t_us, noise.pixel // width, noise.pixel % width, noise.positive], axis=-1)
    np.testing.assert_array_equal(got[np.lexsort(got.T)], want[np.lexsort(want.T)])


def test_events_come_in_the_order_of_time() -> None:
    generator = np.random.default_rng(7)
    before, after = generator.normal(0, 1, (2, *SHAPE)).astype(np.float32)
    events, _ = run(before, after, start_ns=123_000_000)
    assert events.dtype == EVENT
    assert np.all(np.diff(events["t"]) >= 0)
    assert events["t"].min() > 123_000_000
    assert events["t"].max() <= 173_000_000
    assert events["x"].max() < SHAPE[1]
    assert events["y"].max() < SHAPE[0]


def test_events_are_those_of_the_closed_form_with_leak_dead_time_and_noise() -> None:
    """In still light that changes evenly crossing k comes at (reference ± k·C − L(0)) / slope."""
    generator = np.random.default_rng(14)
    before, after = generator.normal(0, 2, (2, *SHAPE)).astype(np.float32)
    thresholds = Thresholds.draw(3, "left", SHAPE, 0.25, 0.35, 0.03)
    state = PixelState.initial(before, thresholds, 3, "left", 0)
    noise = NoiseEvents.draw(9, "left", 7, SHAPE, 100.0, SPAN_US)
    settings: dict[str, Any] = {"refractory_us": 700, "leak_hz": 4.0}
    events, _ = run(before, after, state=state, thresholds=thresholds, noise=noise, **settings)
    alike = 0
    for y, x in np.ndindex(SHAPE):
        on, off = float(thresholds.on[y, x]), float(thresholds.off[y, x])
        start, reference = float(before[y, x]), float(state.reference[y, x])
        change = float(after[y, x]) - start + 4.0 * 0.05 * on
        levels = np.arange(reference + on, start + change, on) if change > 0 else []
        levels = np.arange(reference - off, start + change, -off) if change < 0 else levels
        mine = noise.pixel == y * SHAPE[1] + x
        due = [(int(np.ceil(SPAN_US * (level - start) / change)), change > 0) for level in levels]
        due += [(int(t), bool(p)) for t, p in zip(noise.t_us[mine], noise.positive[mine], strict=True)]
        kept, last = [], NEVER_US
        for t, positive in sorted(due):
            if t - last >= 700:
                kept.append((t, positive))
                last = t
        got = events[(events["y"] == y) & (events["x"] == x)]
        told = [(int(event["t"]) // 1000, bool(event["p"])) for event in got]
        same = [p for _, p in told] == [p for _, p in kept]
        same = same and all(abs(a - b) <= 1 for (a, _), (b, _) in zip(told, kept, strict=True))
        alike += same
    # Rounding to whole microseconds moves an event across the end of a dead time now and then.
    assert alike >= 0.995 * before.size


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_bytes_do_not_depend_on_the_number_of_workers(workers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    generator = np.random.default_rng(15)
    before, after = generator.normal(0, 1, (2, 5 * cores.BAND_ROWS + 3, 40)).astype(np.float32)
    noise = NoiseEvents.draw(9, "left", 7, before.shape, 50.0, SPAN_US)
    monkeypatch.setattr(cores.os, "cpu_count", lambda: 8)
    events, state = run(before, after, noise=noise)
    monkeypatch.setattr(cores.os, "cpu_count", lambda: workers)
    again, other = run(before, after, noise=noise)
    assert again.tobytes() == events.tobytes()
    assert other.reference.tobytes() == state.reference.tobytes()
    assert other.last_us.tobytes() == state.last_us.tobytes()


def test_more_events_than_there_is_room_for_at_first_are_all_kept() -> None:
    """A threshold of 0.01 and a step of 1.5 make 150 events of each pixel."""
    before = np.zeros(SHAPE, np.float32)
    events, _ = run(before, before + np.float32(1.505), thresholds=uniform(0.01, 0.01))
    assert len(events) == 150 * before.size
