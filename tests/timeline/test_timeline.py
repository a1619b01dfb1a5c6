"""Actors and signals between steps, and the same answers live and loaded."""

import numpy as np
import pytest

from carlaloc_env.core.clock import STEP_NS, STEP_TICKS, TICK_NS
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline

COUNT = 3


def catalog() -> ActorCatalog:
    return ActorCatalog(
        id=(EGO_INSTANCE + 1 + np.arange(COUNT)).astype(np.uint32),
        model=("saloon",) * COUNT,
        tag=np.full(COUNT, 14, np.uint8),
        size_m=np.full((COUNT, 3), 2.0, np.float32),
        tint=np.zeros((COUNT, 3), np.uint8),
    )


def frame(step: int) -> ActorFrame:
    """Actor 0 drives east at 15 m/s, actor 1 turns through north-south at 2 rad/s, actor 2 stands."""
    t = 0.05 * step
    heading = np.array([0.0, np.arctan2(np.sin(3.0 + 2 * t), np.cos(3.0 + 2 * t)), 1.0], np.float32)
    zero = np.zeros(COUNT, np.float32)
    return ActorFrame(
        position_m=np.array([[15 * t, 2, 0], [5, 5, t], [7, 7, 7]], np.float32),
        heading_rad=heading,
        pitch_rad=np.array([0.1 * t, 0, 0], np.float32),
        speed_mps=np.array([15, 0, 0], np.float32),
        travelled_m=np.array([15 * t, 0, 0], np.float32),
        steer_rad=zero,
        lights=np.full(COUNT, step % 7, np.uint8),
        roll_rad=np.array([0, 0.1 - 0.2 * t, 0.05], np.float32),
    )


def drive(steps: int) -> Timeline:
    ticks = steps * STEP_TICKS + 2
    ego = EgoTrack.from_arrays(
        np.stack([0.05 * np.arange(ticks), np.zeros(ticks), np.zeros(ticks)], axis=-1),
        np.tile([0.0, 0, 0, 1], (ticks, 1)),
    )
    timeline = Timeline(catalog(), ego=ego)
    for step in range(steps + 1):
        timeline.append_step(frame(step), np.array([step // 5, 1], np.uint8))
    return timeline


def test_actors_move_linearly_between_steps() -> None:
    state = drive(20).actors_at(7 * STEP_NS + STEP_NS // 4)
    assert np.allclose(state.position_m[0], [15 * 0.05 * 7.25, 2, 0], atol=1e-5)
    assert state.travelled_m[0] == pytest.approx(15 * 0.05 * 7.25, abs=1e-5)


def test_headings_turn_the_short_way_round() -> None:
    """Across ±180° a plain mean would spin the car by half a turn."""
    timeline = drive(20)
    stamps = np.arange(0, 20 * STEP_NS, STEP_NS // 8)
    heading = timeline.actor_poses(1, stamps).heading_rad
    expected = 3.0 + 2 * stamps * 1e-9
    assert np.abs(np.angle(np.exp(1j * (heading - expected)))).max() < 1e-5
    single = [timeline.actors_at(int(s)).heading_rad[1] for s in stamps]
    assert np.abs(np.angle(np.exp(1j * (np.array(single) - expected)))).max() < 1e-5


def test_many_actors_at_once_equal_one_at_a_time() -> None:
    timeline = drive(20)
    stamps = np.arange(0, 20 * STEP_NS, 3_333_333)
    for index in range(COUNT):
        one = timeline.actor_poses(index, stamps)
        many = timeline.actor_poses(np.full(len(stamps), index), stamps)
        for i in range(0, len(stamps), 17):
            alone = timeline.actor_poses(index, stamps[i : i + 1])
            for a, b, c in zip(one, many, alone, strict=True):
                assert a[i].tobytes() == b[i].tobytes() == c[0].tobytes()


def test_signals_hold_until_the_next_step() -> None:
    timeline = drive(20)
    assert timeline.signals_at(5 * STEP_NS - 1)[0] == 0
    assert timeline.signals_at(5 * STEP_NS)[0] == 1


def test_live_timeline_equals_the_loaded_one() -> None:
    """Forgetting the past never changes an answer about the present."""
    whole = drive(60)
    live = Timeline(catalog())
    for tick in range(2):
        live.ego.append(whole.ego.position_m[tick], whole.ego.quat_xyzw[tick])
    for step in range(61):
        live.append_step(frame(step), np.array([step // 5, 1], np.uint8))
        if step:
            for tick in range((step - 1) * STEP_TICKS + 2, step * STEP_TICKS + 2):
                live.ego.append(whole.ego.position_m[tick], whole.ego.quat_xyzw[tick])
        assert live.end_ns == step * STEP_NS
        live.forget_before((step - 2) * STEP_NS)
        begin = max(step - 2, 0) * STEP_NS
        assert live.start_ns <= begin
        stamps = np.arange(begin, live.end_ns + 1, 5_000_000 - 1)
        assert live.ego_motion(stamps).position_m.tobytes() == whole.ego_motion(stamps).position_m.tobytes()
        for stamp in stamps:
            a, b = live.actors_at(int(stamp)), whole.actors_at(int(stamp))
            assert all(getattr(a, n).tobytes() == getattr(b, n).tobytes() for n in ActorFrame.__slots__)
        for a, b in zip(live.actor_poses(1, stamps), whole.actor_poses(1, stamps), strict=True):
            assert a.tobytes() == b.tobytes()


def test_chosen_actors_keep_the_ego() -> None:
    """The static twin of a drive has the same ego, by identity."""
    timeline = drive(10)
    some = timeline.select_actors(np.array([2]))
    assert some.ego is timeline.ego
    assert some.catalog.id.tolist() == [EGO_INSTANCE + 3]
    assert np.allclose(some.actors_at(STEP_NS).position_m, [[7, 7, 7]])
    assert len(timeline.select_actors(np.zeros(0, np.intp)).actors_at(STEP_NS)) == 0


def test_times_outside_and_wrong_frames_are_refused() -> None:
    timeline = drive(10)
    with pytest.raises(ValueError, match="outside"):
        timeline.actors_at(11 * STEP_NS)
    with pytest.raises(ValueError, match="catalogue"):
        timeline.append_step(frame(0).take(np.array([0])), np.zeros(2, np.uint8))
    assert timeline.end_ns == 10 * STEP_NS
    assert timeline.ego.end_ns == 10 * STEP_TICKS * TICK_NS
