"""The ego is among others: it meets, follows and is passed, and gets on all the same, without a fault."""

from pathlib import Path

import numpy as np
import pytest

from recorder.drive.record import RecordConfig, record
from recorder.episode.actor_messages import actor_states
from recorder.episode.episode import Episode
from recorder.episode.summary import summarise
from recorder.factory import STANDARD_SEEDS

pytest.importorskip("pybullet", reason="the ego drives in PyBullet")


def driven(out: Path, town: str, seed: int, duration_s: float | None = None) -> tuple[float, float, float]:
    """Length of a sound drive [m], and the mean number of moving actors within 50 m and within 25 m."""
    record(RecordConfig(map=town, out=out, seed=seed, duration_s=duration_s))
    episode = Episode.load(out)
    others = actor_states(episode.steps)
    away = others.position_m - episode.ego_at_steps["position_m"][:, None]
    distance_m = np.hypot(away[..., 0], away[..., 1])
    # Actors farther above or below are on another road.
    moving = (np.abs(away[..., 2]) < 8.0) & (others.speed_mps > 0.5)
    summary = summarise(episode)
    assert (summary.collisions, summary.violations) == (0, {})
    near = [float((moving & (distance_m < reach_m)).sum(axis=1).mean()) for reach_m in (50.0, 25.0)]
    return summary.driven_m, near[0], near[1]


def test_a_stretch_among_others(tmp_path: Path) -> None:
    """The first 40 s of the standard drive."""
    driven_m, within_50, _ = driven(tmp_path / "a.mcap", "Town03", STANDARD_SEEDS["Town03"], duration_s=40.0)
    assert within_50 >= 4.5
    assert driven_m > 120.0


@pytest.mark.soak
@pytest.mark.timeout(7200)
def test_whole_routes_among_others(tmp_path: Path) -> None:
    """Ten drives in each of three towns: ten actors move within 50 m and four within 25 m on the mean."""
    drives = [
        driven(tmp_path / f"{town}_{seed}.mcap", town, seed)
        for town in ("Town03", "Town05", "Town10")
        for seed in range(10)
    ]
    _, within_50, within_25 = np.mean(drives, axis=0)
    assert within_50 >= 10.0
    assert within_25 >= 4.0


@pytest.mark.soak
def test_a_junction_comes_loose_again(tmp_path: Path) -> None:
    """Three who wait for each other: one merges before the ego, which stands and has the right of way."""
    assert driven(tmp_path / "a.mcap", "Town07", seed=4, duration_s=250.0)[0] > 740.0
