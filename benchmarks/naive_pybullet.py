"""The usual way to simulate sensors in PyBullet: a body for everything, TinyRenderer, rayTestBatch.

Both sides hold the same town: every building, tree and piece of street furniture is a body with the
triangles that CarlaLoc draws, the ground is a mesh of some bodies, actors are boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

import numpy as np
import pybullet
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame

RAYS_PER_CALL = 16_383
"""`rayTestBatch` answers 16 384 rays and more with nothing at all, and without an error."""
_PART_TRIANGLES = 50_000
_NEAR_M, _FAR_M = 0.1, 500.0
_EGO_HALF_M = (2.35, 0.925, 0.6)


class NaiveWorld:
    """Scenery in PyBullet with one body per thing."""

    def __init__(self, chunks: Sequence[Mesh]) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        pybullet.setGravity(0, 0, -9.81, physicsClientId=self._client)
        pybullet.setTimeStep(TICK_S, physicsClientId=self._client)
        self._add_town(merge(chunks))
        self._actors: list[int] = []
        self._ego = -1

    def stand(self, catalog: ActorCatalog, ego_m: Array) -> None:
        """Replace actors and ego.

        Args:
            catalog: Actors, a kinematic box each.
            ego_m: Where the ego stands, a heavy box [m], shape (3,).
        """
        for body in [*self._actors, self._ego]:
            if body >= 0:
                pybullet.removeBody(body, physicsClientId=self._client)
        self._actors = [
            self._add_box(0.5 * size, np.zeros(3), tint / 255.0)
            for size, tint in zip(catalog.size_m.astype(np.float64), catalog.tint, strict=True)
        ]
        self._heights = catalog.size_m[:, 2].astype(np.float64)
        self._ego = self._add_box(
            np.array(_EGO_HALF_M), ego_m + np.array([0.0, 0.0, 0.8]), np.array([0.2, 0.3, 0.6]), 1850.0
        )

    @property
    def bodies(self) -> int:
        """Number of bodies."""
        count: int = pybullet.getNumBodies(physicsClientId=self._client)
        return count

    def move_actors(self, frame: ActorFrame) -> None:
        """Put every actor where it is now."""
        for body, position, heading, height in zip(
            self._actors, frame.position_m, frame.heading_rad, self._heights, strict=True
        ):
            centre = (position[0], position[1], position[2] + 0.5 * height)
            quat = pybullet.getQuaternionFromEuler((0.0, 0.0, heading))
            pybullet.resetBasePositionAndOrientation(body, centre, quat, physicsClientId=self._client)

    def step(self) -> None:
        """Advance the physics by one tick."""
        pybullet.stepSimulation(physicsClientId=self._client)

    def ranges_m(self, origin_m: Array, directions: Array, range_max_m: float) -> Array:
        """Distance of the first hit of each ray [m], `range_max_m` without one, shape (N,)."""
        ends = (origin_m + range_max_m * directions).tolist()
        start = origin_m.tolist()
        fractions: list[float] = []
        for first in range(0, len(ends), RAYS_PER_CALL):
            part = ends[first : first + RAYS_PER_CALL]
            hits = pybullet.rayTestBatch([start] * len(part), part, physicsClientId=self._client)
            fractions += [hit[2] for hit in hits]
        return range_max_m * np.array(fractions)

    def picture(self, pinhole: Pinhole, T_world_camera: Array) -> tuple[Array, Array, Array]:
        """Colour (H, W, 3), planar depth [m] (H, W), body ids (H, W) by TinyRenderer."""
        eye, ahead, down = T_world_camera[:3, 3], T_world_camera[:3, 2], T_world_camera[:3, 1]
        view = pybullet.computeViewMatrix(eye.tolist(), (eye + ahead).tolist(), (-down).tolist())
        width, height = pinhole.width_px, pinhole.height_px
        upright = float(np.degrees(2 * np.arctan(0.5 * height / pinhole.fy_px)))
        projection = pybullet.computeProjectionMatrixFOV(upright, width / height, _NEAR_M, _FAR_M)
        _, _, rgba, buffer, bodies = pybullet.getCameraImage(
            width,
            height,
            view,
            projection,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        rgb = np.reshape(rgba, (height, width, 4))[..., :3]
        depth = _FAR_M * _NEAR_M / (_FAR_M - (_FAR_M - _NEAR_M) * np.reshape(buffer, (height, width)))
        return rgb, depth, np.reshape(bodies, (height, width))

    def close(self) -> None:
        """Free the server."""
        pybullet.disconnect(physicsClientId=self._client)

    def __enter__(self) -> NaiveWorld:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _add_town(self, scenery: Mesh) -> None:
        owner = scenery.instance[scenery.triangles[:, 0]]
        order = np.argsort(owner, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(owner[order])) + 1):
            if owner[rows[0]] == 0:
                for first in range(0, len(rows), _PART_TRIANGLES):
                    self._add_mesh(scenery, scenery.triangles[rows[first : first + _PART_TRIANGLES]])
            else:
                self._add_mesh(scenery, scenery.triangles[rows])

    def _add_mesh(self, scenery: Mesh, triangles: NDArray[np.uint32]) -> None:
        client = self._client
        used, index = np.unique(triangles, return_inverse=True)
        vertices, indices = scenery.vertices_m[used].tolist(), index.ravel().tolist()
        collision = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=vertices,
            indices=indices,
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=client,
        )
        visual = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=vertices,
            indices=indices,
            normals=scenery.normals[used].tolist(),
            rgbaColor=[0.4, 0.4, 0.4, 1.0],
            physicsClientId=client,
        )
        pybullet.createMultiBody(0.0, collision, visual, physicsClientId=client)

    def _add_box(self, half_m: Array, centre_m: Array, rgb: Array, mass_kg: float = 0.0) -> int:
        client, half = self._client, half_m.tolist()
        collision = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
        visual = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=half, rgbaColor=[*rgb.tolist(), 1.0], physicsClientId=client
        )
        body: int = pybullet.createMultiBody(
            mass_kg, collision, visual, basePosition=centre_m.tolist(), physicsClientId=client
        )
        return body
