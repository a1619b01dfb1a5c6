"""Nearby actors as kinematic boxes, lent from a pool: a body per actor would cost every tick."""

import itertools

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.clock import STEP_NS, TICK_S
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.core.jit import compiled
from carlaloc_env.physics.bullet import pybullet
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame, came_in_elsewhere

MAX_BOXES = 32
"""Actors that exist in the collision world at once, for each car."""
_NEAR_M = 16.0
"""Actors this close to a car have a box, along x, y and z [m]: no two could touch from farther apart in a
step."""
_MAX_BODIES = 64
"""Bodies that are made at most for each car; boxes of one size are used again."""
_PARKED_M = -1000.0
"""Height at which unused bodies wait [m]."""
_Size = tuple[float, float, float]
"""Length, width, height [m]."""


class ActorPool:
    """Boxes of actors near cars, set at every step and moved at every tick.

    Args:
        client: PyBullet's id of the world.
        group: Collision group of the boxes.
        mask: Groups that the boxes touch.
    """

    def __init__(self, client: int, group: int, mask: int) -> None:
        self._client = client
        self._group, self._mask = group, mask
        self._free: dict[_Size, list[int]] = {}
        # PyBullet keeps shapes when their body is removed: one for each size.
        self._shapes: dict[_Size, int] = {}
        self._lent: dict[int, tuple[int, _Size]] = {}
        self._actor: dict[int, int] = {}
        self._moving: list[tuple[int, list[float], list[float], list[float]]] = []
        self._ticks = 0
        self._most_bodies = _MAX_BODIES

    def update(
        self,
        frame: ActorFrame,
        catalog: ActorCatalog,
        near_m: NDArray[np.float64],
        following: ActorFrame | None,
        ticks: int,
    ) -> None:
        """Give boxes to the nearest actors; they move on with `advance`.

        Args:
            frame: State of all actors at a step.
            catalog: Their sizes.
            near_m: Where the cars are [m], world, shape (C, 3).
            following: State one step later; without it actors keep their speed.
            ticks: Ticks that have passed since the step.
        """
        near, boxes = np.empty(len(frame), np.intp), np.empty((len(frame), 11))
        motion = frame.heading_rad, frame.pitch_rad, frame.roll_rad, frame.speed_mps
        count = _put_near(frame.position_m, *motion, catalog.size_m, near_m, near, boxes)
        near, boxes = near[:count], boxes[:count]
        most = MAX_BOXES * len(near_m)
        self._most_bodies = _MAX_BODIES * len(near_m)
        if count > most:
            nearest = np.argsort(boxes[:, 10], kind="stable")[:most]
            near, boxes = near[nearest], boxes[nearest]
        wanted = dict(zip(catalog.id[near].tolist(), near.tolist(), strict=True))
        for actor in [a for a in self._lent if a not in wanted]:
            self._give_back(actor)
        self._moving.clear()
        self._ticks = ticks
        velocities = _velocities(frame, near, boxes[:, 7:10], following).tolist()
        for (actor, i), box, velocity in zip(wanted.items(), boxes.tolist(), velocities, strict=True):
            moving = self._body_of(actor, catalog.size_m[i]), box[:3], velocity, box[3:7]
            self._place(*moving)
            if any(velocity):
                self._moving.append(moving)

    def advance(self) -> None:
        """Move the boxes of actors that move by one tick."""
        self._ticks += 1
        for box in self._moving:
            self._place(*box)

    def _place(self, body: int, centre: list[float], velocity: list[float], quat: list[float]) -> None:
        t = self._ticks * TICK_S
        (x, y, z), (vx, vy, vz) = centre, velocity
        position = (x + vx * t, y + vy * t, z + vz * t)
        pybullet.resetBasePositionAndOrientation(body, position, quat, physicsClientId=self._client)

    def clear(self) -> None:
        """Remove every box from the world."""
        lent = [body for body, _ in self._lent.values()]
        for body in itertools.chain(lent, *self._free.values()):
            pybullet.removeBody(body, physicsClientId=self._client)
        self._free.clear()
        self._lent.clear()
        self._actor.clear()
        self._moving.clear()

    def actor_of(self, body: int) -> int | None:
        """Instance id of the actor that a body stands for, None if it is no box of the pool."""
        return self._actor.get(body)

    def _body_of(self, actor: int, size_m: NDArray[np.float32]) -> int:
        lent = self._lent.get(actor)
        if lent is not None:
            return lent[0]
        size = (round(float(size_m[0]), 2), round(float(size_m[1]), 2), round(float(size_m[2]), 2))
        free = self._free.setdefault(size, [])
        body = free.pop() if free else self._create(size)
        self._lent[actor] = (body, size)
        self._actor[body] = actor
        return body

    def _give_back(self, actor: int) -> None:
        body, size = self._lent.pop(actor)
        del self._actor[body]
        if len(self._lent) + sum(map(len, self._free.values())) >= self._most_bodies:
            pybullet.removeBody(body, physicsClientId=self._client)
            return
        self._free[size].append(body)
        parked = [4.0 * body, 0.0, _PARKED_M]
        pybullet.resetBasePositionAndOrientation(body, parked, [0, 0, 0, 1], physicsClientId=self._client)

    def _create(self, size: _Size) -> int:
        if size not in self._shapes:
            self._shapes[size] = pybullet.createCollisionShape(
                pybullet.GEOM_BOX, halfExtents=[0.5 * s for s in size], physicsClientId=self._client
            )
        body = int(pybullet.createMultiBody(0.0, self._shapes[size], physicsClientId=self._client))
        pybullet.changeDynamics(body, -1, lateralFriction=0.4, restitution=0.0, physicsClientId=self._client)
        pybullet.setCollisionFilterGroupMask(body, -1, self._group, self._mask, physicsClientId=self._client)
        return body


@compiled
def _put_near(
    position_m: F32, heading_rad: F32, pitch_rad: F32, roll_rad: F32, speed_mps: F32, size_m: F32,
    near_m: Array, near: Index, boxes: Array,
) -> int:  # fmt: skip
    """Write numbers (N,) and boxes of the actors near some points (C, 3), as many as the result.

    A box has eleven numbers: its centre [m], attitude, velocity as it goes now [m/s], and distance [m].
    """
    count = 0
    for n in range(len(heading_rad)):
        x, y, z = float(position_m[n, 0]), float(position_m[n, 1]), float(position_m[n, 2])
        away_m = np.inf
        for c in range(len(near_m)):
            apart = max(abs(x - near_m[c, 0]), abs(y - near_m[c, 1]), abs(z - near_m[c, 2]))
            away_m = min(away_m, apart)
        if away_m >= _NEAR_M:
            continue
        heading, pitch, roll = float(heading_rad[n]), float(pitch_rad[n]), float(roll_rad[n])
        lift = 0.5 * float(size_m[n, 2])
        (sin_h, cos_h), (sin_p, cos_p), (sin_r, cos_r) = sin_cos(heading), sin_cos(pitch), sin_cos(roll)
        back, right, box = lift * sin_p * cos_r, lift * sin_r, boxes[count]
        box[0], box[1] = x + right * sin_h - back * cos_h, y - right * cos_h - back * sin_h
        box[2], box[10] = z + lift * cos_p * cos_r, away_m
        (sh, ch), (sp, cp), (sr, cr) = sin_cos(0.5 * heading), sin_cos(-0.5 * pitch), sin_cos(0.5 * roll)
        box[3], box[4] = ch * cp * sr - sh * sp * cr, ch * sp * cr + sh * cp * sr
        box[5], box[6] = sh * cp * cr - ch * sp * sr, ch * cp * cr + sh * sp * sr
        speed = float(speed_mps[n])
        box[7], box[8], box[9] = speed * cos_p * cos_h, speed * cos_p * sin_h, speed * sin_p
        near[count] = n
        count += 1
    return count


def _velocities(frame: ActorFrame, near: Index, as_now_mps: Array, following: ActorFrame | None) -> Array:
    """Velocities of some actors until the following step, or as they go now [m/s], (N, 3)."""
    if following is None or not len(near):
        return as_now_mps
    change = following.position_m[near] - frame.position_m[near]
    away = came_in_elsewhere(change, following.heading_rad[near] - frame.heading_rad[near])
    # An actor that comes in elsewhere passes no place in between.
    return np.where(away[:, None], as_now_mps, change.astype(np.float64) / (STEP_NS * 1e-9))
