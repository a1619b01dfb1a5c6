"""Wheels: a tyre and a rim about an axle, and how they are hung on a vehicle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.primitives import Look, circle, fan, mirrored, placed, rings, surface
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

TYRE = (190, 190, 190)
"""Linear tint of tyres."""
RIM = (150, 152, 155)
"""Linear tint of rims."""
HUB_DARK = (10, 10, 11)
"""Linear tint between the spokes."""
SIDES = 16
"""Corners of a tyre; a multiple of four keeps one of them on the ground."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WheelMount:
    """Place of one wheel on a vehicle."""

    mesh: Mesh
    """The wheel about its axle, outer face at +y."""
    centre_m: tuple[float, float, float]
    """Middle of the axle stub in the vehicle's frame [m]."""
    radius_m: float
    steered: bool
    right: bool
    """Whether it hangs on the right, its outer face at −y."""

    def mounted(self, steer_rad: float = 0.0) -> Mesh:
        """The wheel in the vehicle's frame, steered to the left [rad]."""
        centre_m, right = np.array([self.centre_m]), np.array([self.right])
        T = wheel_pose(centre_m, right, np.array([steer_rad * self.steered]), np.zeros(1))
        return self.mesh.transformed(T[0])


def wheel_pose(
    centre_m: NDArray[np.float64],
    right: NDArray[np.bool_],
    steer_rad: NDArray[np.float64],
    turn_rad: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Transforms from wheels to their vehicles: Rz(steer)·Ry(turn)·Rz(π on the right), shape (N, 4, 4)."""
    c, s, ct, st = (f(angle) for angle in (steer_rad, turn_rad) for f in (elementary.cos, elementary.sin))
    side = np.where(right, -1.0, 1.0)
    T = np.zeros((len(centre_m), 4, 4))
    T[:, 0, 0], T[:, 0, 1], T[:, 0, 2] = side * c * ct, -side * s, c * st
    T[:, 1, 0], T[:, 1, 1], T[:, 1, 2] = side * s * ct, side * c, s * st
    T[:, 2, 0], T[:, 2, 2] = -side * st, ct
    T[:, :3, 3] = centre_m
    T[:, 3, 3] = 1.0
    return T


def wheel(
    diameter_m: float, width_m: float, tag: Tag, *, spokes: int, rim: float = 0.68, back: bool = True
) -> Mesh:
    """Wheel whose axle lies along y through the origin, outer face at +y.

    Args:
        diameter_m: Outer diameter of the tyre [m].
        width_m: Width of the tyre [m].
        tag: Semantic tag of the vehicle.
        spokes: Spokes of the rim; 0 for a steel disc with holes.
        rim: Diameter of the rim as a share of the tyre's.
        back: Whether the inner face is closed.
    """
    r, h = 0.5 * diameter_m, 0.5 * width_m
    profile = [(0.80 * r, -h), (r, -0.75 * h), (r, 0.74 * h), (rim * r, h)]
    tyre = rings(Look(Material.RUBBER, tag, TYRE), _circles(profile), caps=False, crease_deg=42.0)
    dark = Look(Material.METAL_PAINTED, tag, HUB_DARK)
    metal = Look(Material.METAL_PAINTED, tag, RIM)
    inside = mirrored(_plate(dark, 0.80 * r, h)) if back else merge([])
    lip = rings(metal, _circles([(rim * r, 0.96 * h), (0.90 * rim * r, 0.80 * h)]), caps=False)
    if spokes == 0:
        dish = rings(metal, _circles([(0.90 * rim * r, 0.80 * h), (0.45 * rim * r, 0.66 * h)]), caps=False)
        hub = _dome(metal, 0.45 * rim * r, 0.66 * h, 0.92 * h)
        holes = [_hole(dark, 0.68 * rim * r, 0.09 * r, 0.745 * h, k / 8) for k in range(8)]
        return merge([tyre, inside, lip, dish, hub, *holes])
    dish = _plate(dark, 0.90 * rim * r, 0.62 * h)
    hub = _dome(metal, 0.20 * rim * r, 0.70 * h, 0.80 * h)
    width = (0.17 if spokes < 8 else 0.09) * rim * r
    blades = [
        _spoke(metal, (0.16 * rim * r, 0.93 * rim * r), width, (0.78 * h, 0.86 * h), k / spokes)
        for k in range(spokes)
    ]
    return merge([tyre, inside, lip, dish, hub, *blades])


def plain_wheel(diameter_m: float, width_m: float, tag: Tag) -> Mesh:
    """Wheel of few triangles for a vehicle far away: a tyre of twelve corners and a bright disc."""
    r, h = 0.5 * diameter_m, 0.5 * width_m
    dark, bright = Look(Material.RUBBER, tag, TYRE), Look(Material.METAL_PAINTED, tag, (70, 71, 73))
    side = _plate(dark, r, h, 12)
    return merge([side, _plate(bright, 0.60 * r, h + 0.01, 8)])


def car_wheels(
    mesh: Mesh, axles_x_m: tuple[float, ...], track_half_m: float, radius_m: float
) -> tuple[WheelMount, ...]:
    """A left and a right wheel on each axle; the foremost axle is steered."""
    front = max(axles_x_m) if len(axles_x_m) > 1 else None
    return tuple(
        mount for x in axles_x_m for mount in axle(mesh, x, track_half_m, radius_m, steered=x == front)
    )


def axle(
    mesh: Mesh, x_m: float, track_half_m: float, radius_m: float, *, steered: bool
) -> tuple[WheelMount, ...]:
    """A left and a right wheel."""
    return tuple(
        WheelMount(mesh=mesh, centre_m=(x_m, y, radius_m), radius_m=radius_m, steered=steered, right=y < 0)
        for y in (track_half_m, -track_half_m)
    )


def arch_liner(
    axle_x_m: float, radius_m: float, centre_z_m: float, y_m: tuple[float, float], tag: Tag
) -> list[Mesh]:
    """Dark lining of both wheel arches of an axle: a half tube open to below, and its inner wall.

    Args:
        axle_x_m: Place of the axle [m].
        radius_m: Radius of the arch [m].
        centre_z_m: Height of the axle [m].
        y_m: Inner and outer edge of the lining on the left [m].
        tag: Semantic tag of the vehicle.
    """
    look = Look(Material.PLASTIC, tag, (5, 5, 5))
    angle = np.pi * np.arange(9) / 8
    arc = np.stack(
        [axle_x_m + radius_m * elementary.cos(angle), centre_z_m + radius_m * elementary.sin(angle)], axis=-1
    )
    inner, outer = (np.insert(arc, 1, y, axis=1) for y in y_m)
    k = np.arange(8)
    # Seen from below, that is from inside the arch.
    strip = np.concatenate([np.stack([k, k + 1, k + 10], axis=-1), np.stack([k, k + 10, k + 9], axis=-1)])
    wall = np.stack([np.full(7, 0), np.arange(2, 9), np.arange(1, 8)], axis=-1)
    tube = surface(look, np.concatenate([inner, outer]), strip, crease_deg=60.0)
    back = surface(look, inner, wall, crease_deg=5.0)
    return [m for part in (tube, back) for m in (part, mirrored(part))]


def _circles(profile: list[tuple[float, float]], sides: int = SIDES) -> NDArray[np.float64]:
    # Anticlockwise seen against +y, beginning at the lowest point.
    up, ahead = circle(sides).T
    r, y = np.array(profile).T[:, :, None]
    return np.stack([-r * ahead, np.broadcast_to(y, (len(r), sides)), -r * up], axis=-1)


def _plate(look: Look, radius_m: float, y_m: float, sides: int = SIDES) -> Mesh:
    ring = _circles([(radius_m, y_m)], sides)[0]
    return surface(look, np.concatenate([ring, [[0.0, y_m, 0.0]]]), fan(sides))


def _dome(look: Look, radius_m: float, low_m: float, high_m: float) -> Mesh:
    profile = [(radius_m, low_m), (0.8 * radius_m, high_m), (1e-4, high_m)]
    return rings(look, _circles(profile, 8), caps=False, crease_deg=60.0)


def _hole(look: Look, ring_m: float, radius_m: float, y_m: float, turn: float) -> Mesh:
    c, s = elementary.cos(2 * np.pi * turn), elementary.sin(2 * np.pi * turn)
    return placed(_plate(look, radius_m, y_m, 6), (ring_m * s, 0.0, ring_m * c))


def _spoke(
    look: Look, radii_m: tuple[float, float], half_m: float, y_m: tuple[float, float], turn: float
) -> Mesh:
    """Blade from hub to rim with a flat face and two flanks."""
    c, s = elementary.cos(2 * np.pi * turn), elementary.sin(2 * np.pi * turn)
    (inner, outer), (low, high) = radii_m, y_m
    flat = [(inner, -half_m), (outer, -0.55 * half_m), (outer, 0.55 * half_m), (inner, half_m)]
    face = [(r * s + w * c, high, r * c - w * s) for r, w in flat]
    foot = [(r * s + 1.3 * w * c, low - 0.1 * (high - low), r * c - 1.3 * w * s) for r, w in flat]
    triangles = [(0, 1, 2), (0, 2, 3), (4, 5, 1), (4, 1, 0), (3, 2, 6), (3, 6, 7)]
    return surface(look, np.array(face + foot), triangles, crease_deg=5.0)
