"""Scores the estimates of several robots together: one fit for all, each alone, and between robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.align import Alignment, Similarity, align
from recorder.evaluation.associate import MAX_GAP_NS, Association, associate
from recorder.evaluation.metrics import Metric, Statistics, errors
from recorder.evaluation.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class TogetherResult:
    """Errors of several robots' estimates in one world; positions [m], angles [deg]."""

    names: tuple[str, ...]
    """Name of each estimate."""
    alignment: Alignment
    """Fit over all pairs of all robots, and over each robot's own."""
    transform: Similarity
    """The shared fit."""
    joint: Statistics
    """Position errors of all robots after the shared fit: of the common map."""
    joint_of: tuple[Statistics, ...]
    """The same of each robot."""
    alone: tuple[Statistics, ...]
    """Of each robot after a fit for it alone: of its odometry and the closures within its path."""
    between_m: Mapping[tuple[int, int], Statistics]
    """Errors of the position of robot b in the frame of robot a at equal times, no fit needed."""
    between_deg: Mapping[tuple[int, int], Statistics]
    """Errors of its attitude there."""

    def to_mapping(self) -> dict[str, Any]:
        """The result as JSON values."""
        robots = zip(self.names, self.joint_of, self.alone, strict=True)
        return {
            "alignment": self.alignment.value,
            "joint_m": asdict(self.joint),
            "robots": [
                {"estimate": name, "joint_m": asdict(joint), "alone_m": asdict(alone)}
                for name, joint, alone in robots
            ],
            "between": [
                {
                    "robots": list(pair),
                    "m": asdict(self.between_m[pair]),
                    "deg": asdict(self.between_deg[pair]),
                }
                for pair in self.between_m
            ],
        }


def evaluate_together(
    truths: Sequence[Trajectory],
    estimates: Sequence[Trajectory],
    *,
    alignment: Alignment = Alignment.SE3,
    association: Association = Association.INTERPOLATED,
    max_gap_ns: int = MAX_GAP_NS,
) -> TogetherResult:
    """Errors of robots that drove at the same time; each has its own pair of trajectories.

    Args:
        truths: True poses of each robot, all in one world.
        estimates: Its estimate, all in one world of the system's.
        alignment: Fit before absolute errors are measured, one for all robots.
        association: How poses are paired.
        max_gap_ns: Longest time between two poses of a pair [ns].

    Raises:
        EvaluationError: fewer than two robots, another number of truths, or too few pairs.
    """
    if len(truths) != len(estimates) or len(truths) < 2:
        raise EvaluationError(
            f"{len(estimates)} estimates and {len(truths)} truths; give one truth for each of two or more"
        )
    pairs = [
        associate(*pair, association, max_gap_ns=max_gap_ns) for pair in zip(truths, estimates, strict=True)
    ]
    true, found = (_joined([pair[side] for pair in pairs]) for side in (0, 1))
    transform = align(true, found, alignment)
    values = [_position_errors(true, transform.apply(estimate)) for true, estimate in pairs]
    alone = [_position_errors(true, align(true, found, alignment).apply(found)) for true, found in pairs]
    between = {
        (a, b): between_errors(pairs[a], pairs[b], transform) for a, b in combinations(range(len(pairs)), 2)
    }
    return TogetherResult(
        names=tuple(estimate.name for estimate in estimates),
        alignment=alignment,
        transform=transform,
        joint=Statistics.of(np.concatenate(values)),
        joint_of=tuple(map(Statistics.of, values)),
        alone=tuple(map(Statistics.of, alone)),
        between_m={pair: Statistics.of(found[0]) for pair, found in between.items()},
        between_deg={pair: Statistics.of(found[1]) for pair, found in between.items()},
    )


def between_errors(
    a: tuple[Trajectory, Trajectory], b: tuple[Trajectory, Trajectory], transform: Similarity
) -> tuple[Array, Array]:
    """Errors of T_a(t)⁻¹·T_b(t) [m], [deg] at the stamps of a that b covers.

    Args:
        a: True and estimated poses of one robot, paired.
        b: Those of the other.
        transform: The shared fit, of which its scale counts alone.

    Raises:
        EvaluationError: the two have no time in common.
    """
    first, last = b[0].stamp_ns[0], b[0].stamp_ns[-1]
    rows = np.flatnonzero((a[0].stamp_ns >= first) & (a[0].stamp_ns <= last))
    if not len(rows):
        raise EvaluationError(
            f"'{a[1].name}' and '{b[1].name}' have no time in common; give drives at one time"
        )
    stamps = a[0].stamp_ns[rows]
    true, found = (relative(a[side].take(rows), b[side].at(stamps)) for side in (0, 1))
    found = replace(found, position_m=transform.scale * found.position_m)
    turned = transforms.quat_multiply(transforms.quat_conjugate(true.quat_xyzw), found.quat_xyzw)
    angle: Array = np.degrees(np.linalg.norm(transforms.quat_to_rotvec(turned), axis=1))
    return _position_errors(true, found), angle


def set_out_at(truth: Trajectory, estimate: Trajectory) -> Trajectory:
    """An estimate moved rigidly so that its first pose is the true one at its stamp."""
    true = truth.at(estimate.stamp_ns[:1])
    turn = transforms.quat_multiply(true.quat_xyzw[0], transforms.quat_conjugate(estimate.quat_xyzw[0]))
    R = transforms.quat_to_matrix(turn)
    return Similarity(R=R, t=true.position_m[0] - R @ estimate.position_m[0]).apply(estimate)


def relative(a: Trajectory, b: Trajectory) -> Trajectory:
    """Poses of b in the frame of a, at the stamps that both have."""
    to_a = transforms.quat_conjugate(a.quat_xyzw)
    return replace(
        b,
        position_m=transforms.quat_rotate(to_a, b.position_m - a.position_m),
        quat_xyzw=transforms.quat_multiply(to_a, b.quat_xyzw),
    )


def _position_errors(true: Trajectory, found: Trajectory) -> Array:
    return errors(Metric.APE_TRANSLATION, true, found)


def _joined(parts: Sequence[Trajectory]) -> Trajectory:
    """Poses of all robots for a fit; their stamps are numbers, since robots have equal ones."""
    return replace(
        parts[0],
        stamp_ns=np.arange(sum(map(len, parts))),
        position_m=np.concatenate([part.position_m for part in parts]),
        quat_xyzw=np.concatenate([part.quat_xyzw for part in parts]),
        name=" and ".join(part.name for part in parts),
    )
