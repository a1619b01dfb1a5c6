"""The rule that tells a failed estimate."""

import numpy as np
import pytest

from recorder.evaluation.align import Alignment
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.fail_rule import FailRule, standing_error_m
from recorder.evaluation.trajectory import Trajectory


def circle(count: int = 400, radius_m: float = 10.0) -> Trajectory:
    a = np.arange(count) * 2 * np.pi / count
    return Trajectory(
        stamp_ns=np.arange(count, dtype=np.int64) * 50_000_000,
        position_m=np.stack([radius_m * np.cos(a), radius_m * np.sin(a), 0 * a], axis=1),
        quat_xyzw=np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)),
        name="circle",
    )


def test_a_standing_estimate_is_as_far_off_as_the_circle_is_wide() -> None:
    truth = circle()
    result = evaluate(truth, truth, alignment=Alignment.NONE)
    assert standing_error_m(result) == pytest.approx(10.0, abs=1e-12)
    assert FailRule().why_failed(result) is None


def test_an_estimate_that_runs_the_other_way_round_has_diverged() -> None:
    truth = circle()
    back = Trajectory(
        stamp_ns=truth.stamp_ns,
        position_m=truth.position_m * [-1, -1, 1],
        quat_xyzw=truth.quat_xyzw,
        name="b",
    )
    why = FailRule().why_failed(evaluate(truth, back, alignment=Alignment.NONE))
    assert why is not None
    assert "diverged: APE 20.00 m, an estimate that never moves has 10.00 m" in why


@pytest.mark.parametrize(("kept", "fails"), [(0.79, True), (0.81, False)])
def test_coverage(kept: float, fails: bool) -> None:
    truth = circle()
    part = truth.take(np.arange(int(400 * (1 - kept)), 400))
    why = FailRule().why_failed(evaluate(truth, part, expected=400))
    assert (why is not None) is fails


@pytest.mark.parametrize(("off_m", "fails"), [(0.09, False), (0.11, True)])
def test_an_estimate_of_a_car_at_a_red_light_fails_only_when_it_leaves(off_m: float, fails: bool) -> None:
    truth = circle(radius_m=0.0)
    aside = circle(radius_m=off_m)
    assert standing_error_m(evaluate(truth, truth, alignment=Alignment.NONE)) == 0.0
    assert (FailRule().why_failed(evaluate(truth, aside, alignment=Alignment.NONE)) is not None) is fails
