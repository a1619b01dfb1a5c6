"""One instant of a drive holds what the timeline answers for that time."""

import pickle

import numpy as np
import pytest
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.core.clock import STEP_NS, STEP_TICKS
from carlaloc_env.core.ego import Controls
from carlaloc_env.timeline.actors import LIGHT_BRAKE
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.snapshot import Snapshot, is_blink
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.timeline.vehicle_track import CarTrack

SPEED_MPS = 10.0


def drive(steps: int = 4) -> Timeline:
    """The ego goes east at 10 m/s and brakes all the while; one actor goes north at 20 m/s."""
    ticks = steps * STEP_TICKS + 2
    x = SPEED_MPS * 0.005 * np.arange(ticks)
    position = np.stack([x, np.zeros(ticks), np.zeros(ticks)], axis=-1)
    car = CarTrack()
    for _ in range(ticks):
        car.append((0.0, 0.0, 0.0, 0.0), 0.0, Controls(brake=0.5))
    ego = EgoTrack.from_arrays(position, np.tile([0.0, 0.0, 0.0, 1.0], (ticks, 1)))
    timeline = Timeline(Scenery.catalog(["saloon"]), ego=ego, car=car)
    for step in range(steps + 1):
        frame = Scenery.frame([[5.0, step, 0.0]], speed_mps=20.0)
        timeline.append_step(frame, np.array([step, 3], np.uint8))
    return timeline


def test_everything_is_of_the_same_instant() -> None:
    """Half way between two steps: both cars half way, signals as at the step before."""
    snapshot = Snapshot.of(drive(), 2 * STEP_NS + STEP_NS // 2)
    np.testing.assert_allclose(snapshot.T_world_base[:3, 3], [2.5 * 0.05 * SPEED_MPS, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(snapshot.ego_velocity_mps, [SPEED_MPS, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(snapshot.actors.position_m, [[5.0, 2.5, 0.0]], atol=1e-6)
    assert snapshot.signals.tolist() == [2, 3]
    assert snapshot.ego_lights == LIGHT_BRAKE
    assert snapshot.ego_headlamps


def test_it_needs_no_timeline_any_more() -> None:
    """The window draws in another process: a copy is as good, and does not hold the whole drive."""
    timeline = drive(200)
    snapshot = Snapshot.of(timeline, STEP_NS)
    data = pickle.dumps(snapshot)
    copy = pickle.loads(data)
    assert len(data) < 4000
    assert np.array_equal(copy.T_world_base, snapshot.T_world_base)
    assert np.array_equal(copy.actors.position_m, snapshot.actors.position_m)


def test_indicators_blink_ninety_times_a_minute() -> None:
    lit = np.array([is_blink(k * 1_000_000) for k in range(60_000)])
    assert np.count_nonzero(lit[1:] & ~lit[:-1]) in (89, 90)
    assert lit.mean() == pytest.approx(0.5, abs=0.01)
