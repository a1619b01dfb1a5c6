"""Nearby actors as kinematic boxes, and what the ego touched of all that stands.

Nearby actors as kinematic boxes, lent from a pool: a body per actor would cost every tick.

PyBullet, imported without the line that it prints; all modules of this package take it from here.

What the ego's body touched.
"""

import ctypes
import itertools
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_NS, TICK_S
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.timeline.timeline import ActorCatalog, ActorFrame, came_in_elsewhere

__all__ = ["pybullet"]

_BANNER = b"pybullet build time"


@contextmanager
def _without_banner(descriptor: int) -> Iterator[None]:
    """Leave PyBullet's line out of what is written to standard output (1) or error (2).

    C code writes it, so that Python's own redirection does not help. All else is passed on.
    """
    try:
        kept = os.dup(descriptor)
    except OSError:
        yield  # it is closed: the line is lost anyway
        return
    with tempfile.TemporaryFile() as caught:
        _flush()
        os.dup2(caught.fileno(), descriptor)
        try:
            yield
        finally:
            _flush()
            os.dup2(kept, descriptor)
            os.close(kept)
            caught.seek(0)
            _write(descriptor, b"".join(line for line in caught if not line.startswith(_BANNER)))


def _flush() -> None:
    """Empty Python's buffers, and C's, of which Python knows nothing."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    ctypes.CDLL("ucrtbase" if os.name == "nt" else None).fflush(None)


def _write(descriptor: int, content: bytes) -> None:
    while content:
        content = content[os.write(descriptor, content) :]


with _without_banner(1), _without_banner(2):
    pybullet: Any = import_module("pybullet")
    """The module."""


MAX_BOXES = 32
"""Actors that exist in the collision world at once."""
_NEAR_M = 16.0
"""Actors this close to the ego have a box, along x, y and z [m]: no two could touch from farther apart in a
step."""
_MAX_BODIES = 64
"""Bodies that are made at most; boxes of one size are used again."""
_PARKED_M = -1000.0
"""Height at which unused bodies wait [m]."""

_Size = tuple[float, float, float]
"""Length, width, height [m]."""


class ActorPool:
    """Boxes of actors near the ego, set at every step and moved at every tick.

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
            near_m: Where the ego is [m], world, shape (3,).
            following: State one step later; without it actors keep their speed.
            ticks: Ticks that have passed since the step.
        """
        distance = np.abs(frame.position_m - near_m).max(axis=1, initial=0.0)
        near = np.flatnonzero(distance < _NEAR_M)
        if len(near) > MAX_BOXES:
            near = near[np.argsort(distance[near], kind="stable")[:MAX_BOXES]]
        wanted = {int(catalog.id[i]): int(i) for i in near}
        for actor in [a for a in self._lent if a not in wanted]:
            self._give_back(actor)
        self._moving.clear()
        self._ticks = ticks
        velocities = _velocities(frame, near, following) if wanted else []
        for (actor, i), velocity in zip(wanted.items(), velocities, strict=True):
            body = self._body_of(actor, catalog.size_m[i])
            centre, quat = _box_pose(frame, i, float(catalog.size_m[i, 2]))
            self._place(body, centre, velocity, quat)
            if any(velocity):
                self._moving.append((body, centre, velocity, quat))

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
        if len(self._lent) + sum(map(len, self._free.values())) >= _MAX_BODIES:
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


def _box_pose(frame: ActorFrame, i: int, height_m: float) -> tuple[list[float], list[float]]:
    x, y, z = frame.position_m[i].tolist()
    heading, pitch, roll = (float(a[i]) for a in (frame.heading_rad, frame.pitch_rad, frame.roll_rad))
    lift = 0.5 * height_m
    (sin_h, cos_h), (sin_p, cos_p), (sin_r, cos_r) = sin_cos(heading), sin_cos(pitch), sin_cos(roll)
    back, right = lift * sin_p * cos_r, lift * sin_r
    centre = [x + right * sin_h - back * cos_h, y - right * cos_h - back * sin_h, z + lift * cos_p * cos_r]
    (sh, ch), (sp, cp), (sr, cr) = sin_cos(0.5 * heading), sin_cos(-0.5 * pitch), sin_cos(0.5 * roll)
    quat_xyzw = [
        ch * cp * sr - sh * sp * cr,
        ch * sp * cr + sh * cp * sr,
        sh * cp * cr - ch * sp * sr,
        ch * cp * cr + sh * sp * sr,
    ]
    return centre, quat_xyzw


def _velocities(
    frame: ActorFrame, index: NDArray[np.intp], following: ActorFrame | None
) -> list[list[float]]:
    """Velocities of some actors until the following step, or as they go now [m/s]."""
    if following is None:
        return [_velocity(frame, i) for i in index.tolist()]
    change = following.position_m[index] - frame.position_m[index]
    away = came_in_elsewhere(change, following.heading_rad[index] - frame.heading_rad[index])
    # An actor that comes in elsewhere passes no place in between.
    return [
        _velocity(frame, i) if elsewhere else [d / (STEP_NS * 1e-9) for d in moved]
        for i, elsewhere, moved in zip(index.tolist(), away.tolist(), change.tolist(), strict=True)
    ]


def _velocity(frame: ActorFrame, i: int) -> list[float]:
    speed, heading, pitch = (float(a[i]) for a in (frame.speed_mps, frame.heading_rad, frame.pitch_rad))
    (sin_h, cos_h), (sin_p, cos_p) = sin_cos(heading), sin_cos(pitch)
    return [speed * cos_p * cos_h, speed * cos_p * sin_h, speed * sin_p]


Vector3 = tuple[float, float, float]
"""x, y, z."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """One thing that the ego's body touched since the last query."""

    actor_id: int | None
    """Instance id of the actor, None for the static town."""
    impulse_ns: float
    """Sum of the normal impulses [N s]."""
    position_m: Vector3
    """Where the strongest impulse acted [m], world."""


class ContactLog:
    """Adds up PyBullet's contact points per thing touched until they are read."""

    def __init__(self) -> None:
        self._touched: dict[int | None, tuple[float, float, Vector3]] = {}

    def add(self, points: Iterable[Any], actor_of: Callable[[int], int | None]) -> None:
        """Take in the contact points of one tick; `actor_of` names the actor of a body."""
        for point in points:
            impulse = point[9] * TICK_S
            if impulse <= 0.0:
                continue
            actor = actor_of(point[2])
            total, hardest, where = self._touched.get(actor, (0.0, 0.0, point[5]))
            if impulse > hardest:
                hardest, where = impulse, point[5]
            self._touched[actor] = (total + impulse, hardest, where)

    def take(self) -> list[Contact]:
        """All contacts since the last call, hardest first."""
        if not self._touched:
            return []
        found = [
            Contact(actor_id=actor, impulse_ns=total, position_m=where)
            for actor, (total, _, where) in self._touched.items()
        ]
        self._touched.clear()
        return sorted(found, key=lambda contact: -contact.impulse_ns)
