"""Human gait and pedalling: bones, joint angles and joint positions.

Angles: shape of published gait curves (hip, knee, ankle in the sagittal plane), see docs/sensors.md;
segment lengths as shares of stature: Drillis & Contini, in Winter, "Biomechanics and motor control
of human movement".

Bones of a figure: frames on its joints, and a skin that follows them.

Pedalling: cranks, pedals and the legs that push them, at any angle of the cranks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.assets.primitives import Look, box, tube
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import cross
from carlaloc_env.scene.mesh import Mesh

Joints = dict[str, Array]
"""Positions [m] of pelvis, chest, neck, head and, with suffix _l and _r, shoulder, elbow, hand, hip,
knee, ankle, toe."""

BONES = (
    "pelvis", "chest", "head", "arm_l", "arm_r", "fore_l", "fore_r", "thigh_l", "thigh_r", "shank_l",
    "shank_r", "foot_l", "foot_r",
)  # fmt: skip
"""Bones by index."""
_ENDS = {
    "pelvis": ("pelvis", "chest"), "chest": ("chest", "neck"), "head": ("neck", "head"),
    "arm": ("shoulder", "elbow"), "fore": ("elbow", "hand"), "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"), "foot": ("ankle", "toe"),
}  # fmt: skip
"""Joints at which each bone begins and ends."""
_RIGID = ("head", "foot_l", "foot_r")
"""Bones that never stretch."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """A mesh in the posture of rest, each vertex hung on two bones."""

    mesh: Mesh
    bones: NDArray[np.intp]
    """Indices in `BONES`, shape (V, 2)."""
    weight: Array
    """Weight of the first bone, shape (V,)."""
    rest: Joints

    def posed(self, joints: Joints) -> Mesh:
        """The mesh in another posture: linear blending of the two bones' motions.

        Bones stretch to the distance of their joints, so that riders of other proportions fit.
        """
        return self.posed_all([joints])[0]

    def posed_all(self, postures: Sequence[Joints]) -> list[Mesh]:
        """The mesh in many postures at once."""
        stacked = {name: np.array([p[name] for p in postures]) for name in self.rest}
        moves = [_motion(self.rest, stacked, bone) for bone in BONES]
        linear, shift = (np.stack([move[k] for move in moves], axis=1) for k in (0, 1))
        first, second = self.bones.T
        w = self.weight[:, None]
        A = w[..., None] * linear[:, first] + (1 - w[..., None]) * linear[:, second]
        b = w * shift[:, first] + (1 - w) * shift[:, second]
        # Written out without BLAS, so that a model has the same bits on every machine.
        vertices = np.sum(A * self.mesh.vertices_m[:, None, :], axis=3) + b
        normals = np.sum(A * self.mesh.normals[:, None, :], axis=3)
        normals /= np.maximum(np.sqrt(np.sum(normals**2, axis=2, keepdims=True)), 1e-9)
        return [
            replace(self.mesh, vertices_m=v, normals=n)
            for v, n in zip(vertices.astype(np.float32), normals.astype(np.float32), strict=True)
        ]


def _motion(rest: Joints, posed: Joints, bone: str) -> tuple[Array, Array]:
    """Linear parts (P, 3, 3) and shifts (P, 3) from the posture of rest to P other ones."""
    R0, at0, length0 = _frame({name: at[None] for name, at in rest.items()}, bone)
    R1, at1, length1 = _frame(posed, bone)
    stretch = np.ones((len(at1), 3))
    if bone not in _RIGID:
        stretch[:, 2] = length1 / length0
    scaled = R1 * stretch[:, None, :]
    linear = np.sum(scaled[:, :, None, :] * R0[:, None, :, :], axis=3)
    return linear, at1 - np.sum(linear * at0[:, None, :], axis=2)


def _frame(joints: Joints, bone: str) -> tuple[Array, Array, Array]:
    """Axes (columns ahead, left, up along the bone), origins [m] and lengths [m] of a bone in P postures."""
    kind, _, side = bone.partition("_")
    suffix = f"_{side}" if side else ""
    begin, end = _ENDS[kind]
    a, b = joints[begin + suffix], joints[end + suffix]
    low = kind in ("pelvis", "thigh", "shank", "foot")
    pair = ("hip_l", "hip_r") if low else ("shoulder_l", "shoulder_r")
    left = joints[pair[0]] - joints[pair[1]]
    along = b - a
    length = np.sqrt(np.sum(along**2, axis=1))
    upright = np.array([0.0, 0.0, 1.0])
    if kind == "foot":
        ahead = along / length[:, None]
        left = _unit(cross(np.broadcast_to(upright, ahead.shape), ahead))
        return np.stack([ahead, left, cross(ahead, left)], axis=2), a, length
    if kind == "head":
        # The head keeps looking ahead, level, whatever the trunk does.
        left = left + np.array([0.0, np.sqrt(np.sum(left[0] ** 2)), 0.0])
        along = np.broadcast_to(upright, a.shape)
    up = _unit(along) * (-1.0 if kind in ("arm", "fore", "thigh", "shank") else 1.0)
    left = _unit(left - np.sum(left * up, axis=1, keepdims=True) * up)
    return np.stack([cross(left, up), left, up], axis=2), a, length


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.sqrt(np.sum(vectors**2, axis=1, keepdims=True)), 1e-9))


def shoe_sole(ankle: ArrayLike, toe: ArrayLike) -> tuple[Array, Array, Array]:
    """Heel, ball and tip on the sole [m], of a foot given by ankle and toe joints (last axis xyz)."""
    a, t = np.asarray(ankle, dtype=np.float64), np.asarray(toe, dtype=np.float64)
    along = t - a
    length = np.sqrt(np.sum(along * along, axis=-1, keepdims=True))
    ahead = along / length
    level = np.sqrt(np.sum(ahead[..., :2] ** 2, axis=-1, keepdims=True))
    flat = ahead[..., :2] / np.maximum(level, 1e-9)
    # The line from ankle to toe tip falls by `tilt` against the sole.
    down = np.concatenate([flat * ahead[..., 2:], -level], axis=-1)
    height = 0.34 * length
    back = np.sqrt(np.maximum(length**2 - height**2, 1e-9))
    sole = (back * ahead - height * down) / length
    foot_point = t - sole * back
    heel = foot_point - 0.42 * sole * length
    ball = foot_point + 0.62 * sole * back
    return heel, ball, t


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
