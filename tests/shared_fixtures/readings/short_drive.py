"""A trajectory of six seconds, and what makes another one the same."""

import numpy as np

from carlaloc_env.core import transforms
from recorder.evaluation.trajectory import Trajectory

EPOCH_NS = 1_672_531_200_000_000_000


def drive(count: int = 60, step_ns: int = 100_000_000) -> Trajectory:
    """A bend over a hill, 10 Hz."""
    angle = np.linspace(0.0, 1.2, count)
    return Trajectory(
        stamp_ns=EPOCH_NS + np.arange(count, dtype=np.int64) * step_ns,
        position_m=np.stack([20 * np.sin(angle), 20 - 20 * np.cos(angle), np.sin(3 * angle)], axis=-1),
        quat_xyzw=transforms.rpy_to_quat(0.02 * angle, -0.1 * np.cos(3 * angle), angle),
        name="drive",
    )


def assert_same(read: Trajectory, true: Trajectory, *, atol: float = 1e-9) -> None:
    """Equal stamps; positions [m] and attitudes equal to rounding."""
    assert read.stamp_ns.tolist() == true.stamp_ns.tolist()
    np.testing.assert_allclose(read.position_m, true.position_m, atol=atol)
    turn = np.abs(np.sum(read.quat_xyzw * true.quat_xyzw, axis=1))
    np.testing.assert_allclose(turn, 1.0, atol=atol)
