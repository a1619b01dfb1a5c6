"""The renderer: geometry drawn once into a G-buffer, shaded once per weather."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.opengl_process import check_opengl, lost_by_fork
from carlaloc_env.render.geometry.gbuffer import GBuffer, TargetPool
from carlaloc_env.render.geometry.geometry_pass import GeometryPass, distance_m
from carlaloc_env.render.geometry.occlusion_culling import Depths
from carlaloc_env.render.lighting.shader_constants import shader_constants
from carlaloc_env.render.rain_drops import Streaks
from carlaloc_env.render.shader_programs import give_back, take_programs
from carlaloc_env.render.shading import Shader
from carlaloc_env.render.textures.build import build_textures
from carlaloc_env.render.views import CameraView, check_quality
from carlaloc_env.road.wheel_tracks import WheelTracks, no_tracks
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary
from carlaloc_env.weather.parameters import WeatherParameters

SWAY_S = 0.012
"""Displacement of leaves per wind speed [s]: 0.18 m in a storm of 15 m/s."""
SWAY_PERIOD_NS = 1_000_000_000_000
"""Period after which leaves jump back [ns], since shaders count time in single precision."""
ACTOR_SHADOW_RANGE_M = 90.0
"""Distance from the camera up to which movable models throw shadows [m]."""


class SceneRenderer:
    """Draws a static scene and movable models in an OpenGL context of its own.

    The same call gives the same bytes, whatever was drawn before.
    """

    def __init__(
        self,
        chunks: Sequence[Mesh],
        library: ModelLibrary,
        *,
        quality: str = "medium",
        lamps_m: ArrayLike | None = None,
        tracks: Callable[[], WheelTracks] = no_tracks,
        albedo: NDArray[np.float16] | None = None,
        unit_m: float = 1.0,
    ) -> None:
        """Upload a scene.

        Args:
            chunks: Static scenery in squares of some tens of metres, culled one by one.
            library: Movable models.
            quality: One of `QUALITIES`.
            lamps_m: Street lamps in the world [m], shape (K, 3).
            tracks: Gives the lanes' wheel tracks, asked for when snow lies; none by default.
            albedo: Linear albedo and roughness of every material, shape (M, S, S, 4); the built-in
                textures when left out.
            unit_m: Metres of the world in one unit of the geometry: a model of a town wears as the
                town does.

        Raises:
            RenderError: there is no OpenGL here.
            ConfigError: the quality is not one of `QUALITIES`.
        """
        self.quality = check_quality(quality)
        self._subsamples = 2 if quality == "high" else 1
        self._programs = take_programs(shader_constants())
        self._context = self._programs.context
        with self._context:
            self._pool = TargetPool(self._context)
            self._geometry_pass = GeometryPass(
                self._context,
                self._programs,
                chunks=list(chunks),
                library=library,
                albedo=build_textures().albedo if albedo is None else albedo,
                live=quality == "low",
                unit_m=unit_m,
            )
            lamps = np.zeros((0, 3)) if lamps_m is None else np.asarray(lamps_m, np.float64).reshape(-1, 3)
            self._shader = Shader(
                self._context,
                self._programs,
                scenery=self._geometry_pass.scenery,
                library=library,
                lamps_m=lamps,
                tracks=tracks,
                live=quality == "low",
            )
        self._closed = False

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
        earlier: GBuffer | None = None,
    ) -> GBuffer:
        """Draw the geometry that a camera sees, before any weather.

        Args:
            camera: Intrinsics.
            T_world_camera: Pose of the optical frame, shape (4, 4).
            instances: Movable models.
            velocity_mps: Velocity of the camera in the world, shape (3,); streaks of rain slant with it.
            wind_mps: Wind that sways leaves, shape (3,); still by default, since LiDARs see still leaves
                and all weathers of a drive share their geometry.
            stamp_ns: Time of the picture [ns], at which the leaves sway.
            earlier: G-buffer of the same window a moment before: things hidden by it are not drawn. Faster
                where reading back takes long, but for live pictures only: things that come out from behind
                others may appear later by the time between the two.
        """
        return self.begin_drawing(
            camera,
            T_world_camera,
            instances,
            velocity_mps=velocity_mps,
            wind_mps=wind_mps,
            stamp_ns=stamp_ns,
            earlier=earlier,
        )()

    def begin_drawing(
        self,
        camera: Pinhole,
        T_world_camera: ArrayLike,
        instances: Instances,
        *,
        velocity_mps: ArrayLike = (0.0, 0.0, 0.0),
        wind_mps: ArrayLike = (0.0, 0.0, 0.0),
        stamp_ns: int = 0,
        earlier: GBuffer | None = None,
    ) -> Callable[[], GBuffer]:
        """Work out what `draw` will draw, while the graphics may be busy with something else.

        Takes the arguments of `draw`.

        Returns:
            Function that draws it; to be called once.

        Raises:
            RenderError: this process is a fork of the renderer's.
        """
        check_opengl()
        x, y, z = (SWAY_S * float(speed) for speed in np.asarray(wind_mps, dtype=np.float64))
        sway = (x, y, z, stamp_ns % SWAY_PERIOD_NS * 1e-9)
        view = CameraView.of(camera, T_world_camera, self._subsamples, velocity_mps)
        near = instances.take(np.flatnonzero(distance_m(instances, view) < ACTOR_SHADOW_RANGE_M))
        # Read before the context is entered: on leaving an inner `with` none would be current.
        occluders = None if earlier is None else self._carried(view, earlier)
        plan = self._geometry_pass.plan(view, self._geometry_pass.simplified(instances, view), occluders)

        def drawn() -> GBuffer:
            with self._context:
                targets = self._pool.take(view.size_px, smooth=self._subsamples > 1)
                self._geometry_pass.fill(plan, targets, sway)
                shaded = targets
                if self._subsamples > 1:
                    shaded = self._pool.take((camera.width_px, camera.height_px), resolved=True)
                    self._shader.resolve(view, targets, shaded)
            gbuffer = GBuffer(context=self._context, view=view, drawn=targets, shaded=shaded, actors=near)
            self._pool.give_back_with(gbuffer)
            return gbuffer

        return drawn

    def shade(
        self, gbuffer: GBuffer, weather: WeatherParameters, *, stamp_ns: int = 0, seed: int = 0
    ) -> NDArray[np.uint8]:
        """Colour picture under a weather, sRGB, shape (H, W, 3).

        Args:
            gbuffer: Result of `draw`.
            weather: Light and air.
            stamp_ns: Time of the picture [ns]; keys its dither, and places the rain.
            seed: Seed of dither and rain.
        """
        return self.begin_shading(gbuffer, weather, stamp_ns=stamp_ns, seed=seed)()

    def shade_all(
        self, gbuffer: GBuffer, weathers: Sequence[WeatherParameters], *, stamp_ns: int = 0, seed: int = 0
    ) -> list[NDArray[np.uint8]]:
        """Pictures under several weathers: the lights of one are searched while another is shaded.

        Takes the arguments of `shade`, and gives the same pictures, one for each weather.
        """
        # Reading back waits for all that has been begun.
        for weather in weathers:
            self._read_ahead(gbuffer, weather)
        begun = [
            self.begin_shading(gbuffer, weather, stamp_ns=stamp_ns, seed=seed, slot=slot)
            for slot, weather in enumerate(weathers)
        ]
        return [finish() for finish in begun]

    def begin_shading(
        self, gbuffer: GBuffer, weather: WeatherParameters, *, stamp_ns: int = 0, seed: int = 0, slot: int = 0
    ) -> Callable[[], NDArray[np.uint8]]:
        """Begin what `shade` does, and do not wait for it: the next picture can be drawn meanwhile.

        Takes the arguments of `shade`, and:

        Args:
            gbuffer: Result of `draw`.
            weather: Light and air.
            stamp_ns: Time of the picture [ns].
            seed: Seed of dither and rain.
            slot: Where the picture is kept meanwhile: pictures in other slots may be begun before it is
                waited for.

        Returns:
            Function that waits for the picture and returns it; to be called before the next shading in its
            slot is begun.
        """
        self._read_ahead(gbuffer, weather)
        with self._context:
            casters = self._geometry_pass.casters(gbuffer.actors, gbuffer.view)
            read = self._shader.begin(gbuffer, weather, casters, stamp_ns, seed, slot)
            self._geometry_pass.wake()

        def finished() -> NDArray[np.uint8]:
            with self._context:
                rgba = read()
            rgb = cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB)
            if self.quality == "medium":
                cv2.GaussianBlur(rgb, (3, 3), 0.5, dst=rgb, borderType=cv2.BORDER_REPLICATE)
            return np.asarray(rgb, dtype=np.uint8)

        return finished

    def radiance_cd_m2(
        self, gbuffer: GBuffer, weather: WeatherParameters, *, stamp_ns: int | None = None, seed: int = 0
    ) -> NDArray[np.float32]:
        """Linear BT.709 luminance before exposure [cd/m²], shape (H, W, 3).

        Args:
            gbuffer: Result of `draw`.
            weather: Light and air.
            stamp_ns: Time of the picture [ns]; None leaves falling drops out, which no warp of a picture
                by the motion of surfaces can follow.
            seed: Seed of the rain.
        """
        self._read_ahead(gbuffer, weather)
        with self._context:
            casters = self._geometry_pass.casters(gbuffer.actors, gbuffer.view)
            return self._shader.radiance_cd_m2(gbuffer, weather, casters, stamp_ns, seed)

    def rain_cd_m2(
        self, gbuffer: GBuffer, weather: WeatherParameters, *, stamp_ns: int, exposure_s: float, seed: int = 0
    ) -> NDArray[np.float32]:
        """The layer of falling drops alone, shape (H, W, 4).

        Args:
            gbuffer: Result of `draw`.
            weather: Rain and light.
            stamp_ns: End of the exposure [ns].
            exposure_s: Exposure time, which makes the streaks long [s].
            seed: Seed of the rain.

        Returns:
            Light that they add [cd/m²], three channels, and the share of what lies behind that they hide.
        """
        self._read_ahead(gbuffer, weather)
        with self._context:
            return self._shader.rain_cd_m2(gbuffer, weather, stamp_ns, seed, exposure_s)

    def falling(
        self, gbuffer: GBuffer, weather: WeatherParameters, *, stamp_ns: int, span_s: float, seed: int
    ) -> tuple[Streaks, Array]:
        """What falls before a picture in a span that ends with it, and its luminance [cd/m²], (N, 3)."""
        self._read_ahead(gbuffer, weather)
        with self._context:
            return self._shader.falling(gbuffer, weather, stamp_ns, seed, span_s)[1:]

    def _read_ahead(self, gbuffer: GBuffer, weather: WeatherParameters) -> None:
        """Read back what shading needs, outside the context: an inner `with` would leave none current."""
        if weather.is_night or weather.falls:
            gbuffer.shaded_depth_m()
        if weather.is_night:
            gbuffer.shaded_normal_codes()

    @staticmethod
    def _carried(view: CameraView, earlier: GBuffer) -> Depths:
        depth_m, instance = earlier.samples()
        return Depths.carried(view, earlier.view, depth_m, instance)

    def close(self) -> None:
        """Free the graphics memory and the context; G-buffers of this renderer become invalid."""
        if self._closed:
            return
        self._closed = True
        if lost_by_fork():
            return
        with self._context:
            self._shader.release()
            self._pool.release()
            self._geometry_pass.release()
        give_back(self._programs)

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
