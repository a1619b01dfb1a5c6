"""`carlaloc replay --noise-seeds`: as many replays that differ in the seed of sensor noise alone."""

from dataclasses import replace
from pathlib import Path

from recorder.cli.commands.replay import _of_noise_seeds
from recorder.replaying.options import ReplayConfig

CONFIG = ReplayConfig(episode=Path("drive.mcap"), out=Path("data"), seed=5)


def test_only_the_seed_and_the_folder_differ() -> None:
    found = _of_noise_seeds(CONFIG, 3)
    assert [(c.seed, c.out) for c in found] == [(s, Path("data", f"seed{s}")) for s in (5, 6, 7)]
    assert {replace(c, seed=0, out=Path("x")) for c in found} == {replace(CONFIG, seed=0, out=Path("x"))}


def test_one_seed_is_a_replay_as_ever() -> None:
    assert _of_noise_seeds(CONFIG, 1) == [CONFIG]
