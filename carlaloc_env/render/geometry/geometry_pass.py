"""Filling a G-buffer: parts of the scene that are drawn, their order, and the programs that draw them."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.freed_memory import give_back_mapped_pages
from carlaloc_env.render.geometry.distant_models import Distant, levels
from carlaloc_env.render.geometry.gbuffer import SKY_ID, Targets
from carlaloc_env.render.geometry.instance_buffer import InstanceBuffer
from carlaloc_env.render.geometry.level_of_detail import (
    CELL_M,
    FAR,
    FAR_LOW,
    FAR_LOW_FOCAL_PX,
)
from carlaloc_env.render.geometry.material_tables import block_tables, surface_table, upload_textures
from carlaloc_env.render.geometry.mesh_buffers import MeshBuffers
from carlaloc_env.render.geometry.occlusion_culling import Depths, box_corners
from carlaloc_env.render.geometry.packed_meshes import packed_models
from carlaloc_env.render.geometry.static_scene import LEVEL_FROM, StaticScene, mesh_boxes
from carlaloc_env.render.geometry.triangle_culling import TriangleCuller
from carlaloc_env.render.gl_context import is_software
from carlaloc_env.render.shader_programs import Programs, set_uniforms
from carlaloc_env.render.views import FAR_M, NEAR_M, CameraView
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary

NEAR_ROUND_M = 25.0
"""Nearer things are drawn before large walls and roads, so that these are not shaded behind them [m]."""
MIDDLE_ROUND_M = 60.0
"""Bound between the two last rounds, in which only what is not hidden by then is drawn [m]."""
LEAST_PX = 3.0
"""Clusters that look smaller are left out of live pictures [px]."""
SMALL_PICTURE_PX = 20_000
"""In live pictures of fewer pixels what hides is not looked for, which takes longer than drawing it [px]."""
SHADOW_LEAST_PX = 6.0
"""In live pictures models that look smaller throw none [px]."""
LARGE_M = 120.0
"""Walls and roads nearer than this are drawn before other things, since they hide much [m]."""
DEPTH_RANGE = ((FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M))
"""Clip depth = first · z + second."""

_SHADED_BY_NAME = (
    Material.CAR_PAINT, Material.CLOTH, Material.LEAF, Material.CURTAIN_WALL, Material.CROP, Material.GRASS,
    Material.RUBBLE,
)  # fmt: skip
"""Materials that ``gbuffer.vert`` and ``gbuffer.frag`` name."""

Sway = tuple[float, float, float, float]
"""Greatest displacement of leaves by the wind [m] (3), and time [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Round:
    """Part of the scene that is drawn at once."""

    clusters: Index
    """Clusters of scenery, nearest first."""
    instances: Index
    """Movable models, nearest first; drawn before the scenery."""
    looks: bool
    """Whether what has been drawn so far is read back before, to leave out what it hides."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """Rounds in which the scene will be drawn, from near to far."""

    view: CameraView
    """Camera."""
    instances: Instances
    """Movable models."""
    rounds: list[Round]
    """Parts of models and scenery, in the order of drawing."""


class GeometryPass:
    """Draws all geometry as one camera sees it, without hidden parts.

    Args:
        context: Where it is drawn.
        programs: Shader programs of the context.
        chunks: Static scenery in squares of some tens of metres.
        library: Movable models.
        albedo: Linear albedo and roughness of every material, shape (M, S, S, 4).
        live: Less detail, for a live window.
        unit_m: Metres of the world in one unit of the geometry, by which wear is sized.
    """

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        *,
        chunks: list[Mesh],
        library: ModelLibrary,
        albedo: NDArray[np.float16],
        live: bool = False,
        unit_m: float = 1.0,
    ) -> None:
        self._context, self._programs = context, programs
        self.scenery = StaticScene(context, chunks, *((FAR_LOW, CELL_M) if live else (FAR,)))
        self._live = live
        self._unit_m = unit_m
        self._distant = Distant(library) if live else None
        simpler = [] if self._distant is None else self._distant.simplified
        meshes = [*library.meshes, *(library.meshes[k] for k, _ in simpler)]
        self._library = MeshBuffers(context, packed_models(library.meshes, simpler))
        self._least_px = LEAST_PX if live else 0.0
        self._poses = InstanceBuffer(context, len(meshes))
        self._radius_m = np.array([_reach_m(mesh) for mesh in meshes], dtype=np.float64)
        self._size_m = 2.0 * self._radius_m[[] if self._distant is None else self._distant.measured]
        self._low_m, self._high_m = mesh_boxes(meshes)
        self._textures = upload_textures(programs, albedo, trilinear=not is_software(context))
        give_back_mapped_pages(albedo)
        self._surface = surface_table()
        self._blocks, self._variety = block_tables()
        self._ready: dict[tuple[str, ...], moderngl.Program] = {}
        self._flush_target = context.simple_framebuffer((1, 1))

    def simplified(self, instances: Instances, view: CameraView) -> Instances:
        """The instances as they are drawn from here: in live pictures simple ones where they look small."""
        if self._distant is None:
            return instances
        level = np.maximum(levels(self._size_px(instances, view)), _is_small(view))
        return self._distant.of(instances, level)

    def _size_px(self, instances: Instances, view: CameraView) -> Array:
        """Size in the picture of spheres round instances, or round their cars [px], shape (N,)."""
        return np.asarray(self._size_m[instances.model] * view.camera.fx_px / distance_m(instances, view))

    def plan(self, view: CameraView, instances: Instances, occluders: Depths | None = None) -> Plan:
        """Choose and order the parts to draw; nothing is drawn yet.

        Args:
            view: Camera.
            instances: Movable models.
            occluders: Depths that hide other things, of the picture before; read back from the half-drawn
                picture when left out.
        """
        clusters, away = self.scenery.in_view(view, farther=self._farther(view))
        seen = self._visible_instances(view, instances)
        if occluders is not None:
            shown = self._shown(occluders, clusters)
            clusters, away = clusters[shown], away[shown]
            seen = seen[occluders.shown(self._corners_m(instances, seen))]
        table = self.scenery.clusters
        large, culled = table.large[clusters], table.culled[clusters]
        if occluders is not None:
            # Depths are there already: one round is enough for the rest.
            first = np.where(large, away < LARGE_M, culled & (away < NEAR_ROUND_M))
            none = np.zeros(0, np.intp)
            rounds = [
                Round(clusters=clusters[first], instances=none, looks=False),
                Round(clusters=clusters[~first], instances=seen, looks=False),
            ]
        elif self._live and _is_small(view):
            rounds = [Round(clusters=clusters, instances=seen, looks=False)]
        else:
            turn = np.where(large & (away < LARGE_M), 1, _turn(away))
            later = _turn(distance_m(instances, view)[seen])
            rounds = [
                Round(clusters=clusters[turn == now], instances=seen[later == now], looks=now > 1)
                for now in range(4)
            ]
        return Plan(view=view, instances=instances, rounds=rounds)

    def fill(self, plan: Plan, targets: Targets, sway: Sway) -> None:
        """Draw what has been planned.

        Args:
            plan: Parts to draw.
            targets: Textures to draw into; cleared before.
            sway: Greatest displacement of leaves by the wind [m] (3), and time [s].
        """
        context = self._context
        targets.framebuffer.use()
        targets.clear()
        self._textures.use(0)
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        # The picture is drawn upside down in OpenGL's eyes, which turns the triangles round.
        context.front_face = "cw"
        context.cull_face = "back"
        sorts = dict.fromkeys(layer.features for layer in self.scenery.layers)
        programs = {features: self._program(plan.view, sway, *features) for features in sorts}
        hidden: Depths | None = None
        culler = TriangleCuller(plan.view)
        for now, part in enumerate(plan.rounds):
            if now == 1 and not part.looks:
                self.wake()
                targets.framebuffer.use()
            if part.looks:
                hidden = Depths(plan.view, _read_depth(targets))
                culler = TriangleCuller(plan.view, hidden)
            self._draw_instances(plan, part.instances, sway, hidden, culler)
            shown = part.clusters if hidden is None else part.clusters[self._shown(hidden, part.clusters)]
            self._draw_layers(programs, shown, culler, still=not any(sway[:3]))
        context.front_face = "ccw"

    def _draw_instances(
        self, plan: Plan, which: Index, sway: Sway, hidden: Depths | None, culler: TriangleCuller
    ) -> None:
        if hidden is not None:
            which = which[hidden.shown(self._corners_m(plan.instances, which))]
        if len(which):
            self._poses.fill(plan.instances, which)
            program = self._program(plan.view, sway, "INSTANCED")
            self._library.draw(program, self._poses.used, instances=self._poses, culler=culler)

    def casters(self, instances: Instances, view: CameraView) -> Casters:
        """Instances as what throws shadows; in live pictures without those that look small."""
        if self._distant is not None:
            large = np.flatnonzero(self._size_px(instances, view) >= SHADOW_LEAST_PX)
            instances = self._distant.of(instances.take(large), 1 + _is_small(view))
        return Casters(library=self._library, poses=self._poses, instances=instances, radius_m=self._radius_m)

    def wake(self) -> None:
        """Let a software driver begin with the commands so far while the others follow.

        llvmpipe gathers triangles until the framebuffer changes, and only then wakes its threads.
        """
        self._flush_target.use()
        self._flush_target.clear()

    def _farther(self, view: CameraView) -> float:
        """Factor on the distance of things in live pictures, whose pixels are large."""
        return FAR_LOW_FOCAL_PX / view.camera.fx_px if self._live else 1.0

    def _shown(self, hidden: Depths, clusters: Index) -> NDArray[np.bool_]:
        table = self.scenery.clusters
        boxes = box_corners(table.low_m[clusters], table.high_m[clusters])
        return hidden.shown(boxes, least_px=self._least_px)

    def _draw_layers(
        self,
        programs: dict[tuple[str, ...], moderngl.Program],
        clusters: Index,
        culler: TriangleCuller,
        *,
        still: bool,
    ) -> None:
        which = self.scenery.by_layer(clusters)
        for layer, some in zip(self.scenery.layers, which, strict=True):
            if not len(some):
                continue
            if layer.culled:
                self._context.enable(moderngl.CULL_FACE)
            else:
                self._context.disable(moderngl.CULL_FACE)
            # Leaves that sway are not where they are in memory.
            may_sway = not still and not layer.culled
            layer.geometry.draw(programs[layer.features], some, culler=None if may_sway else culler)
        self._context.disable(moderngl.CULL_FACE)

    def _corners_m(self, instances: Instances, which: Index) -> Array:
        """Corners of the boxes of some instances in the world [m], shape (N, 8, 3)."""
        model, T = instances.model[which], instances.T_world_model[which]
        local = box_corners(self._low_m[model], self._high_m[model])
        turned = np.sum(T[:, None, :3, :3] * local[:, :, None, :], axis=3)
        return np.asarray(turned + T[:, None, :3, 3], dtype=np.float64)

    def _visible_instances(self, view: CameraView, instances: Instances) -> Index:
        """Instances whose sphere reaches into the view, nearest first."""
        centre = instances.T_world_model[:, :3, 3]
        reach = self._radius_m[instances.model]
        planes = view.planes()
        gap = np.sum(centre[:, None] * planes[None, :, :3], axis=2) + planes[:, 3]
        distance = distance_m(instances, view)
        seen = np.flatnonzero((gap > -reach[:, None]).all(axis=1) & (distance - reach < FAR_M))
        return seen[np.argsort(distance[seen], kind="stable")]

    def _program(self, view: CameraView, sway: Sway, *features: str) -> moderngl.Program:
        if any(sway[:3]):
            features = ("SWAY", *features)
        if features not in self._ready:
            self._ready[features] = self._with_tables(features)
        program = self._ready[features]
        set_uniforms(
            program,
            u_eye=tuple(view.position_m),
            u_rotation=view.R_camera_world.T.astype("<f4").tobytes(),
            u_clip=view.clip_scale,
            u_sway=sway,
        )
        return program

    def _with_tables(self, features: tuple[str, ...]) -> moderngl.Program:
        """A program with what is the same in every picture."""
        defines = (
            f"MATERIALS {len(self._surface)}",
            *(f"{material.name} {int(material)}u" for material in _SHADED_BY_NAME),
            f"SKY_ID {SKY_ID}u",
            f"UNIT_M {float(self._unit_m)}",
            f"LEVEL_FROM {LEVEL_FROM}",
            f"MOST_PLACES {1 if self._live else 16}",
        )
        program = self._programs.get("gbuffer.vert", "gbuffer.frag", *defines, *features)
        set_uniforms(
            program,
            u_textures=0,
            u_range=DEPTH_RANGE,
            u_surface=self._surface.tobytes(),
            u_blocks=self._blocks.tobytes(),
            u_variety=self._variety.tobytes(),
        )
        return program

    def release(self) -> None:
        """Free the buffers and textures."""
        self.scenery.release()
        self._library.release()
        self._poses.release()
        self._textures.release()
        target = self._flush_target
        for part in (target, *target.color_attachments, target.depth_attachment):
            part.release()


def _is_small(view: CameraView) -> bool:
    return bool(np.prod(view.size_px) < SMALL_PICTURE_PX)


def _reach_m(mesh: Mesh) -> float:
    """Distance of a mesh's farthest vertex from its origin [m]."""
    squares = sum(axis.astype(np.float64) ** 2 for axis in mesh.vertices_m.T)
    return float(np.sqrt(np.max(squares, initial=0.0)))


def _turn(away_m: Array) -> Index:
    """Rounds of small things at a distance (N,); large walls and roads are drawn in the second."""
    return np.array([0, 2, 3])[np.searchsorted((NEAR_ROUND_M, MIDDLE_ROUND_M), away_m, side="right")]


def distance_m(instances: Instances, view: CameraView) -> Array:
    """Distance of instances from the eye [m], shape (N,)."""
    away = instances.T_world_model[:, :3, 3] - view.position_m
    return np.asarray(np.sqrt(np.sum(away**2, axis=1)), dtype=np.float64)


def _read_depth(targets: Targets) -> NDArray[np.float32]:
    width, height = targets.depth.size
    return np.frombuffer(targets.depth.read(), dtype=np.float32).reshape(height, width)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Casters:
    """Movable models that throw shadows."""

    library: MeshBuffers
    poses: InstanceBuffer
    """Room for their poses."""
    instances: Instances
    radius_m: Array
    """How far each model of the library reaches from its origin [m], shape (M,)."""
