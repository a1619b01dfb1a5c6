"""Pedalling: cranks, pedals and the legs that push them, at any angle of the cranks."""

import numpy as np

from carlaloc_env.assets.primitives import Look, box, tube
from carlaloc_env.assets.walkers.gait import SHANK, THIGH
from carlaloc_env.assets.walkers.skeleton import Joints
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.mesh import Mesh

CRANK_M = 0.17
"""Length of a crank [m]."""
TREAD_M, AXLE_M = 0.10, 0.15
"""Distance of cranks and of pedals' middles from the middle of the cycle [m]."""
FOOT_M = (-0.04, -0.02, 0.11)
"""Ankle from the middle of the pedal below it [m]; y towards the cycle."""


def crank_angle(side: str, turn: float) -> float:
    """Angle of the crank of side `_l` or `_r` [rad]; at 0 it hangs down, and then goes back."""
    return 2 * np.pi * (turn + (0.0 if side == "_l" else 0.5))


def pedal_at(bottom_bracket_m: tuple[float, float, float], side: str, turn: float) -> Array:
    """Middle of a pedal [m], shape (3,)."""
    angle, sign = crank_angle(side, turn), 1.0 if side == "_l" else -1.0
    swing = np.array([-CRANK_M * elementary.sin(angle), AXLE_M * sign, -CRANK_M * elementary.cos(angle)])
    return np.asarray(bottom_bracket_m + swing)


def cranks(metal: Look, dark: Look, bottom_bracket_m: tuple[float, float, float], turn: float) -> list[Mesh]:
    """Both cranks with their pedals, which stay level."""
    parts = []
    for side, sign in (("_l", 1.0), ("_r", -1.0)):
        pedal = pedal_at(bottom_bracket_m, side, turn)
        hub = np.array(bottom_bracket_m) + np.array([0.0, TREAD_M * sign, 0.0])
        end = pedal - (0.0, (AXLE_M - TREAD_M) * sign, 0.0)
        parts += [tube(metal, [hub, end], 0.012, 4), box(dark, (0.09, 0.10, 0.025), pedal)]
    return parts


def push_pedals(
    joints: Joints, bottom_bracket_m: tuple[float, float, float], stature_m: float, turn: float
) -> None:
    """Put the legs of a sitting rider on the pedals.

    Hip, knee and ankle form a triangle of thigh and shank, the knee ahead (law of cosines).
    """
    thigh, shank = THIGH * stature_m, SHANK * stature_m
    for side, sign in (("_l", 1.0), ("_r", -1.0)):
        flip = np.array([1.0, sign, 1.0])
        ankle = pedal_at(bottom_bracket_m, side, turn) + np.array(FOOT_M) * flip
        hip = joints["hip" + side]
        reach = ankle - hip
        far = float(np.hypot(reach[0], reach[2]))
        opening = elementary.arccos(np.clip((thigh**2 + far**2 - shank**2) / (2 * thigh * far), -1.0, 1.0))
        down = elementary.arctan2(reach[0], -reach[2]) + opening
        knee = hip + np.array([thigh * elementary.sin(down), 0.5 * reach[1], -thigh * elementary.cos(down)])
        joints["knee" + side], joints["ankle" + side] = knee, ankle
        joints["toe" + side] = ankle + np.array([0.17, 0.01 * sign, -0.07])
