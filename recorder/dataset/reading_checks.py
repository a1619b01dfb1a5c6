"""Finds faults of stamps and of inertial readings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from recorder.bags.reader import open_bag
from recorder.dataset.bag_messages import Stamps, imu_sample, messages
from recorder.dataset.readings import ImuSample
from recorder.evaluation.trajectory import Trajectory

WINDOW_S = 0.5
"""Time over which the IMU is integrated [s]."""
FORCE_MPS2, RATE_RADPS = 0.3, 0.02
"""Largest mean error of acceleration [m/s²] and angular rate [rad/s]; biases are smaller."""
_G_MPS2, _IMU_MAX = 9.81, 4000
"""Gravity, and messages of a foreign IMU that are looked at."""


def check_gaps(name: str, stamps_ns: Stamps) -> Iterator[str]:
    """Gaps between messages, and stamps that do not rise."""
    steps = np.diff(stamps_ns)
    if len(steps) < 2:
        return
    period = int(np.median(steps))
    if period <= 0 or steps.min() <= 0:
        yield f"{name}: stamps do not rise"
        return
    wide = np.flatnonzero(steps > 1.5 * period)
    if len(wide):
        first = stamps_ns[wide[0]]
        yield f"{name} has {len(wide)} gaps, the first of {steps[wide[0]] / 1e9:.3f} s after {first} ns"


def imu_faults(samples: Iterable[ImuSample], T_base_imu: Array, truth: Trajectory) -> Iterator[str]:
    """Faults of an IMU's values, which are integrated beside the true motion.

    Args:
        samples: All samples.
        T_base_imu: Maps coordinates of the IMU to those of the truth's body, shape (4, 4).
        truth: Motion of that body.
    """
    samples = list(samples)
    stamps = np.array([sample.stamp_ns for sample in samples], np.int64)
    if np.any(np.diff(stamps) <= 0):
        yield "IMU: stamps do not rise"
        return
    if len(samples) < 20:
        return
    base = truth.at(stamps)
    imu = base.of_sensor(T_base_imu)
    force = transforms.quat_rotate(imu.quat_xyzw, np.array([one.acceleration_mps2 for one in samples]))
    rate = np.array([T_base_imu[:3, :3] @ one.angular_velocity_radps for one in samples])
    period_s = float(np.median(np.diff(stamps))) / 1e9
    step = max(2, round(WINDOW_S / period_s))
    velocity = np.gradient(imu.position_m, period_s, axis=0)
    turns = transforms.quat_multiply(transforms.quat_conjugate(base.quat_xyzw[:-1]), base.quat_xyzw[1:])
    true_rate = 2.0 * turns[:, :3] * np.sign(turns[:, 3:4]) / period_s
    force_error, rate_error = [], []
    for begin in range(1, len(samples) - step - 1, step):
        window = slice(begin, begin + step)
        change = (velocity[begin + step] - velocity[begin]) / (step * period_s)
        kinematic = force[window].mean(axis=0) - [0.0, 0.0, _G_MPS2]
        force_error.append(float(np.linalg.norm(kinematic - change)))
        rate_error.append(float(np.linalg.norm((rate[window] - true_rate[window]).mean(axis=0))))
    if force_error and (off := np.median(force_error)) > FORCE_MPS2:
        cause = f" ({why})" if (why := gravity_fault(force)) else ""
        yield f"IMU does not fit the truth: accelerations are {off:.2f} m/s² off{cause}"
    if rate_error and (off := np.median(rate_error)) > RATE_RADPS:
        yield f"IMU does not fit the truth: angular rates are {off:.3f} rad/s off"


def gravity_fault(force_mps2: Array) -> str | None:
    """Wrong unit or sign of specific forces in axes of which z points up, shape (N, 3); None: none."""
    mean = force_mps2.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if 0.8 < size < 1.2:
        return "they are in g, not in m/s²"
    if size < 0.5:
        return "they lack gravity"
    if mean[2] < -0.8 * _G_MPS2:
        return "gravity has the wrong sign: at rest, an axis that points up measures +9.81 m/s²"
    return None


def faults_of_foreign(bag: Path) -> Iterator[str]:
    """Faults of the inertial messages at the beginning of any bag: stamps, unit and sign of gravity.

    Raises:
        EvaluationError: the bag is missing or damaged.
    """
    with open_bag(bag) as reader:
        topics = {c.topic for c in reader.connections if c.msgtype == "sensor_msgs/msg/Imu" and c.msgcount}
    for topic in sorted(topics):
        samples = [imu_sample(message) for message in islice(messages(bag, topic), _IMU_MAX)]
        yield from check_gaps(topic, np.array([sample.stamp_ns for sample in samples], np.int64))
        if why := gravity_fault(np.array([sample.acceleration_mps2 for sample in samples])):
            yield f"accelerations of {topic} look wrong, if its z axis points up: {why}"
