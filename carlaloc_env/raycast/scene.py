"""A town and its actors, hit by rays that have a time each.

The static town is one Embree scene. A moving actor is hit in its own frame: the rays that may
meet it are carried there with the actor's pose at the time of each ray, so one model serves all
actors that look like it, nothing is rebuilt between sweeps, and a passing car is sheared as a
rolling sensor sees it.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.articulation import steered_mesh
from carlaloc_env.actors.instances import ray_models, ray_postures
from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.raycast.culling import Cylinders, candidates
from carlaloc_env.raycast.hits import Hits
from carlaloc_env.raycast.surface import Surface, import_open3d
from carlaloc_env.scene.mesh import EGO_INSTANCE, Mesh, ModelLibrary, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.timeline.snapshot import Snapshot
from carlaloc_env.timeline.timeline import Timeline

Floats = Array | F32
"""Directions in double or single precision."""

_STEER_KINDS = 64
"""Above the number of front-wheel angles that models are made for."""


class RayScene:
    """A town and the models that move in it, ready for rays."""

    def __init__(self, static: Sequence[Mesh], library: ModelLibrary) -> None:
        """Build the ray tracer's trees.

        Args:
            static: Scenery that never moves, world coordinates.
            library: Models of actors by name; ``ego`` is the ego's own body.

        Raises:
            RaycastError: open3d cannot be imported on this machine.
        """
        self._o3d = import_open3d()
        self._library = library
        town = merge(static)
        # Embree computes in float32: metres counted from the middle keep the town's far corners exact.
        self.middle_m = (
            np.round(town.bounds_m.mean(axis=0, dtype=np.float64)) if len(town.triangles) else np.zeros(3)
        )
        """Origin of the coordinates of `trace` [m], world, shape (3,)."""
        near = dataclasses.replace(town, vertices_m=(town.vertices_m - self.middle_m).astype(np.float32))
        self._static = Surface(self._o3d, near, origin_m=self.middle_m, shared=True)
        self._models: dict[tuple[int, int], Surface] = {}
        self._extents: dict[int, Array] = {}

    def cast(
        self,
        origins_m: Array,
        directions: Array,
        stamps_ns: NDArray[np.int64],
        timeline: Timeline,
        range_max_m: float,
        *,
        ego: bool = True,
    ) -> Hits:
        """First hits of N rays, each cast at its own time.

        Args:
            origins_m: Where rays start [m], world, shape (N, 3).
            directions: Unit directions, world, shape (N, 3).
            stamps_ns: When each ray is cast [ns], shape (N,).
            timeline: Where everything is.
            range_max_m: Hits beyond this distance are dropped [m].
            ego: Whether the ego's own body can be hit.
        """
        hits = self.trace(_packed(origins_m - self.middle_m, directions), stamps_ns, timeline, range_max_m)
        if not (ego and len(hits)):
            return hits
        times, back = np.unique(stamps_ns, return_inverse=True)
        motion = timeline.ego_motion(times)
        to_body = transforms.quat_conjugate(motion.quat_xyzw)[back]
        ego_hits = self.cast_ego(
            transforms.quat_rotate(to_body, origins_m - motion.position_m[back]),
            transforms.quat_rotate(to_body, directions),
            range_max_m,
        )
        rows = np.flatnonzero(ego_hits.range_m < hits.range_m)
        hits.put(rows, ego_hits.take(rows))
        return hits

    def trace(self, rays: F32, stamps_ns: NDArray[np.int64], timeline: Timeline, range_max_m: float) -> Hits:
        """First hits of N rays on all but the ego, for rays that are already as Embree takes them.

        Args:
            rays: Origins counted from `middle_m` [m] and unit directions, world axes, shape (N, 6).
            stamps_ns: When each ray is cast [ns], shape (N,).
            timeline: Where everything is.
            range_max_m: Hits beyond this distance are dropped [m].
        """
        hits = self._static.trace(rays, range_max_m)
        if len(rays) and len(timeline.catalog):
            self._trace_actors(hits, rays, stamps_ns, timeline, range_max_m)
        return hits

    def cast_town(self, origins_m: Array, directions: Array, range_max_m: float) -> Hits:
        """First hits on the town alone of N rays, given as in `cast`."""
        return self._static.trace(_packed(origins_m - self.middle_m, directions), range_max_m)

    def surfaces(self, origin_m: Array, directions: Array, range_max_m: float) -> tuple[Hits, Array]:
        """First surfaces of the town alone on N rays from one place, and the unit normals of these.

        Args:
            origin_m: Where the rays start [m], world, shape (3,).
            directions: Unit directions, world, shape (N, 3).
            range_max_m: Hits beyond this distance are dropped [m].
        """
        rays = _packed(np.broadcast_to(origin_m - self.middle_m, directions.shape), directions)
        return self._static.facing(rays, range_max_m)

    def cast_ego(
        self, origins_m: Array, directions: Array, range_max_m: float, carried: Mesh | None = None
    ) -> Hits:
        """First hits on the ego's own body alone, and on a mesh that it carries, of N rays in `base_link`."""
        rays, hits = _packed(origins_m, directions), Hits.none(len(origins_m))
        if "ego" in self._library.names:
            hits = self._model(self._library.index("ego")).trace(rays, range_max_m)
        if carried is not None:
            carried_hits = Surface(self._o3d, carried).trace(rays, range_max_m)
            nearer = np.flatnonzero(carried_hits.range_m < hits.range_m)
            hits.put(nearer, carried_hits.take(nearer))
        hits.instance[np.isfinite(hits.range_m)] = EGO_INSTANCE
        return hits

    def _model(self, index: int, steer_step: int = 0) -> Surface:
        key = (index, steer_step)
        if key not in self._models:
            self._models[key] = Surface(self._o3d, steered_mesh(self._library, index, steer_step))
        return self._models[key]

    def _extent(self, index: int) -> Array:
        if index not in self._extents:
            self._extents[index] = self._library.meshes[index].bounds_m.astype(np.float64)
        return self._extents[index]

    def _trace_actors(
        self, hits: Hits, rays: F32, stamps_ns: NDArray[np.int64], timeline: Timeline, range_max_m: float
    ) -> None:
        first, last = int(stamps_ns.min()), int(stamps_ns.max())
        middle = (first + last) // 2
        snapshot, eye = Snapshot.of(timeline, middle), rays[0, :3] + self.middle_m
        models, steer, walking = ray_models(self._library, snapshot, eye)
        limit = np.minimum(hits.range_m, np.float32(range_max_m))
        around = self._cylinders(models, snapshot.actors, 0.5e-9 * (last - first))
        near, actors = candidates(rays[:, :3], rays[:, 3:], limit, around)
        if len(near) == 0:
            return
        position, heading, pitch, roll = timeline.actor_poses(actors, stamps_ns[near])
        upright = (snapshot.catalog.tag == Tag.PEDESTRIAN)[actors]  # walkers stay so on slopes
        pitch[upright] = roll[upright] = 0.0
        kind = models[actors] * _STEER_KINDS + steer[actors] + _STEER_KINDS // 2
        steps = np.flatnonzero(walking[actors])
        if len(steps):
            since_s = np.asarray(1e-9 * (stamps_ns[near[steps]] - middle), dtype=np.float64)
            posture, behind = ray_postures(self._library, snapshot, eye, actors[steps], since_s)
            kind[steps] = posture * _STEER_KINDS + _STEER_KINDS // 2
            position[steps, 0] -= behind * elementary.cos(heading[steps])
            position[steps, 1] -= behind * elementary.sin(heading[steps])
        offset = rays[near, :3].astype(np.float64) - (position - self.middle_m)
        local = into_actor_frame(offset, rays[near, 3:], heading, pitch, roll)
        actor_hits = self._trace_kinds(local, kind, range_max_m)
        actor_hits.instance[:] = snapshot.catalog.id[actors]
        nearer = np.flatnonzero(actor_hits.range_m < hits.range_m[near])
        # Where several actors lie behind each other, the nearest is written last.
        nearer = nearer[np.argsort(-actor_hits.range_m[nearer], kind="stable")]
        hits.put(near[nearer], actor_hits.take(nearer))

    def _trace_kinds(self, local: F32, kind: NDArray[np.intp], range_max_m: float) -> Hits:
        """Hits of rays in their actors' frames, each on the model and steering of its kind."""
        order = np.argsort(kind, kind="stable")
        sorted_kind, sorted_rays = kind[order], local[order]
        parts, borders = [], [0, *(np.flatnonzero(np.diff(sorted_kind)) + 1).tolist(), len(kind)]
        for begin, end in itertools.pairwise(borders):
            model, step = divmod(int(sorted_kind[begin]), _STEER_KINDS)
            surface = self._model(model, step - _STEER_KINDS // 2)
            parts.append((begin, end, surface.trace(sorted_rays[begin:end], range_max_m)))
        hits = Hits.none(len(kind))
        for begin, end, part in parts:
            hits.put(order[begin:end], part)
        return hits

    def _cylinders(self, models: NDArray[np.intp], frame: ActorFrame, half_span_s: float) -> Cylinders:
        """Around all that each actor covers while the rays are cast."""
        kinds, back = np.unique(models, return_inverse=True)
        bounds = np.array([self._extent(int(kind)) for kind in kinds])
        extent = np.maximum(np.abs(bounds[:, 0]), np.abs(bounds[:, 1]))
        length = np.hypot(extent[:, 0], extent[:, 1])[back]
        middle = 0.5 * (bounds[:, 0, 2] + bounds[:, 1, 2])[back]
        half_height = 0.5 * (bounds[:, 1, 2] - bounds[:, 0, 2])[back]
        # Counted from the middle of the town, as rays are.
        lean = sum(
            np.abs(elementary.sin(tilt.astype(np.float64))) for tilt in (frame.pitch_rad, frame.roll_rad)
        )
        centre = frame.position_m - self.middle_m
        centre[:, 2] += middle
        # Half as much again and 15 cm leave room for turns, steered wheels and a walker's other postures.
        travel = np.abs(frame.speed_mps.astype(np.float64)) * half_span_s * 1.5 + 0.15
        return Cylinders(
            centre_m=centre,
            radius_m=length + lean * (middle + half_height) + travel,
            half_height_m=half_height + lean * length + 0.1 + travel * lean,
        )


def _packed(origins_m: Array, directions: Array) -> F32:
    """Rays as Embree takes them, shape (N, 6)."""
    rays = np.empty((len(origins_m), 6), dtype=np.float32)
    rays[:, :3], rays[:, 3:] = origins_m, directions
    return rays


def into_actor_frame(
    offset_m: Array, directions: Floats, heading_rad: Array, pitch_rad: Array, roll_rad: Array
) -> F32:
    """Rays in the axes of actors: origins [m] and directions, shape (M, 6).

    The axes are those of Rz(heading)·Ry(−pitch)·Rx(roll): x forward, y left, z up.

    Args:
        offset_m: Starts of the rays minus the actors' positions [m], world axes, shape (M, 3).
        directions: Directions, world axes, shape (M, 3).
        heading_rad: Headings [rad], shape (M,).
        pitch_rad: Pitches, nose up positive [rad], shape (M,).
        roll_rad: Rolls, left side up positive [rad], shape (M,).
    """
    ch, sh, cp, sp, cr, sr = (
        f(angle.astype(np.float32))
        for angle in (heading_rad, pitch_rad, roll_rad)
        for f in (elementary.cos, elementary.sin)
    )
    local = np.empty((len(offset_m), 6), dtype=np.float32)
    for first, vectors in ((0, offset_m), (3, directions)):
        x, y, z = (vectors[:, k].astype(np.float32) for k in range(3))
        ahead = ch * x + sh * y
        local[:, first] = cp * ahead + sp * z
        left, up = ch * y - sh * x, cp * z - sp * ahead
        local[:, first + 1] = cr * left + sr * up
        local[:, first + 2] = cr * up - sr * left
    return local
