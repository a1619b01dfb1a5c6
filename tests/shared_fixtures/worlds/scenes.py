"""Small worlds of boxes and planes with closed-form answers, and drives through them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from carlaloc_env.core.errors import RenderError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.road.road_profile import RoughTable
from carlaloc_env.road.wheel_tracks import no_tracks
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Mesh, ModelLibrary, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.timeline.actors import (
    ActorCatalog,
    ActorFrame,
    empty_catalog,
    empty_frame,
)
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.presets import PRESETS

Path = Callable[[Array], tuple[Array, Array]]

CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.float64)
FACES = np.array(
    [
        [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
    ]
)  # fmt: skip


class BoxWorld:
    """A world of given meshes; satisfies the sensors' `World`."""

    def __init__(self, static: Sequence[Mesh], models: Mapping[str, Mesh], seed: int) -> None:
        self.seed = seed
        self.geo = GeoReference(latitude_deg=49.0, longitude_deg=8.4, height_m=115.0)
        self.static = tuple(static)
        self.library = ModelLibrary(models)
        self.weather = PRESETS["ClearNoon"]
        self.lenses = SignalLenses()
        self.roughness: RoughTable | None = None
        self.wheel_tracks = no_tracks
        self._rays: Any = None
        self._renderer: Any = None

    def renderer(self) -> Any:
        """Renderer with plain grey textures."""
        if self._renderer is None:
            from carlaloc_env.render.renderer import SceneRenderer

            grey = np.full((len(Material), 8, 8, 4), 0.5, np.float16)
            try:
                self._renderer = SceneRenderer(self.static, self.library, quality="low", albedo=grey)
            except RenderError as error:
                pytest.skip(str(error))
        return self._renderer

    def rays(self) -> Any:
        if self._rays is None:
            pytest.importorskip("open3d", reason="open3d is not installed")
            from carlaloc_env.raycast import RayScene

            self._rays = RayScene(self.static, self.library)
        return self._rays


class Scenery:
    """Makers of meshes, worlds and drives."""

    @staticmethod
    def box(
        low: ArrayLike,
        high: ArrayLike,
        material: Material = Material.CONCRETE,
        tag: Tag = Tag.BUILDING,
        instance: int = 0,
    ) -> Mesh:
        """Axis-parallel box between two corners [m]."""
        a, b = np.asarray(low, np.float64), np.asarray(high, np.float64)
        return make_mesh(a + CORNERS * (b - a), FACES, material=material, tag=tag, instance=instance)

    @staticmethod
    def ground(half_m: float = 400.0, height_m: float = 0.0) -> Mesh:
        """Level square of asphalt."""
        h = half_m
        corners = np.array([[-h, -h, height_m], [h, -h, height_m], [h, h, height_m], [-h, h, height_m]])
        return make_mesh(corners, [[0, 1, 2], [0, 2, 3]], material=Material.ASPHALT, tag=Tag.ROAD)

    @staticmethod
    def world(
        static: Sequence[Mesh] = (), models: Mapping[str, Mesh] | None = None, seed: int = 1
    ) -> BoxWorld:
        """World of meshes."""
        return BoxWorld(static, models or {}, seed)

    @staticmethod
    def track(path: Path, seconds: float) -> EgoTrack:
        """Ego along a path: times [s] (K,) → positions [m] (K, 3), roll-pitch-yaw [rad] (K, 3)."""
        t = np.arange(round(seconds / TICK_S) + 2) * TICK_S
        position, rpy = path(t)
        return EgoTrack.from_arrays(position, transforms.rpy_to_quat(rpy[:, 0], rpy[:, 1], rpy[:, 2]))

    @staticmethod
    def straight(speed_mps: float = 0.0) -> Path:
        """Along x at constant speed."""

        def path(t: Array) -> tuple[Array, Array]:
            return np.stack([speed_mps * t, 0 * t, 0 * t], axis=-1), np.zeros((len(t), 3))

        return path

    @staticmethod
    def weaving(t: Array) -> tuple[Array, Array]:
        """A lively drive: bends, bumps, roll and pitch."""
        position = np.stack([12 * t, 3 * np.sin(0.8 * t), 0.03 * np.sin(7 * t)], axis=-1)
        yaw = np.arctan2(2.4 * np.cos(0.8 * t), 12)
        return position, np.stack([0.02 * np.sin(3 * t), 0.015 * np.cos(5 * t), yaw], axis=-1)

    @staticmethod
    def catalog(
        models: Sequence[str], tag: ArrayLike = Tag.CAR, size_m: ArrayLike = 2.0, tint: ArrayLike = 255
    ) -> ActorCatalog:
        """Actors of the named models with consecutive ids."""
        count = len(models)
        return ActorCatalog(
            id=(EGO_INSTANCE + 1 + np.arange(count)).astype(np.uint32),
            model=tuple(models),
            tag=np.full(count, tag, np.uint8),
            size_m=np.full((count, 3), size_m, np.float32),
            tint=np.full((count, 3), tint, np.uint8),
        )

    @staticmethod
    def frame(
        position_m: ArrayLike,
        heading_rad: ArrayLike = 0.0,
        speed_mps: ArrayLike = 0.0,
        lights: ArrayLike = 0,
        **others: ArrayLike,
    ) -> ActorFrame:
        """State of all actors at one instant; all that is not named is 0."""
        position = np.asarray(position_m, np.float32)
        others = {"pitch_rad": 0.0, "roll_rad": 0.0, "travelled_m": 0.0, "steer_rad": 0.0, **others}
        others |= {"heading_rad": heading_rad, "speed_mps": speed_mps}
        rows = {name: np.full(len(position), values, np.float32) for name, values in others.items()}
        return ActorFrame(position_m=position, lights=np.full(len(position), lights, np.uint8), **rows)

    @classmethod
    def drive(
        cls,
        path: Path,
        seconds: float,
        catalog: ActorCatalog | None = None,
        frame_at: Callable[[float], ActorFrame] | None = None,
    ) -> Timeline:
        """Whole drive; `frame_at` gives the actors' state at a time [s]."""
        timeline = Timeline(catalog if catalog is not None else empty_catalog(), ego=cls.track(path, seconds))
        for step in range(round(seconds / (STEP_TICKS * TICK_S)) + 1):
            frame = frame_at(step * STEP_TICKS * TICK_S) if frame_at else empty_frame()
            timeline.append_step(frame, np.zeros(1, np.uint8))
        return timeline


def slab(origins: Array, directions: Array, low: ArrayLike, high: ArrayLike) -> Array:
    """Distance (N,) at which rays enter a box (from inside: leave it), inf where they miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (np.asarray(low) - origins) / directions
        b = (np.asarray(high) - origins) / directions
    near, far = np.nanmax(np.minimum(a, b), axis=-1), np.nanmin(np.maximum(a, b), axis=-1)
    first = np.where(near > 0, near, far)
    return np.where((near <= far) & (far > 0), first, np.inf)


@pytest.fixture
def scenery() -> type[Scenery]:
    """Makers of meshes, worlds and drives."""
    return Scenery


@pytest.fixture
def box_range() -> Callable[..., Array]:
    """Closed-form distance of rays to an axis-parallel box."""
    return slab
