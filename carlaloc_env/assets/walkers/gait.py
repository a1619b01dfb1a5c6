"""Human gait: joint angles and joint positions of walking and standing.

Angles: shape of published gait curves (hip, knee, ankle in the sagittal plane), see docs/sensors.md; segment
lengths as shares of stature: Drillis & Contini, in Winter, "Biomechanics and motor control of human
movement".
"""

from functools import lru_cache

import numpy as np

from carlaloc_env.assets.walkers.skeleton import Joints, shoe_sole
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array

_CYCLE = np.arange(0.0, 1.0, 0.1)
_HIP_DEG = np.array([25, 22, 14, 4, -5, -10, -2, 14, 26, 28], dtype=np.float64)
_KNEE_DEG = np.array([4, 15, 16, 9, 4, 8, 38, 62, 52, 20], dtype=np.float64)
_ANKLE_DEG = np.array([0, -4, 3, 7, 10, 6, -20, -8, 1, 1], dtype=np.float64)
THIGH, SHANK, FOOT_HEIGHT, FOOT_LENGTH = 0.245, 0.246, 0.039, 0.152
"""Lengths of the leg as fractions of stature."""
HIP_WIDTH, TRUNK, SHOULDER_WIDTH, UPPER_ARM, FOREARM, HAND = 0.11, 0.288, 0.235, 0.186, 0.146, 0.09
"""Widths and lengths of the upper body as fractions of stature."""


def posture(phase: float, stature_m: float, stride_m: float, *, stoop_deg: float = 3.0) -> Joints:
    """Joint positions of a walker at a phase of the stride, in a frame that moves evenly.

    The foot on the ground moves back by exactly `stride_m` per stride, so that it stands still in
    the world; the lowest point of the soles is z = 0.

    Args:
        phase: Share of the stride since the left heel struck, any real number.
        stature_m: Height of the person [m].
        stride_m: Distance of a whole stride [m].
        stoop_deg: Forward lean of the trunk [deg].
    """
    scale = _amplitude(stature_m, stride_m)
    joints = _figure(phase, stature_m, scale, stoop_deg)
    stance = phase % 0.5
    side = "_l" if phase % 1.0 < 0.5 else "_r"
    strike = _ankle_ahead(0.0, stature_m, scale)
    middle = strike - 0.25 * stride_m
    shift = strike - stride_m * stance - joints["ankle" + side][0] - middle
    return _grounded(joints, shift)


def standing(stature_m: float, *, stoop_deg: float = 2.0) -> Joints:
    """Joint positions of a person who stands still."""
    return _grounded(_figure(0.0, stature_m, 0.0, stoop_deg), 0.0)


@lru_cache(maxsize=64)
def _amplitude(stature_m: float, stride_m: float) -> float:
    """Factor on the leg angles that makes a step half the stride long, by bisection."""
    low, high = 0.2, 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        step = _ankle_ahead(0.0, stature_m, middle) - _ankle_ahead(0.5, stature_m, middle)
        low, high = (middle, high) if step < 0.5 * stride_m else (low, middle)
    return 0.5 * (low + high)


def _angles(phase: float, scale: float) -> tuple[float, float, float]:
    p = phase % 1.0
    hip, knee, ankle = (
        float(np.interp(p, np.append(_CYCLE, 1.0), np.append(table, table[0])))
        for table in (_HIP_DEG, _KNEE_DEG, _ANKLE_DEG)
    )
    knee = 4.0 + (knee - 4.0) * min(scale, 1.1)
    if scale <= 0:
        knee = 2.0
    return np.radians(scale * hip), np.radians(knee), np.radians(ankle * min(scale, 1.0))


def _ankle_ahead(phase: float, stature_m: float, scale: float) -> float:
    hip, knee, _ = _angles(phase, scale)
    return float(stature_m * (THIGH * elementary.sin(hip) + SHANK * elementary.sin(hip - knee)))


def _figure(phase: float, stature_m: float, scale: float, stoop_deg: float) -> Joints:
    """Joints about a pelvis at height zero."""
    h, swing = stature_m, min(scale, 1.2)
    turn = 2 * np.pi * phase
    pelvis_yaw = np.radians(5) * swing * -elementary.cos(turn)
    trunk_yaw = np.radians(6) * swing * elementary.cos(turn)
    sway = 0.02 * swing * elementary.sin(turn)
    lean = elementary.sin(np.radians(stoop_deg))
    joints: Joints = {"pelvis": np.array([0.0, sway, 0.0])}
    joints["chest"] = np.array([0.6 * lean * TRUNK * h, 0.6 * sway, 0.55 * TRUNK * h])
    joints["neck"] = np.array([1.15 * lean * TRUNK * h, 0.4 * sway, 1.02 * TRUNK * h])
    joints["head"] = joints["neck"] + (0.012 * h + 0.3 * lean * h * 0.1, 0.0, 0.080 * h)
    for side, sign, offset in (("_l", 1.0, 0.0), ("_r", -1.0, 0.5)):
        _leg(joints, side, sign, phase + offset, h, scale, pelvis_yaw)
        _arm(joints, side, sign, phase + offset, h, swing, trunk_yaw, lean)
    return joints


def _leg(joints: Joints, side: str, sign: float, phase: float, h: float, scale: float, yaw: float) -> None:
    hip, knee, ankle = _angles(phase, scale)
    half = 0.5 * HIP_WIDTH * h * sign
    joints["hip" + side] = joints["pelvis"] + _turned(half, yaw, -0.02 * h)
    joints["knee" + side] = joints["hip" + side] + THIGH * h * _swung(hip, 0.0)
    shin = hip - knee
    # Hips turn with the pelvis, but the ankle's distance ahead is measured from the pelvis.
    ahead = joints["pelvis"][0] + h * (THIGH * elementary.sin(hip) + SHANK * elementary.sin(shin))
    below = joints["knee" + side][2] - SHANK * h * elementary.cos(shin)
    joints["ankle" + side] = np.array([ahead, 0.9 * half, below])
    tilt = shin + ankle + np.radians(2.0) * (scale > 0)
    drop, length = FOOT_HEIGHT * h, 0.72 * FOOT_LENGTH * h
    joints["toe" + side] = joints["ankle" + side] + (
        length * elementary.cos(tilt) + drop * elementary.sin(tilt),
        0.06 * length * sign,
        length * elementary.sin(tilt) - drop * elementary.cos(tilt),
    )  # fmt: skip


def _arm(
    joints: Joints, side: str, sign: float, phase: float, h: float, swing: float, yaw: float, lean: float
) -> None:
    hip, _, _ = _angles(phase, 1.0)
    forward = (-0.7 * (hip - np.radians(8.0))) * swing
    bend = np.radians(12 + 10 * swing) + np.radians(15.0) * max(0.0, elementary.sin(forward)) * 2
    half = 0.5 * SHOULDER_WIDTH * h * sign
    joints["shoulder" + side] = joints["neck"] + _turned(half, yaw, -0.028 * h)
    joints["elbow" + side] = joints["shoulder" + side] + UPPER_ARM * h * _swung(forward, 0.14 * sign)
    joints["hand" + side] = joints["elbow" + side] + (FOREARM + HAND) * h * _swung(
        forward + bend, 0.03 * sign
    )


def _turned(half_m: float, yaw: float, up_m: float) -> Array:
    """Offset of a hip or shoulder from the spine [m], turned with the trunk."""
    return np.array([-half_m * elementary.sin(yaw), half_m * elementary.cos(yaw), up_m])


def _swung(angle: float, outward: float) -> Array:
    """Direction of a limb that swings ahead by an angle from hanging down."""
    return np.array([elementary.sin(angle), outward, -elementary.cos(angle)])


def _grounded(joints: Joints, shift_m: float) -> Joints:
    soles = [p[2] for side in ("_l", "_r") for p in shoe_sole(joints["ankle" + side], joints["toe" + side])]
    move = np.array([shift_m, 0.0, -min(soles)])
    return {name: point + move for name, point in joints.items()}
