"""The signal of event pixels along the true motion: edges, a wall, a pole that passes in front."""

from itertools import product

import numpy as np
import pytest
from shared_fixtures.readings.event_pixels import PINHOLE, plane_motion, run, sums, uniform

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation
from carlaloc_env.sensors.event_camera.motion_sampling import new_track, sample_signal
from carlaloc_env.sensors.event_camera.tile_survey import (
    CHUNK,
    Fields,
    Pictures,
    Tile,
    new_notes,
    survey,
    tile_ranges,
)
from carlaloc_env.sensors.imaging.frame_motion import FrameMotion, passing_surfaces
from carlaloc_env.sensors.imaging.motion_field import ScenePoses, motion_field


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
    events, _ = run(before, after, motion, thresholds=uniform(0.45, 0.45, before.shape))
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


def _wall(depth_m: float) -> F32:
    """A wall with a texture of waves, from a distance."""
    generator = np.random.default_rng(11)
    waves = generator.uniform(2, 6, (12, 2)), generator.uniform(0, 6.28, 12)
    v, u = np.mgrid[: PINHOLE.height_px, : PINHOLE.width_px]
    x, y = (u - PINHOLE.cx_px) / PINHOLE.fx_px * depth_m, (v - PINHOLE.cy_px) / PINHOLE.fy_px * depth_m
    return sum(np.sin(a * x + b * y + c) for (a, b), c in zip(*waves, strict=True)).astype(np.float32)


def test_approach_to_a_wall_samples_the_texture_along_its_motion() -> None:
    """Sum of events between two pictures of a moving texture equals the change, within a threshold."""
    motion, _ = plane_motion(12.0, 4.0, ahead=True)
    before, after = _wall(4.0), _wall(3.4)
    events, state = run(before, after, motion, thresholds=uniform(0.3, 0.3, before.shape))
    error = after - before - sums(events, before.shape, 0.3, 0.3)
    assert np.abs(error).max() < 0.3 + 1e-3
    # Half-way the references must follow the picture half-way, as the true texture there says.
    half = events[events["t"] <= 25_000_000]
    middle = _wall(3.7) - before - sums(half, before.shape, 0.3, 0.3)
    inner = np.abs(middle[12:-12, 12:-12])
    assert np.mean(inner < 0.3 + 0.1) > 0.995
    np.testing.assert_allclose(state.reference, before + sums(events, before.shape, 0.3, 0.3), atol=1e-4)


def _pole() -> tuple[F32, F32, FrameMotion]:
    """A dark pole 5 px wide moves by 60 px before a bright wall that stands still: pictures and motion."""
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
    return values[0], values[1], motion


def test_a_pole_that_sweeps_past_fires_all_along_its_way() -> None:
    """A dark pole 5 px wide moves by 60 px before a bright wall that stands still."""
    before, after, motion = _pole()
    events, _ = run(before, after, motion, thresholds=uniform(0.5, 0.5, before.shape))
    for x in range(56, 104):
        mine = events[events["x"] == x]
        dark, bright = mine[mine["p"] == 0], mine[mine["p"] == 1]
        assert len(dark) >= 3 * PINHOLE.height_px
        assert len(bright) >= 3 * PINHOLE.height_px
        # Its right edge arrives, its left edge leaves 5 px later.
        assert np.median(dark["t"]) / 50e6 == pytest.approx((x - 52.5) / 60, abs=0.025)
        assert np.median(bright["t"]) / 50e6 == pytest.approx((x - 47.5) / 60, abs=0.025)


@pytest.mark.parametrize("scene", ["wall", "pole"])
def test_no_sample_lies_beyond_what_its_tile_can_meet(scene: str) -> None:
    """Pixels whose thresholds lie beyond the bounds of a chunk are passed over: bounds must hold."""
    generator = np.random.default_rng(16)
    if scene == "wall":
        motion, before, after = plane_motion(12.0, 4.0, ahead=True)[0], _wall(4.0), _wall(3.4)
    else:
        _, _, motion = _pole()
        before, after = generator.normal(0, 1, (2, PINHOLE.height_px, PINHOLE.width_px)).astype(np.float32)
    pictures = Pictures(before, after, tile_ranges(before), tile_ranges(after))
    fields = Fields(motion.forward, motion.backward, motion.passing)
    notes, track, levels = new_notes(), new_track(), np.zeros(CHUNK + 1, np.float32)
    kinds = set()
    for y0, x0 in product(range(0, PINHOLE.height_px, 16), range(0, PINHOLE.width_px, 8)):
        tile = Tile(y0, x0, y0 + 7, x0 + 7)
        found = survey(pictures, fields, tile, np.float32(1), notes)
        kinds.add((bool(found.smooth), bool(found.crossed)))
        for k in range(-(-found.steps // CHUNK)):
            y, x = y0 + generator.integers(8), x0 + generator.integers(8)
            count = sample_signal(pictures, fields, tile, found, notes, y, x, k, track, levels)
            # Both pictures of the texture differ by errors of interpolation.
            assert levels[1 : count + 1].min() >= notes.bounds[k, 0] - 0.01
            assert levels[1 : count + 1].max() <= notes.bounds[k, 1] + 0.01
    assert kinds == ({(True, False)} if scene == "wall" else {(True, False), (True, True), (False, True)})
