"""The stage on which sensors look at a Timeline: a town, a weather, a seed; no simulator."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from carlaloc_env.assets.model_library import build_library
from carlaloc_env.core.errors import RenderError
from carlaloc_env.core.freed_memory import give_back_freed_memory, give_back_mapped_pages
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.road.wheel_tracks import WheelTracks
from carlaloc_env.scene.mesh import Mesh, ModelLibrary
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.town.town import Town
from carlaloc_env.weather.schedule import Weather

if TYPE_CHECKING:
    from carlaloc_env.raycast import RayScene
    from carlaloc_env.render.renderer import SceneRenderer
    from carlaloc_env.road.road_profile import RoughTable


class SensorStage:
    """Inputs of sensors beyond the Timeline; satisfies `sensors.base.World`.

    The renderer and the ray caster are made when first asked for, so that a rig without cameras
    needs no OpenGL and one without LiDAR no Open3D.
    """

    def __init__(
        self, town: Town, *, seed: int, weather: Weather, quality: str = "medium", ego_body: bool = True
    ) -> None:
        self.geo: GeoReference = town.roads.geo
        """Where the world's origin lies on the Earth."""
        self.lenses: SignalLenses = town.outline.lenses
        """Lens discs of the traffic lights."""
        self.roughness: RoughTable | None = None if town.roughness is None else town.roughness.table
        """Waves and events of the roads that their meshes lack; None: there are none."""
        self._lamps_m = town.outline.lamps_m
        self._middles_m = town.network.driven_middles_m
        self._look: Callable[[], tuple[Mesh, ...]] | None = town.scenery
        self.seed = seed
        """Seed of all noise."""
        self.weather = weather
        self._quality, self._ego_body = quality, ego_body
        self._renderer: SceneRenderer | None = None
        self._rays: RayScene | None = None
        self._tracks: WheelTracks | None = None

    def __getstate__(self) -> dict[str, Any]:
        """State for another process: the meshes themselves, since it has no town."""
        look = None if self._look is None else partial(tuple, self._look())
        return self.__dict__ | {"_look": look}

    @cached_property
    def library(self) -> ModelLibrary:
        """Movable models; without the ego's own body where the sensors stand by the road."""
        library = build_library()
        return library if self._ego_body else library.without("ego")

    def wheel_tracks(self) -> WheelTracks:
        """Map of the lanes' wheel tracks, made when first asked for."""
        if self._tracks is None:
            self._tracks = WheelTracks.of(self._middles_m)
        return self._tracks

    def renderer(self) -> SceneRenderer:
        """The renderer of this town.

        Raises:
            RenderError: OpenGL is missing on this machine.
        """
        if self._renderer is None:
            try:
                from carlaloc_env.render.renderer import SceneRenderer
            except ImportError as error:
                raise RenderError(f"pictures need moderngl ({error}); pip install moderngl") from error

            give_back_freed_memory()
            self._renderer = SceneRenderer(
                self._scenery(),
                self.library,
                lamps_m=self._lamps_m,
                tracks=self.wheel_tracks,
                quality=self._quality,
            )
            self._drop_scenery()
            give_back_freed_memory()
        return self._renderer

    def rays(self) -> RayScene:
        """The ray caster of this town.

        Raises:
            RaycastError: Open3D is missing on this machine.
        """
        if self._rays is None:
            from carlaloc_env.raycast import RayScene

            self._rays = RayScene(self._scenery(), self.library)
            self._drop_scenery()
            give_back_freed_memory()
        return self._rays

    def _scenery(self) -> tuple[Mesh, ...]:
        if self._look is None:
            raise RenderError("this stage has been closed; make a new one")
        return self._look()

    def _drop_scenery(self) -> None:
        """Let the meshes go when renderer and ray caster both have their own copies: 0.2 GB of a town."""
        # Something else of the town may keep the whole file mapped, and every mesh of the library does.
        for mesh in (*self._scenery()[:1], *self.library.meshes[:1]):
            give_back_mapped_pages(mesh.vertices_m)
        if self._renderer is not None and self._rays is not None:
            self._look = None

    def close(self) -> None:
        """Give GPU memory back."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        self._rays = None
