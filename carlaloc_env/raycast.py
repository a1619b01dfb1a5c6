"""Rays against the town and everything that moves in it: the only module that imports open3d.

The static town is one Embree scene. A moving actor is hit in its own frame: the rays that may
meet it are carried there with the actor's pose at each ray's own time, so one model serves all
actors that look like it, nothing is rebuilt between sweeps, and a passing car is sheared as a
rolling sensor sees it.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import geometry
from carlaloc_env.assets.articulation import steered_mesh
from carlaloc_env.assets.ray_placing import ray_models, ray_postures
from carlaloc_env.errors import RaycastError
from carlaloc_env.scene import EGO_INSTANCE, Mesh, ModelLibrary, merge
from carlaloc_env.semantics import Tag
from carlaloc_env.timeline import ActorFrame, Timeline

Array = NDArray[np.float64]
F32 = NDArray[np.float32]

_SECTORS = 2048
"""Azimuth sectors into which rays are sorted, so that an actor looks at few of them."""
_STEER_KINDS = 64
"""More than the angles of front wheels that are told apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hits:
    """The first surface along each of N rays."""

    range_m: F32
    """Distance along the ray [m], inf where nothing was hit, shape (N,)."""
    tag: NDArray[np.uint8]
    """Semantic `Tag` of the surface, shape (N,)."""
    instance: NDArray[np.uint32]
    """Instance id of the surface, 0 = none, shape (N,)."""
    material: NDArray[np.uint8]
    """`Material` of the surface, shape (N,)."""
    cos_incidence: F32
    """Cosine between the ray and the surface normal, 0 (grazing) to 1, shape (N,)."""

    def __len__(self) -> int:
        return len(self.range_m)

    @classmethod
    def none(cls, count: int) -> Hits:
        """Rays that met nothing."""
        return cls(
            range_m=np.full(count, np.inf, np.float32),
            tag=np.zeros(count, np.uint8),
            instance=np.zeros(count, np.uint32),
            material=np.zeros(count, np.uint8),
            cos_incidence=np.zeros(count, np.float32),
        )

    def put(self, rows: NDArray[np.intp] | slice, other: Hits) -> None:
        """Overwrite some rows, shape (M,), by the hits of M other rays."""
        for name in self.__slots__:
            getattr(self, name)[rows] = getattr(other, name)

    def take(self, rows: NDArray[Any]) -> Hits:
        """Hits of some of the rays, by index or mask."""
        return Hits(**{name: getattr(self, name)[rows] for name in self.__slots__})


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
        self._o3d = _import_open3d()
        self._library = library
        town = merge(static)
        # Embree computes in float32: metres counted from the middle keep the town's far corners exact.
        self._middle = (
            np.round(town.bounds_m.mean(axis=0, dtype=np.float64)) if len(town.triangles) else np.zeros(3)
        )
        self._static = _Surface(self._o3d, _moved(town, -self._middle))
        self._models: dict[tuple[int, int], _Surface] = {}
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
        if len(origins_m) == 0:
            return Hits.none(0)
        hits = self._static.cast(origins_m - self._middle, directions, range_max_m)
        if len(timeline.catalog):
            self._cast_actors(hits, origins_m, directions, stamps_ns, timeline, range_max_m)
        if ego:
            self._cast_ego(hits, origins_m, directions, stamps_ns, timeline, range_max_m)
        return hits

    def cast_ego(self, origins_m: Array, directions: Array, range_max_m: float) -> Hits:
        """First hits on the ego's own body alone, of N rays given in `base_link`."""
        if "ego" not in self._library.names:
            return Hits.none(len(origins_m))
        hits = self._model(self._library.index("ego")).cast(origins_m, directions, range_max_m)
        hits.instance[np.isfinite(hits.range_m)] = EGO_INSTANCE
        return hits

    def _model(self, index: int, steer_step: int = 0) -> _Surface:
        key = (index, steer_step)
        if key not in self._models:
            self._models[key] = _Surface(self._o3d, steered_mesh(self._library, index, steer_step))
        return self._models[key]

    def _extent(self, index: int) -> Array:
        if index not in self._extents:
            self._extents[index] = self._library.meshes[index].bounds_m.astype(np.float64)
        return self._extents[index]

    def _cast_ego(
        self,
        hits: Hits,
        origins_m: Array,
        directions: Array,
        stamps_ns: NDArray[np.int64],
        timeline: Timeline,
        range_max_m: float,
    ) -> None:
        times, back = np.unique(stamps_ns, return_inverse=True)
        motion = timeline.ego_motion(times)
        turn = geometry.quat_conjugate(motion.quat_xyzw)[back]
        found = self.cast_ego(
            geometry.quat_rotate(turn, origins_m - motion.position_m[back]),
            geometry.quat_rotate(turn, directions),
            range_max_m,
        )
        rows = np.flatnonzero(found.range_m < hits.range_m)
        hits.put(rows, found.take(rows))

    def _cast_actors(
        self,
        hits: Hits,
        origins_m: Array,
        directions: Array,
        stamps_ns: NDArray[np.int64],
        timeline: Timeline,
        range_max_m: float,
    ) -> None:
        first, last = int(stamps_ns.min()), int(stamps_ns.max())
        middle = (first + last) // 2
        frame, catalog, eye = timeline.actors_at(middle), timeline.catalog, origins_m[0]
        models, steer, walking = ray_models(catalog, frame, self._library, eye)
        limit = np.minimum(hits.range_m, np.float32(range_max_m))
        around = self._cylinders(models, frame, 0.5e-9 * (last - first))
        rays, actors = candidates(origins_m, directions, limit, around)
        if len(rays) == 0:
            return
        position, heading, pitch = timeline.actor_poses(actors, stamps_ns[rays])
        pitch[(catalog.tag == Tag.PEDESTRIAN)[actors]] = 0.0  # walkers stay upright
        kind = models[actors] * _STEER_KINDS + steer[actors] + _STEER_KINDS // 2
        steps = np.flatnonzero(walking[actors])
        if len(steps):
            since_s = np.asarray(1e-9 * (stamps_ns[rays[steps]] - middle), dtype=np.float64)
            posture, behind = ray_postures(catalog, frame, self._library, eye, actors[steps], since_s)
            kind[steps] = posture * _STEER_KINDS + _STEER_KINDS // 2
            position[steps, 0] -= behind * np.cos(heading[steps])
            position[steps, 1] -= behind * np.sin(heading[steps])
        local = into_actor_frame(origins_m[rays] - position, directions[rays], heading, pitch)
        found = self._trace_kinds(local, kind, range_max_m)
        found.instance[:] = catalog.id[actors]
        nearer = np.flatnonzero(found.range_m < hits.range_m[rays])
        # Where several actors lie behind each other, the nearest is written last.
        nearer = nearer[np.argsort(-found.range_m[nearer], kind="stable")]
        hits.put(rays[nearer], found.take(nearer))

    def _trace_kinds(self, local: F32, kind: NDArray[np.intp], range_max_m: float) -> Hits:
        """Hits of rays in their actors' frames, each on the model and steering of its kind."""
        order = np.argsort(kind, kind="stable")
        sorted_kind, sorted_rays = kind[order], local[order]
        parts, borders = [], [0, *(np.flatnonzero(np.diff(sorted_kind)) + 1).tolist(), len(kind)]
        for begin, end in itertools.pairwise(borders):
            model, step = divmod(int(sorted_kind[begin]), _STEER_KINDS)
            surface = self._model(model, step - _STEER_KINDS // 2)
            parts.append((begin, end, surface.trace(sorted_rays[begin:end], range_max_m)))
        found = Hits.none(len(kind))
        for begin, end, part in parts:
            found.put(order[begin:end], part)
        return found

    def _cylinders(self, models: NDArray[np.intp], frame: ActorFrame, half_span_s: float) -> Cylinders:
        """Around all that each actor covers while the rays are cast."""
        kinds, back = np.unique(models, return_inverse=True)
        bounds = np.array([self._extent(int(kind)) for kind in kinds])
        reach = np.maximum(np.abs(bounds[:, 0]), np.abs(bounds[:, 1]))
        length = np.hypot(reach[:, 0], reach[:, 1])[back]
        middle = 0.5 * (bounds[:, 0, 2] + bounds[:, 1, 2])[back]
        half_height = 0.5 * (bounds[:, 1, 2] - bounds[:, 0, 2])[back]
        lean = np.abs(np.sin(frame.pitch_rad.astype(np.float64)))
        centre = frame.position_m.astype(np.float64)
        centre[:, 2] += middle
        # Half as much again and 15 cm leave room for turns, steered wheels and a walker's other postures.
        travel = np.abs(frame.speed_mps.astype(np.float64)) * half_span_s * 1.5 + 0.15
        return Cylinders(
            centre_m=centre,
            radius_m=length + lean * (middle + half_height) + travel,
            half_height_m=half_height + lean * length + 0.1 + travel * lean,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cylinders:
    """Upright cylinders, parallel arrays of A."""

    centre_m: Array
    """Middles [m], shape (A, 3)."""
    radius_m: Array
    """Radii [m], shape (A,)."""
    half_height_m: Array
    """Half heights [m], shape (A,)."""


class _Surface:
    """Triangles in one frame: an Embree tree, and material, tag and instance of every triangle."""

    def __init__(self, o3d: ModuleType, mesh: Mesh) -> None:
        self._tensor = o3d.core.Tensor.from_numpy
        self._scene: Any = o3d.t.geometry.RaycastingScene() if len(mesh.triangles) else None
        corner = mesh.triangles[:, 0]
        self._material, self._tag = mesh.material[corner], mesh.tag[corner]
        self._instance = mesh.instance[corner]
        if self._scene is not None:
            triangles = np.ascontiguousarray(mesh.triangles, dtype=np.uint32)
            vertices = np.ascontiguousarray(mesh.vertices_m, dtype=np.float32)
            self._scene.add_triangles(self._tensor(vertices), self._tensor(triangles))

    def cast(self, origins_m: Array, directions: Array, range_max_m: float) -> Hits:
        """First hits of N rays given in the frame of the triangles."""
        rays = np.empty((len(origins_m), 6), dtype=np.float32)
        rays[:, :3], rays[:, 3:] = origins_m, directions
        return self.trace(rays, range_max_m)

    def trace(self, rays: F32, range_max_m: float) -> Hits:
        """First hits of rays given as origins [m] and directions, shape (N, 6)."""
        if self._scene is None or len(rays) == 0:
            return Hits.none(len(rays))
        answer = self._scene.cast_rays(self._tensor(rays))
        # The arrays belong to the answer, which lives no longer than this call.
        distance = answer["t_hit"].numpy().copy()
        missed = np.flatnonzero(~(distance <= np.float32(range_max_m)))
        triangle = answer["primitive_ids"].numpy().astype(np.intp)
        triangle[missed] = 0
        normal = answer["primitive_normals"].numpy()
        cosine = np.abs(normal[:, 0] * rays[:, 3] + normal[:, 1] * rays[:, 4] + normal[:, 2] * rays[:, 5])
        hits = Hits(
            range_m=distance,
            tag=self._tag[triangle],
            instance=self._instance[triangle],
            material=self._material[triangle],
            cos_incidence=np.minimum(cosine, np.float32(1.0)),
        )
        hits.put(missed, Hits.none(len(missed)))
        return hits


def _moved(mesh: Mesh, by_m: Array) -> Mesh:
    return dataclasses.replace(mesh, vertices_m=(mesh.vertices_m + by_m).astype(np.float32))


def candidates(
    origins_m: Array, directions: Array, limit_m: F32, cylinders: Cylinders
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All (ray, cylinder) pairs that may meet.

    Rays are sorted into azimuth sectors once; each cylinder then tests only the rays of the sectors
    that it covers, seen from where the rays start. Rays may start anywhere in a small volume, by
    which the cylinders are grown.

    Args:
        origins_m: Starts [m], shape (N, 3).
        directions: Unit directions, shape (N, 3).
        limit_m: How far each ray reaches [m], shape (N,).
        cylinders: Upright cylinders, one per actor.

    Returns:
        Ray indices (M,) and actor indices (M,), grouped by actor.
    """
    lowest = np.array([origins_m[:, k].min() for k in range(3)])
    highest = np.array([origins_m[:, k].max() for k in range(3)])
    eye, spread = 0.5 * (lowest + highest), 0.5 * (highest - lowest)
    away = cylinders.centre_m - eye
    reach = cylinders.radius_m + math.hypot(spread[0], spread[1]) + 0.01
    tall = cylinders.half_height_m + spread[2] + 0.01
    near = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) - reach < float(limit_m.max()))
    order, first = _sectors(directions)
    rows, actor = _rows_in_sectors(away[near], reach[near], first)
    rays, actor = order[rows], near[actor]
    # In the plan: where the ray passes nearest to the axis, and how far from it; then its height there.
    x, y, z = (away.astype(np.float32)[:, k][actor] for k in range(3))
    d = directions.astype(np.float32)
    flat = np.maximum(np.hypot(d[:, 0], d[:, 1]), np.float32(1e-3))
    east, north, slope = ((d[:, k] / flat)[rays] for k in range(3))
    around, high = reach.astype(np.float32)[actor], tall.astype(np.float32)[actor]
    along = x * east + y * north
    meets = np.abs(x * north - y * east) < around
    meets &= (along > -around) & (along - around < (limit_m * flat)[rays])
    meets &= np.abs(slope * along - z) < high + np.abs(slope) * around
    return rays[meets], actor[meets]


def _sectors(directions: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Ray indices sorted by azimuth sector (N,), and where each sector begins (sectors + 1,)."""
    azimuth = np.arctan2(directions[:, 1].astype(np.float32), directions[:, 0].astype(np.float32))
    sector = ((azimuth + np.float32(np.pi)) * np.float32(_SECTORS / (2 * np.pi))).astype(np.int32)
    sector = np.clip(sector, 0, _SECTORS - 1).astype(np.uint16)
    order = np.argsort(sector, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(sector, minlength=_SECTORS))])
    return order, first.astype(np.intp)


def _rows_in_sectors(
    away_m: Array, reach_m: Array, first: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of the sorted rays that each sphere's sectors hold, and the sphere of each row."""
    flat = np.hypot(away_m[:, 0], away_m[:, 1])
    half = np.where(flat > reach_m, np.arcsin(np.minimum(reach_m / np.maximum(flat, 1e-9), 1.0)), np.pi)
    middle = (np.arctan2(away_m[:, 1], away_m[:, 0]) + np.pi) * (_SECTORS / (2 * np.pi))
    width = half * (_SECTORS / (2 * np.pi)) + 1.0
    low = np.floor(middle - width).astype(np.intp)
    count = np.minimum(np.ceil(middle + width).astype(np.intp) - low + 1, _SECTORS)
    # The circle laid out three times, so that a range of sectors never wraps.
    rays = first[-1]
    around = np.concatenate([first[:-1], first[:-1] + rays, first[:-1] + 2 * rays, [3 * rays]])
    begin, end = around[low + _SECTORS], around[low + _SECTORS + count]
    length = end - begin
    actor = np.repeat(np.arange(len(length)), length)
    offset = np.arange(len(actor)) - np.repeat(np.cumsum(length) - length, length)
    return (begin[actor] + offset) % max(rays, 1), actor


def into_actor_frame(offset_m: Array, directions: Array, heading_rad: Array, pitch_rad: Array) -> F32:
    """Rays in the axes of actors: origins [m] and directions, shape (M, 6).

    The axes are those of Rz(heading)·Ry(−pitch): x forward, y left, z up, nose up positive.

    Args:
        offset_m: Starts of the rays minus the actors' positions [m], world axes, shape (M, 3).
        directions: Directions, world axes, shape (M, 3).
        heading_rad: Headings [rad], shape (M,).
        pitch_rad: Pitches, nose up positive [rad], shape (M,).
    """
    ch, sh, cp, sp = (
        f(angle.astype(np.float32)) for angle in (heading_rad, pitch_rad) for f in (np.cos, np.sin)
    )
    local = np.empty((len(offset_m), 6), dtype=np.float32)
    for first, vectors in ((0, offset_m), (3, directions)):
        x, y, z = (vectors[:, k].astype(np.float32) for k in range(3))
        ahead = ch * x + sh * y
        local[:, first] = cp * ahead + sp * z
        local[:, first + 1] = ch * y - sh * x
        local[:, first + 2] = cp * z - sp * ahead
    return local


def _import_open3d() -> ModuleType:
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise RaycastError(
            f"LiDAR needs open3d, which does not load ({error}); run: pip install open3d, "
            "and on Debian or Ubuntu: apt-get install libgomp1 libusb-1.0-0"
        ) from error
    module: ModuleType = open3d
    return module
