"""People: a figure of limbs, torso and head hung on its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.assets.shapes import Colour, Look, capsule, ellipsoid, rings
from carlaloc_env.geometry import cross
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, merge
from carlaloc_env.semantics import Tag

Array = NDArray[np.float64]
Joints = dict[str, Array]
"""Positions [m] of pelvis, chest, neck, head and, with suffix _l and _r, shoulder, elbow, hand, hip,
knee, ankle, toe."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """Girth and clothes of a figure."""

    girth: float = 1.0
    """Radii as a multiple of an average man's."""
    hips: float = 1.0
    skin: Colour = (150, 92, 62)
    hair: Colour = (12, 8, 5)
    upper: Colour = (255, 255, 255)
    """White takes the instance's tint."""
    lower: Colour = (16, 22, 42)
    shoes: Colour = (14, 12, 11)
    skirt: bool = False
    long_hair: bool = False
    hat: Colour | None = None
    bag: Colour | None = None
    helmet: Colour | None = None


def figure(joints: Joints, build: Build, tag: Tag) -> Mesh:
    """Mesh of a person in the posture given by the joints; x is ahead, y left."""
    g = build.girth
    upper, lower = Look(Material.CLOTH, tag, build.upper), Look(Material.CLOTH, tag, build.lower)
    skin, shoe = Look(Material.SKIN, tag, build.skin), Look(Material.CLOTH, tag, build.shoes)
    parts = [_torso(joints, build, upper, lower), *_head(joints, build, skin, tag)]
    for side in ("_l", "_r"):
        hip, knee, ankle, toe = (joints[name + side] for name in ("hip", "knee", "ankle", "toe"))
        shin = skin if build.skirt else lower
        parts += [
            capsule(lower, hip, knee, 0.083 * g, 0.058 * g, 7),
            capsule(shin, knee, ankle, 0.055 * g, 0.042 * g, 6),
            _shoe(shoe, ankle, toe, g),
        ]
        shoulder, elbow, hand = (joints[name + side] for name in ("shoulder", "elbow", "hand"))
        wrist = elbow + 0.80 * (hand - elbow)
        parts += [
            capsule(upper, shoulder, elbow, 0.052 * g, 0.042 * g, 6),
            capsule(upper, elbow, wrist, 0.041 * g, 0.033 * g, 6),
            ellipsoid(
                skin, 0.45 * wrist + 0.55 * hand + _by(0, 0, -0.01), (0.042 * g, 0.028 * g, 0.055 * g), 4, 6
            ),
        ]
    if build.skirt:
        parts.append(_skirt(joints, g, lower))
    if build.bag is not None:
        parts.append(_backpack(joints, g, Look(Material.CLOTH, tag, build.bag)))
    return merge(parts)


def _by(x_m: float, y_m: float, z_m: float) -> Array:
    return np.array([x_m, y_m, z_m])


def _torso(joints: Joints, build: Build, upper: Look, lower: Look) -> Mesh:
    """Two skins: hips in the lower clothes, waist to neck in the upper ones."""
    g, h = build.girth, build.hips
    pelvis, chest, neck = joints["pelvis"], joints["chest"], joints["neck"]
    across_low = joints["hip_l"] - joints["hip_r"]
    across_high = joints["shoulder_l"] - joints["shoulder_r"]
    reach = 0.5 * float(np.sqrt(np.sum(across_high**2)))
    waist = 0.5 * (pelvis + chest)
    levels = [
        (pelvis + _by(0, 0, -0.07), across_low, 0.13 * g * h, 0.10 * g),
        (pelvis + _by(0, 0, 0.03), across_low, 0.175 * g * h, 0.128 * g),
        (pelvis + 0.45 * (waist - pelvis), across_low, 0.165 * g * h, 0.122 * g),
        (waist, across_low, 0.150 * g, 0.112 * g),
        (chest, across_high, 0.172 * g, 0.125 * g),
        (chest + 0.55 * (neck - chest), across_high, reach * 1.02, 0.115 * g),
        (chest + 0.86 * (neck - chest), across_high, reach * 0.72, 0.085 * g),
        (neck, across_high, 0.062 * g, 0.062 * g),
    ]
    grid = np.stack([_ring(*level) for level in levels])
    return merge(
        [
            rings(lower, grid[:3], crease_deg=80.0),
            rings(upper, grid[2:], crease_deg=80.0),
        ]
    )


def _ring(centre: Array, across: Array, half_width: float, half_depth: float, sides: int = 10) -> Array:
    side = across / np.sqrt(np.sum(across * across))
    ahead = cross(side, np.array([0.0, 0.0, 1.0]))
    ahead = ahead / np.sqrt(np.sum(ahead * ahead))
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.asarray(
        centre + half_depth * np.cos(angle)[:, None] * ahead + half_width * np.sin(angle)[:, None] * side
    )


def _head(joints: Joints, build: Build, skin: Look, tag: Tag) -> list[Mesh]:
    neck, head = joints["neck"], joints["head"]
    hair = Look(Material.CLOTH, tag, build.hair)
    s = 0.5 * (1.0 + build.girth)
    parts = [
        capsule(skin, neck - _by(0, 0, 0.03), head - _by(0, 0, 0.06), 0.054 * s, 0.052 * s, 6),
        ellipsoid(skin, head, (0.098 * s, 0.076 * s, 0.118 * s), 7, 10),
        ellipsoid(skin, head + _by(0.098 * s, 0, -0.012), (0.018, 0.014, 0.022), 3, 5),
    ]
    if build.helmet is not None:
        shell = Look(Material.PLASTIC, tag, build.helmet)
        parts.append(ellipsoid(shell, head + _by(-0.012, 0, 0.035), (0.128, 0.108, 0.122), 6, 10))
        return parts
    parts.append(
        ellipsoid(hair, head + _by(-0.022 * s, 0, 0.030 * s), (0.094 * s, 0.084 * s, 0.104 * s), 6, 10)
    )
    if build.long_hair:
        parts.append(ellipsoid(hair, head + _by(-0.062 * s, 0, -0.085), (0.052, 0.082, 0.135), 5, 8))
    if build.hat is not None:
        cloth = Look(Material.CLOTH, tag, build.hat)
        parts.append(ellipsoid(cloth, head + _by(-0.008, 0, 0.065), (0.108, 0.095, 0.075), 5, 10))
        parts.append(ellipsoid(cloth, head + _by(0.035, 0, 0.052), (0.125, 0.10, 0.014), 3, 10))
    return parts


def _shoe(look: Look, ankle: Array, toe: Array, g: float) -> Mesh:
    """Shoe from behind the ankle to the toe tip; its sole runs from heel to toe."""
    along = toe - ankle
    along = along / np.sqrt(np.sum(along * along))
    side = np.array([-along[1], along[0], 0.0])
    side = side / max(float(np.sqrt(np.sum(side * side))), 1e-6)
    heel, ball, tip = shoe_sole(ankle, toe)
    up = cross(along, side)
    up = up if up[2] > 0 else -up
    levels = [
        (heel, 0.030 * g, 0.075),
        (heel + 0.30 * (ball - heel), 0.040 * g, 0.095),
        (ball, 0.047 * g, 0.055),
        (tip, 0.032 * g, 0.030),
    ]
    grid = np.stack(
        [
            np.stack([c - w * side, c + w * side, c + 0.8 * w * side + h * up, c - 0.8 * w * side + h * up])
            for c, w, h in levels
        ]
    )
    return rings(look, grid, crease_deg=50.0)


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
    sole_tip = t
    back = np.sqrt(np.maximum(length**2 - height**2, 1e-9))
    sole = (back * ahead - height * down) / length
    foot_point = sole_tip - sole * back
    heel = foot_point - 0.42 * sole * length
    ball = foot_point + 0.62 * sole * back
    return heel, ball, sole_tip


def _skirt(joints: Joints, g: float, look: Look) -> Mesh:
    pelvis = joints["pelvis"]
    knees = 0.5 * (joints["knee_l"] + joints["knee_r"])
    across = joints["hip_l"] - joints["hip_r"]
    spread = 0.5 * float(np.abs(joints["knee_l"][0] - joints["knee_r"][0]))
    hem = 0.25 * pelvis + 0.75 * knees
    grid = np.stack(
        [
            _ring(hem, across, 0.20 * g, 0.14 * g + 0.7 * spread),
            _ring(pelvis + _by(0, 0, 0.02), across, 0.18 * g, 0.135 * g),
        ]
    )
    return rings(look, grid, crease_deg=80.0)


def _backpack(joints: Joints, g: float, look: Look) -> Mesh:
    chest, neck = joints["chest"], joints["neck"]
    centre = 0.65 * chest + 0.35 * neck + np.array([-0.17 * g, 0.0, 0.0])
    return ellipsoid(look, centre, (0.085 * g, 0.14 * g, 0.21 * g), 5, 8)
