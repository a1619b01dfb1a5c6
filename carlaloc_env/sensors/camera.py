"""The camera: colour, planar depth and semantics of one pinhole, drawn in one pass."""

from collections.abc import Iterator, Sequence
from heapq import merge
from itertools import takewhile
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.array_types import F32
from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.render.views import FAR_M
from carlaloc_env.samples import (
    DepthImage,
    Events,
    FlowImage,
    Image,
    NormalImage,
    Sample,
    SemanticImage,
)
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Camera, World
from carlaloc_env.sensors.camera_config import (
    OUTPUTS,
    CameraConfig,
)
from carlaloc_env.sensors.event_camera.event_camera import EventCamera, EventChain, RenderFrame
from carlaloc_env.sensors.event_camera.flakes import Flakes
from carlaloc_env.sensors.event_camera.log_intensity import log_intensity
from carlaloc_env.sensors.imaging.exposure_control import Draw, Imaging, Swept
from carlaloc_env.sensors.imaging.frame import Frame, Optics
from carlaloc_env.sensors.imaging.frame_motion import FrameGeometry
from carlaloc_env.sensors.imaging.lens_drops import with_lens_drops
from carlaloc_env.sensors.imaging.motion_field import ScenePoses, motion_field
from carlaloc_env.timeline.snapshot import Snapshot
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.parameters import WIND_DIRECTION, WeatherParameters
from carlaloc_env.weather.schedule import Weather


class CameraSensor(Camera):
    """Draws the town, the ego's own body, actors and lit signals as they were at the stamp."""

    config: CameraConfig

    def __init__(self, config: CameraConfig, world: World) -> None:
        super().__init__(config)
        self._world = world
        self._T_base_camera = config.mount.T_base_sensor
        self._period_ns = self.schedule.period_ticks * TICK_NS
        self._optics = Optics(config.pinhole, config.lens)
        self._chain: EventChain | None = None
        self._imaging: Imaging | None = None
        self._made_seed: int | None = None
        if config.imager is not None and config.shutter is not None:
            self.latency_ns = config.shutter.span_ns(config.imager.exposure_max_ms) // 2
        if "flow" in config.outputs:
            self.latency_ns = max(self.latency_ns, self._period_ns)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Observation spaces of the streams.

        Colour (H, W, 3) sRGB, depth (H, W) [m] with 0 = sky, semantic `Tag` (H, W), flow (H, W, 2)
        [px], normals (H, W, 3), counts of brighter and darker events (H, W, 2).
        """
        shape = (self.config.pinhole.height_px, self.config.pinhole.width_px)
        spaces_of: dict[str, spaces.Space[Any]] = {
            "rgb": spaces.Box(0, 255, (*shape, 3), np.uint8),
            "depth": spaces.Box(0.0, FAR_M, shape, np.float32),
            "semantic": spaces.Box(0, max(Tag), shape, np.uint8),
            "flow": spaces.Box(-np.inf, np.inf, (*shape, 2), np.float32),
            "normal": spaces.Box(-1.0, 1.0, (*shape, 3), np.float32),
            "events": spaces.Box(0, 255, (*shape, 2), np.uint8),
        }
        outputs = self.config.outputs
        return {self._stream(output): spaces_of[output] for output in OUTPUTS if output in outputs}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """Pictures under the world's weather at the given stamps [ns]."""
        weather = self._world.weather
        return [
            sample
            for stamp in stamps_ns
            for sample in self.measure_conditions(timeline, int(stamp), [weather])[0]
        ]

    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather]
    ) -> list[list[Sample]]:
        """Pictures of one instant under several weathers, one list per weather.

        Geometry is drawn once. Only colour and events depend on the weather: the lists share all other
        samples.
        """
        self._make(self._world.seed)
        draw = self._drawing(timeline, stamp_ns)
        imaging = self._imaging
        swept = imaging.sweep(timeline, stamp_ns, draw) if imaging is not None else None
        shared = self._shared(timeline, stamp_ns, draw, swept)
        conditions: list[list[Sample]] = [[] for _ in weathers]
        if "rgb" in self.config.outputs:
            if imaging is not None:
                pictures = imaging.pictures(timeline, stamp_ns, weathers, draw, swept)
            else:
                frame, seed = draw(stamp_ns)[0], self._world.seed
                pictures = frame.rgbs([weather.at(stamp_ns) for weather in weathers], stamp_ns, seed)
            for samples, rgb, weather in zip(conditions, pictures, weathers, strict=True):
                if self.config.lens_drops:
                    rgb = self._through_drops(rgb, weather, stamp_ns)
                samples.append(Image(rgb=rgb, **self._labels("rgb", stamp_ns)))
        for samples in conditions:
            samples += shared
        if "events" in self.config.outputs:
            fired = self._events(timeline, stamp_ns, weathers, draw)
            for samples, events in zip(conditions, fired, strict=True):
                samples.append(events)
        return conditions

    def recall(self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather]) -> Iterator[int]:
        """Pictures before a stamp that exposure control and event pixels must have seen, see `Camera`."""
        self._make(self._world.seed)
        draw = self._drawing(timeline, stamp_ns)
        past: list[Iterator[int]] = []
        if self._imaging is not None and "rgb" in self.config.outputs:
            past.append(self._imaging.towards(timeline, stamp_ns, weathers, draw))
        if self._chain is not None:
            past.append(self._chain.towards(timeline, stamp_ns, weathers, self._lighting(weathers, draw)))
        return takewhile(lambda at_ns: at_ns < stamp_ns, merge(*past))

    def glance(self, timeline: Timeline, stamp_ns: int) -> tuple[FrameGeometry, Frame]:
        """Geometry of one picture, drawn anew for events, and the picture for its light."""
        snapshot = Snapshot.of(timeline, stamp_ns)
        frame = self._draw(snapshot)
        return FrameGeometry.of(frame, self._poses(snapshot)), frame

    def _through_drops(self, rgb: NDArray[np.uint8], weather: Weather, stamp_ns: int) -> NDArray[np.uint8]:
        now, seed = weather.at(stamp_ns), self._world.seed
        if not now.falls:
            return rgb
        return with_lens_drops(rgb, now, stamp_ns=stamp_ns, seed=seed, camera=self.config.name)

    def _make(self, seed: int) -> None:
        """Fixed patterns of noise, for a seed."""
        if seed == self._made_seed:
            return
        config, self._made_seed = self.config, seed
        if "events" in config.outputs:
            camera = EventCamera(config.events, config.name, self._optics, seed)
            self._chain = EventChain(camera, self._period_ns)
        if config.imager is not None:
            self._imaging = Imaging(
                config.imager, config.shutter, config.name, self._optics, self._period_ns, seed
            )

    def _pose(self, snapshot: Snapshot) -> NDArray[np.float64]:
        # Written out without BLAS, so that the pose has the same bits on every machine.
        terms = snapshot.T_world_base[:, :, None] * self._T_base_camera[None]
        pose: NDArray[np.float64] = np.sum(terms, axis=1)
        return pose

    def _draw(self, snapshot: Snapshot) -> Frame:
        renderer = self._world.renderer()
        gbuffer = renderer.draw(
            self._optics.drawn,
            self._pose(snapshot),
            instances_at(self._world.library, self._world.lenses, snapshot),
            velocity_mps=snapshot.ego_velocity_mps,
            wind_mps=self.config.leaf_wind_mps * WIND_DIRECTION,
            stamp_ns=snapshot.stamp_ns,
        )
        return Frame(gbuffer, renderer, self._optics.view)

    def _poses(self, snapshot: Snapshot) -> ScenePoses:
        return ScenePoses.of(snapshot, self._pose(snapshot))

    def _shared(self, timeline: Timeline, stamp_ns: int, draw: Draw, swept: Swept | None) -> list[Sample]:
        outputs, samples = self.config.outputs, list[Sample]()
        rolled = self._imaging.rolled(stamp_ns, swept) if self._imaging is not None else None
        if "depth" in outputs:
            depth_m = draw(stamp_ns)[0].depth_m if rolled is None else rolled[0]
            samples.append(DepthImage(depth_m=depth_m, **self._labels("depth", stamp_ns)))
        if "semantic" in outputs:
            tag, instance = draw(stamp_ns)[0].labels if rolled is None else rolled[1:]
            samples.append(SemanticImage(tag=tag, instance=instance, **self._labels("semantic", stamp_ns)))
        if "flow" in outputs:
            frame, now = draw(stamp_ns)
            field = motion_field(
                self.config.pinhole,
                frame.depth_m,
                frame.labels[1],
                now,
                self._poses(Snapshot.of(timeline, stamp_ns + self._period_ns)),
                lens=self.config.lens,
                rays=self._optics.rays,
            )
            flow_px = np.ascontiguousarray(field[..., :2])
            samples.append(FlowImage(flow_px=flow_px, **self._labels("flow", stamp_ns)))
        if "normal" in outputs:
            normal = draw(stamp_ns)[0].normal
            samples.append(NormalImage(normal=normal, **self._labels("normal", stamp_ns)))
        return samples

    def _drawing(self, timeline: Timeline, stamp_ns: int) -> Draw:
        """Function that draws the view at any time, for the picture at a stamp [ns]."""
        frames: dict[int, tuple[Frame, ScenePoses]] = {}

        def draw(at_ns: int) -> tuple[Frame, ScenePoses]:
            if at_ns not in frames:
                # A long look back would fill the graphics memory: the picture itself and the last one stay.
                for old in [t for t in frames if t != stamp_ns][:-1]:
                    del frames[old]
                snapshot = Snapshot.of(timeline, at_ns)
                frames[at_ns] = self._draw(snapshot), self._poses(snapshot)
            return frames[at_ns]

        return draw

    def _lighting(self, weathers: Sequence[Weather], draw: Draw) -> RenderFrame:
        """Function that gives the light of event pixels at any time."""
        dark = self.config.events.dark_cd_m2

        def render(at_ns: int) -> tuple[FrameGeometry, list[F32], list[Flakes | None]]:
            seen, poses = draw(at_ns)
            now = [weather.at(at_ns) for weather in weathers]
            light = [log_intensity(seen.radiance_cd_m2(w), dark, blurred=not seen.is_blurred) for w in now]
            return FrameGeometry.of(seen, poses), light, [self._flakes(seen, w, at_ns) for w in now]

        return render

    def _flakes(self, seen: Frame, weather: WeatherParameters, stamp_ns: int) -> Flakes | None:
        """Flakes of the period that ends at a stamp [ns]; None: no snow falls."""
        if weather.snowfall <= 0.0:
            return None
        span_s, seed = self._period_ns * 1e-9, self._world.seed
        streaks, light = seen.falling(weather, stamp_ns=stamp_ns, span_s=span_s, seed=seed)
        return Flakes(streaks.begin_m, streaks.end_m, streaks.diameter_m, light)

    def _events(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather], draw: Draw
    ) -> list[Events]:
        assert self._chain is not None
        pinhole, render = self.config.pinhole, self._lighting(weathers, draw)
        return [
            Events(
                events=events,
                width_px=pinhole.width_px,
                height_px=pinhole.height_px,
                period_ns=self._period_ns,
                **self._labels("events", stamp_ns),
            )
            for events in self._chain.events(timeline, stamp_ns, weathers, render)
        ]

    def _labels(self, output: str, stamp_ns: int) -> dict[str, Any]:
        return {"sensor": self._stream(output), "frame_id": self.config.frame_id, "stamp_ns": stamp_ns}

    def _stream(self, output: str) -> str:
        return f"{output}_{self.config.name}"
