"""Event pixels against closed forms: ramps, edges, sums, dead times, noise."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from llvmlite import binding  # type: ignore[import-untyped]

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation
from carlaloc_env.samples import EVENT, Events
from carlaloc_env.sensors.event_camera.chunk_sampling import ANYWHERE, FOUR_ROWS, THREE_ROWS, follow, travel
from carlaloc_env.sensors.event_camera.edge_search import ROWS
from carlaloc_env.sensors.event_camera.pixels import (
    NEVER_US,
    Pixels,
    PixelState,
    Shots,
    fire,
    limit_rate,
    log_intensity,
)
from carlaloc_env.sensors.event_camera.simd import LANES
from carlaloc_env.sensors.event_camera.simd_state import BEGIN, DX, DY, END, GROWS, LEVELS, MORE, X, Y
from carlaloc_env.sensors.imaging.frame_motion import FrameMotion
from carlaloc_env.sensors.imaging.motion_field import ScenePoses, motion_field
from carlaloc_env.sensors.imaging.occluders import passing_surfaces

SHAPE = (32, 48)
SPAN_US = 50_000
SILENT = Shots.draw(1, "x", 0, SHAPE, 0.0, SPAN_US)
PINHOLE = Pinhole(width_px=192, height_px=96, fx_px=120.0, fy_px=120.0, cx_px=96.0, cy_px=48.0)


def uniform(on: float, off: float, shape: tuple[int, int] = SHAPE) -> Pixels:
    return Pixels(on=np.full(shape, on, np.float32), off=np.full(shape, off, np.float32))


def fresh(level: F32) -> PixelState:
    return PixelState(reference=level.copy(), last_us=np.full(level.shape, NEVER_US, np.int32))


def run(before: F32, after: F32, motion: FrameMotion | None = None, **changes: Any) -> tuple[Any, PixelState]:
    settings: dict[str, Any] = {
        "state": fresh(before),
        "pixels": uniform(0.2, 0.2, before.shape),
        "shots": Shots.draw(1, "x", 0, before.shape, 0.0, SPAN_US),
        "start_ns": 0,
        "span_us": SPAN_US,
        "refractory_us": 0,
        "leak_hz": 0.0,
        **changes,
    }
    state, pixels, shots = (settings.pop(name) for name in ("state", "pixels", "shots"))
    return fire(before, after, motion, state, pixels, shots, **settings)


def sums(events: Any, shape: tuple[int, int], on: Any, off: Any) -> F32:
    """Change of log intensity that the events of each pixel tell."""
    total = np.zeros(shape)
    np.add.at(total, (events["y"], events["x"]), np.where(events["p"] == 1, on, -np.asarray(off)))
    return total.astype(np.float32)


@pytest.mark.parametrize(("slope", "threshold"), [(8.0, 0.2), (-31.0, 0.25), (3.9, 0.05)])
def test_ramp_fires_at_slope_over_threshold(slope: float, threshold: float) -> None:
    """A linear ramp of slope s crosses the k-th threshold at k·C/s."""
    before = np.zeros(SHAPE, np.float32)
    events, _ = run(before, before + np.float32(slope * 0.05), pixels=uniform(threshold, threshold))
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
    pixels = Pixels.draw(3, "left", SHAPE, 0.25, 0.35, 0.03)
    first, state, told = level, fresh(level), np.zeros(SHAPE, np.float32)
    for k in range(12):
        after = (level + generator.normal(0, 0.7, SHAPE)).astype(np.float32)
        events, state = run(level, after, state=state, pixels=pixels, start_ns=k * 50_000_000)
        on, off = pixels.on[events["y"], events["x"]], pixels.off[events["y"], events["x"]]
        told += sums(events, SHAPE, on, off)
        level = after
        error = level - first - told
        assert np.all(error < pixels.on + 1e-4)
        assert np.all(error > -pixels.off - 1e-4)


def test_no_event_within_the_refractory_time() -> None:
    generator = np.random.default_rng(5)
    level = np.zeros(SHAPE, np.float32)
    state, parts = fresh(level), []
    for k in range(4):
        after = generator.normal(0, 2, SHAPE).astype(np.float32)
        shots = Shots.draw(2, "left", k, SHAPE, 200.0, SPAN_US)
        events, state = run(
            level, after, state=state, shots=shots, start_ns=k * 50_000_000, refractory_us=3000
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
    """Leak: positive events only, at its rate. Shots: Poisson, both signs."""
    shape = (60, 80)
    level = np.zeros(shape, np.float32)
    pixels, state, leaked = uniform(0.3, 0.3, shape), fresh(level), 0
    for _ in range(100):
        events, state = run(level, level, state=state, pixels=pixels, leak_hz=1.5)
        assert np.all(events["p"] == 1)
        leaked += len(events)
    assert leaked / level.size == pytest.approx(1.5 * 5.0, abs=1.0)
    shots = Shots.draw(9, "left", 77, shape, 20.0, SPAN_US)
    events, _ = run(level, level, pixels=pixels, shots=shots)
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
    shots = Shots.draw(9, "left", 7, shape, 200.0, SPAN_US)
    noisy, _ = run(before, before, shots=shots)
    got = np.stack([noisy["t"] // 1000, noisy["y"], noisy["x"], noisy["p"]], axis=-1).astype(int)
    width = shape[1]
    want = np.stack([shots.t_us, shots.pixel // width, shots.pixel % width, shots.positive], axis=-1)
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


def test_rate_limit_thins_busy_slots_evenly() -> None:
    events = np.zeros(9000, EVENT)
    events["t"] = np.concatenate([np.linspace(1, 1_000_000, 8000), np.linspace(1_000_001, 2e6, 1000)])
    kept = limit_rate(events, 0, 2e6)
    early = kept["t"] <= 1_000_000
    assert early.sum() == 2000
    assert (~early).sum() == 1000
    assert np.diff(kept["t"][early]).max() < 1100


def test_log_is_the_logarithm_of_luminance_and_dark_current() -> None:
    rgb = np.random.default_rng(8).lognormal(3, 3, (*SHAPE, 3)).astype(np.float32)
    luminance = rgb.astype(np.float64) @ [0.2126, 0.7152, 0.0722]
    value = log_intensity(rgb, 0.05, blurred=False)
    np.testing.assert_allclose(value, np.log(luminance + 0.05), atol=2e-6)


def plane_motion(speed_mps: float, depth_m: float, ahead: bool = False) -> tuple[FrameMotion, float]:
    """A wall across the view while the camera moves sideways (or ahead) for 50 ms; its motion [px]."""
    T = from_rotation(R_FLU_OPTICAL, (0.0, 0.0, 1.6))
    then = T.copy()
    then[0 if ahead else 1, 3] += speed_mps * 0.05
    none = {"actor_id": np.zeros(0, np.uint32), "T_world_actor": np.zeros((0, 4, 4))}
    instants = [
        ScenePoses(stamp_ns=k * 50_000_000, T_world_camera=pose, **none) for k, pose in enumerate((T, then))
    ]
    shape = (PINHOLE.height_px, PINHOLE.width_px)
    ids = np.zeros(shape, np.uint32)
    now = np.full(shape, depth_m, np.float32)
    later = now - np.float32(speed_mps * 0.05 if ahead else 0.0)
    forward = motion_field(PINHOLE, now, ids, *instants)
    backward = motion_field(PINHOLE, later, ids, *instants[::-1])
    motion = FrameMotion(forward=forward, backward=backward, passing=passing_surfaces(forward))
    return motion, PINHOLE.fx_px * speed_mps * 0.05 / depth_m


def test_moving_edge_fires_at_the_time_it_passes_with_the_sign_of_its_step() -> None:
    """A bright right half moves right by 24 px: every pixel it leaves fires negatively, when it does."""
    motion, shift_px = plane_motion(20.0, 5.0)
    assert shift_px == pytest.approx(24.0)
    u = np.arange(PINHOLE.width_px)
    edge_px = 60.5

    def picture(edge: float) -> F32:
        # One pixel wide ramp of height 1.0.
        row = np.clip(u - edge + 0.5, 0.0, 1.0).astype(np.float32)
        return np.tile(row, (PINHOLE.height_px, 1))

    before, after = picture(edge_px), picture(edge_px + shift_px)
    events, _ = run(before, after, motion, pixels=uniform(0.45, 0.45, before.shape))
    assert np.all(events["p"] == 0)
    inside = (events["y"] > 2) & (events["y"] < 93)
    assert events["x"].min() >= 60
    assert events["x"].max() <= 86
    # The level falls by k · 0.45 when the ramp has moved on by as much.
    for k in (1, 2):
        for x in (65, 72, 80):
            mine = events[(events["x"] == x) & inside]
            times = np.sort(mine["t"].reshape(-1, 1) / 1e6, axis=0)
            per_pixel = np.sort(times.reshape(-1)).reshape(2, -1)[k - 1]
            passes_ms = 50.0 * (x + 0.5 - 1 + 0.45 * k - edge_px) / shift_px
            np.testing.assert_allclose(per_pixel, passes_ms, atol=0.5 * 50.0 / shift_px)


def test_approach_to_a_wall_samples_the_texture_along_its_motion() -> None:
    """Sum of events between two pictures of a moving texture equals the change, within a threshold."""
    motion, _ = plane_motion(12.0, 4.0, ahead=True)
    T_texture = np.random.default_rng(11)
    waves = T_texture.uniform(2, 6, (12, 2)), T_texture.uniform(0, 6.28, 12)

    def picture(depth_m: float) -> F32:
        v, u = np.mgrid[: PINHOLE.height_px, : PINHOLE.width_px]
        x, y = (u - PINHOLE.cx_px) / PINHOLE.fx_px * depth_m, (v - PINHOLE.cy_px) / PINHOLE.fy_px * depth_m
        return sum(np.sin(a * x + b * y + c) for (a, b), c in zip(*waves, strict=True)).astype(np.float32)

    before, after = picture(4.0), picture(4.0 - 0.6)
    events, state = run(before, after, motion, pixels=uniform(0.3, 0.3, before.shape))
    error = after - before - sums(events, before.shape, 0.3, 0.3)
    assert np.abs(error).max() < 0.3 + 1e-3
    # Half-way the references must follow the picture half-way, as the true texture there says.
    half = events[events["t"] <= 25_000_000]
    middle = picture(3.7) - before - sums(half, before.shape, 0.3, 0.3)
    inner = np.abs(middle[12:-12, 12:-12])
    assert np.mean(inner < 0.3 + 0.1) > 0.995
    np.testing.assert_allclose(state.reference, before + sums(events, before.shape, 0.3, 0.3), atol=1e-4)


def test_a_pole_that_sweeps_past_fires_all_along_its_way() -> None:
    """A dark pole 5 px wide moves by 60 px before a bright wall that stands still."""
    shape = (PINHOLE.height_px, PINHOLE.width_px)
    u = np.tile(np.arange(shape[1]), (shape[0], 1))
    ids = [(np.abs(u - c) <= 2).astype(np.uint32) * np.uint32((1 << 23) + 5) for c in (50, 110)]
    depths = [np.where(i > 0, np.float32(6.0), np.float32(30.0)) for i in ids]
    values = [np.where(i > 0, np.float32(-1.0), np.float32(1.0)) for i in ids]
    camera = from_rotation(R_FLU_OPTICAL)
    actor = np.stack([np.eye(4)] * 1)
    moved = actor.copy()
    # 60 px at 6 m: 3 m to the right.
    moved[0, 1, 3] -= 3.0
    who = np.array([(1 << 23) + 5], np.uint32)
    instants = [
        ScenePoses(stamp_ns=0, T_world_camera=camera, actor_id=who, T_world_actor=actor),
        ScenePoses(stamp_ns=50_000_000, T_world_camera=camera, actor_id=who, T_world_actor=moved),
    ]
    forward = motion_field(PINHOLE, depths[0], ids[0], *instants)
    backward = motion_field(PINHOLE, depths[1], ids[1], *instants[::-1])
    motion = FrameMotion(forward=forward, backward=backward, passing=passing_surfaces(forward))
    events, _ = run(values[0], values[1], motion, pixels=uniform(0.5, 0.5, shape))
    for x in range(56, 104):
        mine = events[events["x"] == x]
        dark, bright = mine[mine["p"] == 0], mine[mine["p"] == 1]
        assert len(dark) >= 3 * shape[0]
        assert len(bright) >= 3 * shape[0]
        # Its right edge arrives, its left edge leaves 5 px later.
        assert np.median(dark["t"]) / 50e6 == pytest.approx((x - 52.5) / 60, abs=0.025)
        assert np.median(bright["t"]) / 50e6 == pytest.approx((x - 47.5) / 60, abs=0.025)


@pytest.mark.parametrize(("du", "dv"), [(0.3, 0.0), (37.0, 0.0), (-21.5, 13.0), (4.0, -30.0)])
def test_tiles_that_a_surface_passes_over_are_those_that_it_meets(du: float, dv: float) -> None:
    """A near box of 5 × 11 px: all tiles that it sweeps over, and none that are 3 px beside its way."""
    field = np.zeros((96, 192, 4), np.float32)
    field[...] = (0.0, 0.0, 1.0, 50.0)
    y, x = slice(40, 51), slice(90, 95)
    field[y, x] = (du, dv, 1.0, 10.0)
    near = passing_surfaces(field)[..., 3] == 10.0
    met, around = np.zeros((2, *near.shape), bool)
    for share in np.linspace(0, 1, 400):
        for rim, tiles in ((0.5, met), (3.0, around)):
            # Between steps of 4 px at most a slanting way is boxed in.
            left, right = 90 + share * du - rim, 94 + share * du + rim
            top, bottom = 40 + share * dv - rim, 50 + share * dv + rim
            tiles[int(top // 8) : int(bottom // 8) + 1, int(left // 8) : int(right // 8) + 1] = True
    assert met.any()
    assert not (met & ~near).any()
    assert not (near & ~around).any()


def test_sixteen_samples_at_once_are_those_taken_one_by_one() -> None:
    """Bit for bit the bilinear value at each place within the picture, up to its last row and column."""
    generator = np.random.default_rng(12)
    image = generator.normal(0, 2, (40, 70)).astype(np.float32)
    lanes, count = np.zeros(ROWS * LANES, np.float32), 0
    rows = lanes.reshape(ROWS, LANES)
    for _ in range(200):
        x, y = (generator.uniform(0, n, LANES).astype(np.float32) for n in (69, 39))
        dx, dy, more, grows = generator.uniform(-1.5, 1.5, (4, LANES)).astype(np.float32)
        rows[[X, Y, DX, DY, MORE, GROWS]] = x, y, dx, dy, more, grows
        h = np.float32(generator.integers(1, 17))
        _sampled(image.reshape(-1), 70, 40, ANYWHERE, int(h), lanes)
        u, v = x + h * dx, y + h * dy
        inside = (u >= 0) & (u <= 69) & (v >= 0) & (v <= 39)
        count += int(inside.sum())
        expected = _bilinear(image, u, v) + (more + h * grows)
        np.testing.assert_array_equal(rows[LEVELS + int(h)][inside], expected[inside])
    assert count > 1000


def test_rows_that_move_along_with_a_chunk_hold_all_that_it_looks_at() -> None:
    """Bit for bit the bilinear values along the ways of a tile's pixels that grow, lean and move."""
    generator = np.random.default_rng(13)
    image = generator.normal(0, 2, (50, 90)).astype(np.float32)
    lanes, met = np.zeros(ROWS * LANES, np.float32), set()
    rows = lanes.reshape(ROWS, LANES)
    along, down = np.arange(LANES) % 8, np.arange(LANES) // 8
    for _ in range(600):
        (left, right), (top, bottom) = (generator.uniform(0, n, 2) for n in (80, 48))
        size, lean, turn = generator.uniform(0.6, 2.2), *generator.uniform(-0.15, 0.15, 2)
        x, y = size * along + lean * down, size * down + turn * along
        steps = int(generator.integers(1, 17))
        near = np.clip([right - left, bottom - top], -steps, steps)
        rows[BEGIN], rows[BEGIN + 1] = left + x, top + y
        rows[END], rows[END + 1] = left + near[0] + 1.1 * x, top + near[1] + 1.1 * y
        where = _followed(1 / steps, 90, 50, lanes)
        met.add(where)
        _sampled(image.reshape(-1), 90, 50, where, steps, lanes)
        for step in range(1, steps + 1):
            u, v = (rows[at] + np.float32(step) * rows[by] for at, by in ((X, DX), (Y, DY)))
            inside = (u >= 0) & (u <= 89) & (v >= 0) & (v <= 49)
            assert where == ANYWHERE or inside.all()
            expected = _bilinear(image, u, v) + (rows[MORE] + np.float32(step) * rows[GROWS])
            np.testing.assert_array_equal(rows[LEVELS + step][inside], expected[inside])
    wide = binding.get_host_cpu_features().get("avx512f", False)
    assert met == ({ANYWHERE, FOUR_ROWS, THREE_ROWS} if wide else {ANYWHERE})


def test_crossings_told_together_are_those_told_one_by_one() -> None:
    """Where every pixel has a noise event that nothing hears, each event is worked out on its own."""
    generator = np.random.default_rng(14)
    motion, _ = plane_motion(12.0, 4.0, ahead=True)
    before, after = generator.normal(0, 6, (2, PINHOLE.height_px, PINHOLE.width_px)).astype(np.float32)
    pixels = Pixels.draw(3, "left", before.shape, 0.25, 0.35, 0.03)
    unheard = Shots(
        pixel=np.arange(before.size, dtype=np.int32),
        t_us=np.ones(before.size, np.int32),
        positive=np.ones(before.size, bool),
    )
    settings: dict[str, Any] = {"pixels": pixels, "refractory_us": 700}
    state = PixelState(reference=before.copy(), last_us=np.zeros(before.shape, np.int32))
    together, one = run(before, after, motion, state=state, **settings)
    alone, other = run(before, after, motion, state=state, shots=unheard, **settings)
    assert len(together) > 20 * before.size
    for events in (together, alone):
        events.sort(order=("t", "y", "x", "p"))
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(one.reference, other.reference)
    np.testing.assert_array_equal(one.last_us, other.last_us)


def _bilinear(image: F32, x: F32, y: F32) -> F32:
    i = np.clip(x, 0, image.shape[1] - 2).astype(int)
    j = np.clip(y, 0, image.shape[0] - 2).astype(int)
    a, b = x - i.astype(np.float32), y - j.astype(np.float32)
    upper = image[j, i] + a * (image[j, i + 1] - image[j, i])
    lower = image[j + 1, i] + a * (image[j + 1, i + 1] - image[j + 1, i])
    value: F32 = upper + b * (lower - upper)
    return value


@numba.njit
def _sampled(flat: Any, width: int, height: int, where: int, count: int, lanes: Any) -> None:
    travel(flat, np.int32(width), np.int32(height), np.int32(where), np.int32(count + 1), lanes)


@numba.njit
def _followed(share: float, width: int, height: int, lanes: Any) -> Any:
    part, none = np.float32(share), np.float32(0)
    return follow(np.int32(0), part, none, part, np.int32(width), np.int32(height), lanes)


def test_counts_of_an_observation() -> None:
    events = np.array([(5, 3, 1, 1), (6, 3, 1, 1), (7, 0, 0, 0)], EVENT)
    sample = Events(
        sensor="events_left",
        frame_id="camera_left",
        stamp_ns=10,
        events=events,
        width_px=4,
        height_px=2,
        period_ns=50_000_000,
    )
    counts = sample.observed()
    assert counts.shape == (2, 4, 2)
    assert counts[1, 3, 0] == 2
    assert counts[0, 0, 1] == 1
    assert counts.sum() == 3
