"""The renderer: geometry drawn once into a G-buffer, shaded once per weather."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

import cv2
import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.errors import ConfigError, unknown_name
from carlaloc_env.materials import Material
from carlaloc_env.pinhole import Pinhole
from carlaloc_env.render.context import Programs, create_context, is_software, set_uniforms
from carlaloc_env.render.distant import Distant
from carlaloc_env.render.gbuffer import SKY_ID, GBuffer, TargetPool, Targets
from carlaloc_env.render.geometry import FAR, FAR_LOW, Geometry, InstanceBuffer
from carlaloc_env.render.occlusion import Depths, box_corners
from carlaloc_env.render.projection import FAR_M, NEAR_M, View
from carlaloc_env.render.scenery import Scenery
from carlaloc_env.render.shading import Shader
from carlaloc_env.render.shadow import Casters
from carlaloc_env.render.surfaces import surface_table, upload_textures
from carlaloc_env.render.textures.build import build_textures
from carlaloc_env.scene import Instances, Mesh, ModelLibrary
from carlaloc_env.weather import WeatherParameters

QUALITIES = ("low", "medium", "high")
"""One sample per pixel; the same with a lens blur of 0.5 px; 2×2 samples resolved before shading."""

SWAY_S = 0.012
"""Way of leaves per wind speed [s]: 0.18 m in a storm of 15 m/s."""
SWAY_PERIOD_NS = 1_000_000_000_000
"""Shaders count time in single precision; so long after its beginning the leaves jump back [ns]."""
ACTOR_SHADOW_RANGE_M = 90.0
ROUNDS_M = (25.0, 60.0)
"""Bounds of the rounds in which the scene is drawn [m]."""
LEAST_PX = 3.0
"""Clusters that look smaller are left out of live pictures [px]."""
LARGE_M = 120.0
"""Walls and roads nearer than this are drawn in the first round, since they hide much [m]."""
DEPTH_RANGE = ((FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M))
"""Clip depth = first · z + second."""


class SceneRenderer:
    """Draws a static scene and movable models; owns an OpenGL context of its own.

    The same call gives the same bytes, whatever was drawn before.
    """

    def __init__(
        self,
        chunks: Sequence[Mesh],
        library: ModelLibrary,
        *,
        quality: str = "medium",
        lamps_m: ArrayLike | None = None,
        albedo: NDArray[np.float16] | None = None,
    ) -> None:
        """Upload a scene.

        Args:
            chunks: Static scenery in squares of some tens of metres, culled one by one.
            library: Movable models.
            quality: One of `QUALITIES`.
            lamps_m: Street lamps in the world [m], shape (K, 3).
            albedo: Linear albedo and roughness of every material, shape (M, S, S, 4); the built-in
                textures when left out.

        Raises:
            RenderError: there is no OpenGL here.
            ConfigError: the quality is not one of `QUALITIES`.
        """
        if quality not in QUALITIES:
            raise ConfigError(unknown_name("render quality", quality, QUALITIES))
        self.quality = quality
        self._subsamples = 2 if quality == "high" else 1
        self._context = create_context()
        with self._context:
            self._programs = Programs(self._context)
            self._pool = TargetPool(self._context)
            self._upload(chunks, library, albedo)
            lamps = np.zeros((0, 3)) if lamps_m is None else np.asarray(lamps_m, np.float64).reshape(-1, 3)
            self._shader = Shader(
                self._context,
                self._programs,
                scenery=self._scenery,
                library=library,
                lamps_m=lamps,
                live=quality == "low",
            )
        self._sway = (0.0, 0.0, 0.0, 0.0)
        self._closed = False

    def _upload(
        self, chunks: Sequence[Mesh], library: ModelLibrary, albedo: NDArray[np.float16] | None
    ) -> None:
        self._scenery = Scenery(self._context, chunks, FAR_LOW if self.quality == "low" else FAR)
        self._library = Geometry(self._context, library.meshes)
        self._distant = Distant(library) if self.quality == "low" else None
        self._least_px = LEAST_PX if self.quality == "low" else 0.0
        self._poses = InstanceBuffer(self._context, len(library))
        reach = [
            np.sqrt(np.max(np.sum(mesh.vertices_m.astype(np.float64) ** 2, axis=1), initial=0.0))
            for mesh in library.meshes
        ]
        self._reach_m = np.array(reach, dtype=np.float64)
        bounds = [mesh.bounds_m if len(mesh.vertices_m) else np.zeros((2, 3)) for mesh in library.meshes]
        self._model_low_m, self._model_high_m = np.moveaxis(
            np.array(bounds, np.float64).reshape(-1, 2, 3), 1, 0
        )
        if albedo is None:
            albedo = build_textures().albedo
        self._textures = upload_textures(self._context, albedo, trilinear=not is_software(self._context))
        self._surface = surface_table()

    @property
    def driver(self) -> str:
        """Name and version of the OpenGL driver; pictures are the same bytes on the same driver."""
        return f"{self._context.info['GL_RENDERER']}, OpenGL {self._context.info['GL_VERSION']}"

    def draw(
        self,
        camera: Pinhole,
        T_world_camera: ArrayLike,
        instances: Instances,
        *,
        velocity_mps: ArrayLike = (0.0, 0.0, 0.0),
        wind_mps: ArrayLike = (0.0, 0.0, 0.0),
        stamp_ns: int = 0,
    ) -> GBuffer:
        """What a camera sees, before any weather.

        Args:
            camera: Intrinsics.
            T_world_camera: Pose of the optical frame, shape (4, 4).
            instances: Movable models.
            velocity_mps: Velocity of the camera in the world, shape (3,); streaks of rain slant with it.
            wind_mps: Wind that sways leaves, shape (3,); still by default, since LiDARs see still leaves
                and all weathers of a drive share their geometry.
            stamp_ns: Time of the picture [ns]; tells where the leaves are.
        """
        self._sway = (*(SWAY_S * np.asarray(wind_mps, dtype=np.float64)), stamp_ns % SWAY_PERIOD_NS * 1e-9)
        view = View.of(camera, T_world_camera, self._subsamples, velocity_mps)
        distance = _distance_m(instances, view)
        if self._distant is not None:
            instances = self._distant.of(instances, distance)
            distance = _distance_m(instances, view)
        with self._context:
            targets = self._pool.take(view.size_px, smooth=self._subsamples > 1)
            self._fill(view, targets, instances)
            shaded = targets
            if self._subsamples > 1:
                shaded = self._pool.take((camera.width_px, camera.height_px), resolved=True)
                self._shader.resolve(view, targets, shaded)
        near = _take(instances, np.flatnonzero(distance < ACTOR_SHADOW_RANGE_M))
        gbuffer = GBuffer(context=self._context, view=view, drawn=targets, shaded=shaded, actors=near)
        self._pool.give_back_with(gbuffer)
        return gbuffer

    def shade(
        self, gbuffer: GBuffer, weather: WeatherParameters, *, stamp_ns: int = 0, seed: int = 0
    ) -> NDArray[np.uint8]:
        """Colour picture under a weather, sRGB, shape (H, W, 3).

        Args:
            gbuffer: What `draw` returned.
            weather: Light and air.
            stamp_ns: Time of the picture [ns]; keys its dither, and tells where the rain is.
            seed: Seed of dither and rain.
        """
        with self._context:
            rgba = self._shader.shade(gbuffer, weather, self._shadow_casters(gbuffer), stamp_ns, seed)
        rgb = cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB)
        if self.quality == "medium":
            cv2.GaussianBlur(rgb, (3, 3), 0.5, dst=rgb, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(rgb, dtype=np.uint8)

    def radiance_cd_m2(
        self, gbuffer: GBuffer, weather: WeatherParameters, *, stamp_ns: int | None = None, seed: int = 0
    ) -> NDArray[np.float32]:
        """Linear BT.709 luminance before exposure [cd/m²], shape (H, W, 3).

        Args:
            gbuffer: What `draw` returned.
            weather: Light and air.
            stamp_ns: Time of the picture [ns]; None leaves falling drops out, which no warp of a picture
                by the motion of surfaces can follow.
            seed: Seed of the rain.
        """
        with self._context:
            casters = self._shadow_casters(gbuffer)
            return self._shader.radiance_cd_m2(gbuffer, weather, casters, stamp_ns, seed)

    def rain_cd_m2(
        self,
        gbuffer: GBuffer,
        weather: WeatherParameters,
        *,
        stamp_ns: int,
        exposure_s: float,
        seed: int = 0,
    ) -> NDArray[np.float32]:
        """The layer of falling drops alone, shape (H, W, 4).

        Args:
            gbuffer: What `draw` returned.
            weather: Rain and light.
            stamp_ns: End of the exposure [ns].
            exposure_s: Exposure time, which makes the streaks long [s].
            seed: Seed of the rain.

        Returns:
            Light that they add [cd/m²], three channels, and the share of what lies behind that they hide.
        """
        with self._context:
            return self._shader.rain_cd_m2(gbuffer, weather, stamp_ns, seed, exposure_s)

    def _fill(self, view: View, targets: Targets, instances: Instances) -> None:
        context = self._context
        targets.framebuffer.use()
        targets.clear()
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        # The picture is drawn upside down in OpenGL's eyes, which turns the triangles round.
        context.front_face = "cw"
        context.cull_face = "back"
        self._draw_unhidden(view, targets, instances)
        context.front_face = "ccw"

    def _draw_unhidden(self, view: View, targets: Targets, instances: Instances) -> None:
        """Draw from near to far in rounds, each without what hides behind the rounds before."""
        found = self._scenery.in_view(view)
        layers = self._scenery.layers
        left = []
        for layer, (which, away) in zip(layers, found, strict=True):
            first = np.where(layer.large[which], away < LARGE_M, layer.culled & (away < ROUNDS_M[0]))
            left.append((which, np.where(first, 0, 1 + np.searchsorted(ROUNDS_M, away))))
        self._draw_layers(view, [which[turn == 0] for which, turn in left])
        drawn = self._visible_instances(view, instances)
        for now in range(1, len(ROUNDS_M) + 2):
            hidden = Depths(view, _read_depth(targets))
            if now == 1:
                drawn = drawn[hidden.shown(self._corners_m(instances, drawn))]
                if len(drawn):
                    self._poses.fill(instances, drawn)
                    program = self._gbuffer_program(view, "INSTANCED")
                    self._library.draw(program, self._poses.used, instances=self._poses)
            shown = []
            for layer, (which, turn) in zip(layers, left, strict=True):
                some = which[turn == now]
                boxes = box_corners(layer.low_m[some], layer.high_m[some])
                shown.append(some[hidden.shown(boxes, least_px=self._least_px)])
            self._draw_layers(view, shown)

    def _draw_layers(self, view: View, which: list[NDArray[np.intp]]) -> None:
        for layer, some in zip(self._scenery.layers, which, strict=True):
            if not len(some):
                continue
            if layer.culled:
                self._context.enable(moderngl.CULL_FACE)
            else:
                self._context.disable(moderngl.CULL_FACE)
            layer.geometry.draw(self._gbuffer_program(view, *layer.features), some)
        self._context.disable(moderngl.CULL_FACE)

    def _corners_m(self, instances: Instances, which: NDArray[np.intp]) -> NDArray[np.float64]:
        """Corners of the boxes of some instances in the world [m], shape (N, 8, 3)."""
        model, T = instances.model[which], instances.T_world_model[which]
        local = box_corners(self._model_low_m[model], self._model_high_m[model])
        turned = np.sum(T[:, None, :3, :3] * local[:, :, None, :], axis=3)
        return np.asarray(turned + T[:, None, :3, 3], dtype=np.float64)

    def _gbuffer_program(self, view: View, *features: str) -> moderngl.Program:
        defines = (
            f"MATERIALS {len(self._surface)}",
            f"CAR_PAINT {int(Material.CAR_PAINT)}u",
            f"CLOTH {int(Material.CLOTH)}u",
            f"SKY_ID {SKY_ID}u",
            f"LEAF {int(Material.LEAF)}u",
            *(("SWAY",) if any(self._sway[:3]) else ()),
            *features,
        )
        program = self._programs.get("gbuffer.vert", "gbuffer.frag", *defines)
        self._textures.use(0)
        set_uniforms(
            program,
            u_textures=0,
            u_eye=tuple(view.position_m),
            u_rotation=view.R_camera_world.T.astype("<f4").tobytes(),
            u_clip=view.clip_scale,
            u_range=DEPTH_RANGE,
            u_surface=self._surface.tobytes(),
            u_sway=self._sway,
        )
        return program

    def _visible_instances(self, view: View, instances: Instances) -> NDArray[np.intp]:
        """Instances whose sphere reaches into the view, nearest first."""
        centre = instances.T_world_model[:, :3, 3]
        reach = self._reach_m[instances.model]
        planes = view.planes()
        gap = np.sum(centre[:, None] * planes[None, :, :3], axis=2) + planes[:, 3]
        distance = _distance_m(instances, view)
        seen = np.flatnonzero((gap > -reach[:, None]).all(axis=1) & (distance - reach < FAR_M))
        return seen[np.argsort(distance[seen], kind="stable")]

    def _shadow_casters(self, gbuffer: GBuffer) -> Casters:
        return Casters(
            library=self._library, poses=self._poses, instances=gbuffer.actors, reach_m=self._reach_m
        )

    def close(self) -> None:
        """Free the graphics memory and the context; G-buffers of this renderer become invalid."""
        if self._closed:
            return
        self._closed = True
        with self._context:
            self._shader.release()
            self._pool.release()
            self._scenery.release()
            self._library.release()
            self._poses.buffer.release()
            self._textures.release()
            self._programs.release()
        self._context.release()

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _take(instances: Instances, which: NDArray[np.intp]) -> Instances:
    return Instances(
        model=instances.model[which],
        T_world_model=instances.T_world_model[which],
        instance=instances.instance[which],
        tint=instances.tint[which],
    )


def _distance_m(instances: Instances, view: View) -> NDArray[np.float64]:
    away = instances.T_world_model[:, :3, 3] - view.position_m
    return np.asarray(np.sqrt(np.sum(away**2, axis=1)), dtype=np.float64)


def _read_depth(targets: Targets) -> NDArray[np.float32]:
    width, height = targets.depth.size
    return np.frombuffer(targets.depth.read(), dtype=np.float32).reshape(height, width)
