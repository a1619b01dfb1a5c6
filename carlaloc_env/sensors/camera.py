"""The camera: colour, planar depth and semantics of one pinhole, drawn in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from gymnasium import spaces

from carlaloc_env.assets.placing import place_actors, place_ego, place_lights, place_signals
from carlaloc_env.errors import ConfigError, unknown_name
from carlaloc_env.pinhole import Pinhole
from carlaloc_env.render.projection import FAR_M
from carlaloc_env.samples import DepthImage, Image, Sample, SemanticImage
from carlaloc_env.scene import Instances, concatenate_instances
from carlaloc_env.semantics import TAG_TABLES, Tag, tags_in
from carlaloc_env.sensors.base import Camera, Mount, SensorConfig, World
from carlaloc_env.timeline import Timeline
from carlaloc_env.weather import WeatherParameters

if TYPE_CHECKING:
    from carlaloc_env.render.gbuffer import GBuffer

OUTPUTS = ("rgb", "depth", "semantic")
"""What a camera can give; stream names are ``<output>_<name>``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig(SensorConfig):
    """A camera without distortion; the defaults are the CARLA-Loc paper's."""

    kind: ClassVar[str] = "camera"

    name: str = "left"
    """Name of the camera; its streams end with it, and its frame is ``camera_<name>``."""
    mount: Mount = field(default_factory=lambda: Mount(axes="optical"))
    """Where it sits on the car."""
    rate_hz: float = 20.0
    """Pictures per second [Hz]."""
    pinhole: Pinhole = field(default_factory=Pinhole)
    """Intrinsics."""
    outputs: tuple[str, ...] = OUTPUTS
    """Streams: ``rgb``, ``depth``, ``semantic``."""
    tag_table: str = TAG_TABLES[0]
    """Numbers of the semantic tags: as in CARLA ``0.9.14`` and later, or up to ``0.9.13``."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        if not self.outputs or set(self.outputs) - set(OUTPUTS):
            raise ConfigError(
                f"camera '{self.name}': outputs {list(self.outputs)}; choose from {', '.join(OUTPUTS)}"
            )
        if self.tag_table not in TAG_TABLES:
            raise ConfigError(unknown_name("tag table", self.tag_table, TAG_TABLES))

    @property
    def frame_id(self) -> str:
        """Optical frame: x right, y down, z forward."""
        return f"camera_{self.name}"

    def build(self, world: World) -> CameraSensor:
        """The camera in a world."""
        return CameraSensor(self, world)


class CameraSensor(Camera):
    """Draws the town, the ego's own body, actors and lit signals as they were at the stamp."""

    config: CameraConfig

    def __init__(self, config: CameraConfig, world: World) -> None:
        super().__init__(config)
        self._world = world
        self._T_base_camera = config.mount.T_base_sensor

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Colour (H, W, 3) sRGB, depth (H, W) [m] with 0 = sky, semantic `Tag` (H, W)."""
        shape = (self.config.pinhole.height_px, self.config.pinhole.width_px)
        known: dict[str, spaces.Space[Any]] = {
            "rgb": spaces.Box(0, 255, (*shape, 3), np.uint8),
            "depth": spaces.Box(0.0, FAR_M, shape, np.float32),
            "semantic": spaces.Box(0, max(Tag), shape, np.uint8),
        }
        return {self._stream(output): known[output] for output in OUTPUTS if output in self.config.outputs}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """Pictures under the world's weather at the given stamps [ns]."""
        weather = [self._world.weather]
        return [
            sample
            for stamp in stamps_ns
            for sample in self.measure_conditions(timeline, int(stamp), weather)[0]
        ]

    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[list[Sample]]:
        """Pictures of one instant under several weathers, one list per weather.

        Geometry is drawn once. Depth and semantics do not depend on the weather: the lists share
        their samples.
        """
        gbuffer = self._draw(timeline, stamp_ns)
        shared = self._shared(gbuffer, stamp_ns)
        if "rgb" not in self.config.outputs:
            return [list(shared) for _ in weathers]
        renderer, seed = self._world.renderer(), self._world.seed
        stream, frame_id = self._stream("rgb"), self.config.frame_id
        conditions: list[list[Sample]] = []
        for weather in weathers:
            rgb = renderer.shade(gbuffer, weather, stamp_ns=stamp_ns, seed=seed)
            conditions.append([Image(sensor=stream, frame_id=frame_id, stamp_ns=stamp_ns, rgb=rgb), *shared])
        return conditions

    def _draw(self, timeline: Timeline, stamp_ns: int) -> GBuffer:
        T_world_base = timeline.ego_motion([stamp_ns]).T_world_frame[0]
        # Written out without BLAS, so that the pose has the same bits on every machine.
        T_world_camera = np.sum(T_world_base[:, :, None] * self._T_base_camera[None], axis=1)
        instances = instances_at(self._world, timeline, stamp_ns)
        return self._world.renderer().draw(self.config.pinhole, T_world_camera, instances)

    def _shared(self, gbuffer: GBuffer, stamp_ns: int) -> list[Sample]:
        frame_id, samples = self.config.frame_id, list[Sample]()
        if "depth" in self.config.outputs:
            stream = self._stream("depth")
            depth_m = gbuffer.depth_m()
            samples.append(DepthImage(sensor=stream, frame_id=frame_id, stamp_ns=stamp_ns, depth_m=depth_m))
        if "semantic" in self.config.outputs:
            tag, instance = gbuffer.labels()
            samples.append(
                SemanticImage(
                    sensor=self._stream("semantic"),
                    frame_id=frame_id,
                    stamp_ns=stamp_ns,
                    tag=tags_in(self.config.tag_table, tag),
                    instance=instance,
                )
            )
        return samples

    def _stream(self, output: str) -> str:
        return f"{output}_{self.config.name}"


def instances_at(world: World, timeline: Timeline, stamp_ns: int) -> Instances:
    """Ego, actors, their lit lamps and lit signal lenses at one time [ns]."""
    T_world_base = timeline.ego_motion([stamp_ns]).T_world_frame[0]
    # Detail goes by the ego's place, so that both eyes see the same shapes.
    actors, eye_m = timeline.actors_at(stamp_ns), T_world_base[:3, 3]
    return concatenate_instances(
        [
            place_ego(T_world_base, world.library),
            place_actors(timeline.catalog, actors, world.library, eye_m=eye_m),
            place_lights(timeline.catalog, actors, world.library, stamp_ns, eye_m=eye_m),
            place_signals(world.lenses, timeline.signals_at(stamp_ns), world.library),
        ]
    )
