"""The collision world: the town as a concave mesh, cars, and a pool of boxes for nearby actors."""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Iterator
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import GRAVITY_MPS2
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.physics.actor_pool import ActorPool
from carlaloc_env.physics.bullet import pybullet
from carlaloc_env.physics.contacts import Contact, ContactLog, Vector3
from carlaloc_env.physics.ground_heights import kept_ground
from carlaloc_env.road.road_profile import Roughness
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame

GROUP_STATIC, GROUP_EGO, GROUP_ACTOR = 1, 2, 4
"""Collision groups; actors touch nothing but cars."""
_MESH_TRIANGLES = 100_000
"""Triangles of one collision mesh at most."""
_CONTACT_ERP = 0.05
"""Share of a penetration that PyBullet removes in one step."""
_BODY_FRICTION = 0.4
"""Friction of the ego's body against things."""


class PhysicsWorld:
    """A separate PyBullet server in this process, stepped at 200 Hz.

    Args:
        collision_vertices_m: Corners of the drivable surface, kerbs and obstacles [m], world, (V, 3).
        collision_triangles: Corner indices, shape (T, 3).
        friction: Factor on the tyre friction, 1 = dry asphalt.
        roughness: What wheels feel beyond the mesh; None: nothing.

    Raises:
        ConfigError: the mesh is empty, not finite or has wrong indices.
    """

    def __init__(
        self,
        collision_vertices_m: ArrayLike,
        collision_triangles: ArrayLike,
        *,
        friction: float = 1.0,
        roughness: Roughness | None = None,
    ) -> None:
        vertices = np.asarray(collision_vertices_m, dtype=np.float64)
        triangles = np.asarray(collision_triangles, dtype=np.int64)
        _check_mesh(vertices, triangles)
        self.set_friction(friction)
        self.roughness = roughness
        """What wheels feel beyond the mesh."""
        self.client: int = pybullet.connect(pybullet.DIRECT)
        """PyBullet's id of this world."""
        # Also for a world that is dropped without being closed: PyBullet keeps it else.
        self._disconnect = weakref.finalize(self, pybullet.disconnect, physicsClientId=self.client)
        self._disconnect.atexit = False
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=TICK_S,
            numSubSteps=1,
            numSolverIterations=50,
            contactERP=_CONTACT_ERP,
            deterministicOverlappingPairs=1,
            physicsClientId=self.client,
        )
        pybullet.setGravity(0.0, 0.0, -GRAVITY_MPS2, physicsClientId=self.client)
        self.ground = kept_ground(vertices, triangles)
        """The mesh as wheels feel for it; PyBullet has it for the body."""
        for part in _mesh_parts(vertices, triangles):
            self._add_static(vertices, part)
        self._actors = ActorPool(self.client, GROUP_ACTOR, GROUP_EGO)
        self._contacts: dict[int, ContactLog] = {}
        self._car_ids: dict[int, int | None] = {}
        # PyBullet keeps shapes when their body is removed: one for each box.
        self._ego_shapes: dict[tuple[float, ...], int] = {}

    def set_friction(self, mu_factor: float) -> None:
        """Make the road slippery: 1 dry, 0.75 wet, 0.4 standing water, 0.3 snow, 0.1 ice.

        Raises:
            ConfigError: the factor is not in (0, 1.5].
        """
        if not 0.0 < mu_factor <= 1.5:
            raise ConfigError(f"friction factor is {mu_factor}; give a number above 0, at most 1.5 (1 = dry)")
        self.friction = float(mu_factor)
        """Factor on the tyre friction, 1 = dry asphalt."""

    def set_actors(
        self, frame: ActorFrame, catalog: ActorCatalog, following: ActorFrame | None = None, *, ticks: int = 0
    ) -> None:
        """Place boxes for the actors around the cars, which then move on by themselves.

        Args:
            frame: State of all actors at a 50 ms step.
            catalog: Their models, tags and sizes.
            following: State one step later; without it actors keep their speed until the next call.
            ticks: Ticks that have passed since that step.
        """
        if not self._contacts or len(frame) == 0:
            return
        poses = [
            pybullet.getBasePositionAndOrientation(car, physicsClientId=self.client) for car in self._contacts
        ]
        self._actors.update(frame, catalog, np.array([centre_m for centre_m, _ in poses]), following, ticks)

    def contacts(self, car: int | None = None) -> list[Contact]:
        """Contacts of a car's body, of the first one if none is given, since the last call, hardest first."""
        return self._contacts[next(iter(self._contacts)) if car is None else car].take()

    def remove_car(self, car: int) -> None:
        """Take the body of a car out of the world, if it is there."""
        self._actors.clear()
        if self._contacts.pop(car, None) is not None:
            pybullet.removeBody(car, physicsClientId=self.client)

    def add_car(
        self,
        *,
        actor_id: int | None,
        mass_kg: float,
        inertia_kgm2: Vector3,
        half_extents_m: list[float],
        box_centre_m: list[float],
        position_m: list[float],
        quat_xyzw: list[float],
    ) -> int:
        """Make the body of a car; a kept one would remember old contacts.

        Args:
            actor_id: Instance id of the car in contacts of other cars.
            mass_kg: Mass.
            inertia_kgm2: Moments about the centre of mass, which is the body's origin.
            half_extents_m: Half the size of its collision box, shape (3,).
            box_centre_m: Centre of that box from the centre of mass, body axes, shape (3,).
            position_m: Centre of mass in the world, shape (3,).
            quat_xyzw: Attitude, maps body to world, shape (4,).

        Returns:
            PyBullet's id of the body.
        """
        client = self.client
        box = (*half_extents_m, *box_centre_m)
        if box not in self._ego_shapes:
            self._ego_shapes[box] = pybullet.createCollisionShape(
                pybullet.GEOM_BOX,
                halfExtents=half_extents_m,
                collisionFramePosition=box_centre_m,
                physicsClientId=client,
            )
        shape = self._ego_shapes[box]
        body: int = pybullet.createMultiBody(
            mass_kg, shape, basePosition=position_m, baseOrientation=quat_xyzw, physicsClientId=client
        )
        pybullet.changeDynamics(
            body,
            -1,
            localInertiaDiagonal=inertia_kgm2,
            linearDamping=0.0,
            angularDamping=0.0,
            lateralFriction=_BODY_FRICTION,
            restitution=0.0,
            physicsClientId=client,
        )
        pybullet.setCollisionFilterGroupMask(
            body, -1, GROUP_EGO, GROUP_STATIC | GROUP_ACTOR | GROUP_EGO, physicsClientId=client
        )
        self._contacts[body], self._car_ids[body] = ContactLog(), actor_id
        return body

    def step(self) -> None:
        """Advance by one tick."""
        self._actors.advance()
        pybullet.stepSimulation(physicsClientId=self.client)
        for car, log in self._contacts.items():
            points = pybullet.getContactPoints(car, physicsClientId=self.client)
            if points:
                log.add(points, self._actor_of)

    def close(self) -> None:
        """Free the PyBullet server; may be called twice."""
        self._disconnect()

    def __enter__(self) -> PhysicsWorld:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _actor_of(self, body: int) -> int | None:
        return self._car_ids[body] if body in self._contacts else self._actors.actor_of(body)

    def _add_static(self, vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> None:
        used, index = np.unique(triangles, return_inverse=True)
        # PyBullet never lets go of these two lists nor of the vertices in them, 30 MB of a town: they are
        # emptied after use, and one object stands for all vertices.
        # Made before what goes into them, so that little memory around them stays in use.
        vertex, indices = _EachVertex(), list[int]()
        corners = [vertex] * len(used)
        vertex.values = itertools.cycle(vertices[used].ravel().tolist())
        indices += index.ravel().tolist()
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=corners,
            indices=indices,
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH | pybullet.GEOM_CONCAVE_INTERNAL_EDGE,
            physicsClientId=self.client,
        )
        for kept in (corners, indices, vertex):
            kept.clear()
        body = pybullet.createMultiBody(0.0, shape, physicsClientId=self.client)
        pybullet.changeDynamics(
            body, -1, lateralFriction=_BODY_FRICTION, restitution=0.0, physicsClientId=self.client
        )
        pybullet.setCollisionFilterGroupMask(
            body, -1, GROUP_STATIC, GROUP_STATIC | GROUP_EGO, physicsClientId=self.client
        )


class _EachVertex:
    """The vertices of a mesh one after the other, over and over: every look gives the next one."""

    def __init__(self) -> None:
        # One number after the other: a list for each vertex would set off Python's search for garbage.
        self.values: Iterator[float] = itertools.cycle([])

    def __len__(self) -> int:
        return 3

    def __iter__(self) -> Iterator[float]:
        return itertools.islice(self.values, 3)

    def clear(self) -> None:
        """Forget the vertices."""
        self.values = itertools.cycle([])


def _check_mesh(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> None:
    shaped = vertices.ndim == 2 and vertices.shape[1:] == (3,) and triangles.shape[1:] == (3,)
    if not shaped or len(triangles) == 0:
        raise ConfigError(
            f"collision mesh has vertices {vertices.shape} and triangles {triangles.shape}; "
            "give (V, 3) and (T, 3)"
        )
    if not np.isfinite(vertices).all():
        raise ConfigError("collision mesh has vertices that are not finite; rebuild the town")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ConfigError("collision mesh has triangle indices outside its vertices; rebuild the town")


def _mesh_parts(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Compact parts that PyBullet's message buffer can carry; one part for a usual town."""
    if len(triangles) <= _MESH_TRIANGLES:
        return [triangles]
    centre = vertices[triangles].mean(axis=1)
    axis = int(np.argmax(np.ptp(centre[:, :2], axis=0)))
    order = np.argsort(centre[:, axis], kind="stable")
    half = len(order) // 2
    return [
        part
        for side in (order[:half], order[half:])
        for part in _mesh_parts(vertices, triangles[np.sort(side)])
    ]
