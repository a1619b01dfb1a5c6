"""Actor states in fixed point: how far a state moves, and that rounding twice changes nothing."""

import numpy as np
import pytest

from carlaloc_env.timeline.actor_quantisation import decode_actors, encode_actors, on_grid
from carlaloc_env.timeline.actors import ActorFrame


def frame(count: int, extent_m: float) -> ActorFrame:
    rng = np.random.default_rng(3)

    def draw(low: float, high: float, *shape: int) -> np.ndarray:
        return rng.uniform(low, high, shape).astype(np.float32)

    return ActorFrame(
        position_m=draw(-extent_m, extent_m, count, 3),
        heading_rad=draw(-7.0, 7.0, count),
        pitch_rad=draw(-0.3, 0.3, count),
        roll_rad=draw(-0.3, 0.3, count),
        speed_mps=draw(-5.0, 60.0, count),
        travelled_m=draw(0.0, 20_000.0, count),
        steer_rad=draw(-0.7, 0.7, count),
        lights=rng.integers(0, 32, count, dtype=np.uint8),
    )


@pytest.mark.parametrize("extent_m", [100.0, 4000.0])
def test_rounding_stays_within_half_a_step(extent_m: float) -> None:
    exact = frame(2000, extent_m)
    near = on_grid(exact)
    assert np.abs(near.position_m - exact.position_m).max() <= 0.5 / 2048 + 1e-9
    turn = near.heading_rad.astype(np.float64) - exact.heading_rad
    assert np.abs(np.exp(1j * turn) - 1.0).max() <= np.pi / 65536 + 1e-6
    assert np.abs(near.heading_rad).max() <= np.pi + 1e-6
    assert np.abs(near.pitch_rad - exact.pitch_rad).max() <= np.pi / 65536 + 1e-7
    assert np.abs(near.roll_rad - exact.roll_rad).max() <= np.pi / 65536 + 1e-7
    assert np.abs(near.speed_mps - exact.speed_mps).max() <= 0.5 / 256
    assert np.abs(near.travelled_m - exact.travelled_m).max() <= 0.5 / 256
    assert near.lights.tolist() == exact.lights.tolist()


def test_rounding_twice_changes_nothing() -> None:
    once = encode_actors(frame(2000, 4000.0))
    twice = encode_actors(decode_actors(once))
    for name in once.__slots__:
        assert np.array_equal(getattr(once, name), getattr(twice, name)), name


@pytest.mark.parametrize("extent_m", [100.0, 4000.0])
def test_rounding_at_once_is_coding_and_decoding(extent_m: float) -> None:
    """Also for speeds beyond the codes, and angles at the wrap."""
    exact = frame(2000, extent_m)
    exact.speed_mps[:4] = 127.9, 129.0, -128.5, 1e4
    exact.heading_rad[:4] = np.pi, -np.pi, 3.0 * np.pi, -0.0
    exact.position_m[0] = -1e-9
    one, other = on_grid(exact), decode_actors(encode_actors(exact))
    for name in one.__slots__:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
