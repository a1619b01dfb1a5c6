"""Bones of a figure: frames on its joints, and a skin that follows them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
