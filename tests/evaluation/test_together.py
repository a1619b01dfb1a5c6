"""Several robots' estimates together, against closed forms."""

import numpy as np
import pytest

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.align import Similarity
from recorder.evaluation.together import evaluate_together, set_out_at
from recorder.evaluation.trajectory import Trajectory

STAMPS = np.arange(0, 60) * 100_000_000


def path(name: str, shift_m: Array, bend: float) -> Trajectory:
    """A path that bends and climbs, its attitude along it."""
    t = STAMPS * 1e-9
    heading = bend * t
    position = np.stack([10.0 * np.sin(heading) / bend, 10.0 * (1 - np.cos(heading)) / bend, 0.2 * t], axis=1)
    quat = transforms.rpy_to_quat(0.02 * t, -0.01 * t, heading)
    return Trajectory(stamp_ns=STAMPS, position_m=position + shift_m, quat_xyzw=quat, name=name)


TRUTHS = [path("a", np.zeros(3), 0.2), path("b", np.array([5.0, -3.0, 0.5]), -0.15)]
WORLD = Similarity(
    R=transforms.quat_to_matrix(transforms.rpy_to_quat(0.0, 0.0, 0.7)), t=np.array([40.0, 2.0, 1.0])
)


def test_a_common_world_leaves_no_error() -> None:
    """Robots in one world that is turned and shifted as a whole: all errors are 0."""
    found = evaluate_together(TRUTHS, [WORLD.apply(truth) for truth in TRUTHS])
    assert found.joint.max < 1e-9
    assert found.between_m[0, 1].max < 1e-9
    assert found.between_deg[0, 1].max < 1e-5


def test_a_wrong_common_frame_shows_between_robots_and_not_alone() -> None:
    """The second robot's map shifted by 3 m: alone it is perfect, seen from the first it is 3 m off.

    With n poses each, the shared fit of equal sets leaves half of the shift to each robot, less what its
    rotation takes.
    """
    shift = Similarity(R=np.eye(3), t=np.array([0.0, 0.0, 3.0]))
    found = evaluate_together(TRUTHS, [TRUTHS[0], shift.apply(TRUTHS[1])])
    assert [one.max for one in found.alone] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert found.between_m[0, 1].rmse == pytest.approx(3.0, abs=1e-9)
    assert found.between_deg[0, 1].max < 1e-5
    assert 0.2 < found.joint.rmse <= 1.5 + 1e-9


def test_a_turn_between_maps_is_the_angle_between_robots() -> None:
    """The second robot's attitudes turned by 5 degrees about the vertical of its own body."""
    turn = transforms.rpy_to_quat(0.0, 0.0, np.radians(5.0))
    turned = Trajectory(
        stamp_ns=STAMPS, position_m=TRUTHS[1].position_m,
        quat_xyzw=transforms.quat_multiply(TRUTHS[1].quat_xyzw, turn), name="b",
    )  # fmt: skip
    found = evaluate_together(TRUTHS, [TRUTHS[0], turned])
    assert found.between_deg[0, 1].rmse == pytest.approx(5.0, abs=1e-6)
    assert found.between_m[0, 1].max < 1e-9


def test_estimates_are_set_out_at_true_starts() -> None:
    """A path that begins at its own zero lies on the true one afterwards."""
    own = Similarity(R=WORLD.R.T, t=-WORLD.R.T @ WORLD.t).apply(TRUTHS[1])
    np.testing.assert_allclose(set_out_at(TRUTHS[1], own).position_m, TRUTHS[1].position_m, atol=1e-9)


def test_robots_without_partners_are_refused() -> None:
    """One robot, or another number of truths, or no time in common."""
    with pytest.raises(EvaluationError, match="one truth for each of two or more"):
        evaluate_together(TRUTHS[:1], TRUTHS[:1])
    with pytest.raises(EvaluationError, match="one truth for each of two or more"):
        evaluate_together(TRUTHS, TRUTHS[:1])
    late = [TRUTHS[0], TRUTHS[1].shifted(10**12)]
    with pytest.raises(EvaluationError, match="no time in common"):
        evaluate_together(late, late)
