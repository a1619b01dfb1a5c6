"""What all environments share: specification, observation, window, and the driver's view.

What all environments share: a specification that fits JSON, seeds, and an end.

A window that shows pictures as they come, for `render_mode` human.

Samples to a Gymnasium observation: fixed shapes, the newest values, zeros for what is yet to come.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass, replace
from numbers import Integral
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import ClosedError, ConfigError, RenderError
from carlaloc_env.core.files.config_files import to_mapping
from carlaloc_env.core.transforms import R_FLU_OPTICAL, from_rotation, quat_to_matrix, rpy_to_quat
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.rigs.rig import Rig
from carlaloc_env.samples import (
    DepthImage,
    GnssFix,
    Image,
    Imu,
    PointCloud,
    RadarScan,
    Sample,
    SemanticImage,
    Speed,
    WheelTicks,
)
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.timeline import Snapshot
from carlaloc_env.weather.schedule import Weather


class BaseEnv(gymnasium.Env[Any, Any], EzPickle):
    """An environment that is open or closed; its constructor's arguments are its pickle."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 20}  # noqa: RUF012
    _spec: EnvSpec | None = None
    _closed = False

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """How `gymnasium.make` made it, in plain data: `to_json` takes it, and `make` takes it back."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else replace(spec, kwargs=plain(spec.kwargs))

    def _begin(self, seed: int | None) -> None:
        """Begin a reset: check the seed, and seed the generator if one is given.

        Raises:
            ConfigError: the seed is negative or no whole number.
            ClosedError: the environment has been closed.
        """
        self._check_open("reset")
        whole = isinstance(seed, Integral) and not isinstance(seed, bool) and int(seed) >= 0
        if not whole and seed is not None:
            raise ConfigError(f"reset: the seed is {seed!r}; give a whole number of 0 or more, or none")
        gymnasium.Env.reset(self, seed=None if seed is None else int(seed))

    def _check_open(self, call: str) -> None:
        if self._closed:
            raise ClosedError(f"{call} after close; make a new environment with gymnasium.make()")


def plain(value: Any) -> Any:
    """Numbers, texts, lists and mappings for what a constructor takes."""
    if hasattr(value, "to_mapping"):
        return plain(value.to_mapping())
    if is_dataclass(value) and not isinstance(value, type):
        return plain(to_mapping(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return str(value) if isinstance(value, Path) else value


class HumanWindow:
    """One window; shows at most its rate of pictures a second, as people watch."""

    def __init__(self, size_px: tuple[int, int], rate_hz: float) -> None:
        """Open it.

        Args:
            size_px: Width and height.
            rate_hz: Pictures a second.

        Raises:
            RenderError: there is no display.
        """
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        import pygame

        self._pygame: Any = pygame
        self._rate_hz = rate_hz
        pygame.display.init()
        if pygame.display.get_driver() in ("offscreen", "dummy") and "SDL_VIDEODRIVER" not in os.environ:
            pygame.display.quit()
            raise RenderError("render_mode 'human' needs a display; set DISPLAY, or use 'rgb_array'")
        self._screen = pygame.display.set_mode(size_px)
        pygame.display.set_caption("CarlaLoc")
        self._clock = pygame.time.Clock()

    def show(self, rgb: NDArray[np.uint8]) -> None:
        """Show a picture, sRGB, shape (H, W, 3)."""
        pygame = self._pygame
        pygame.event.pump()
        self._screen.blit(pygame.surfarray.make_surface(rgb.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        self._clock.tick(self._rate_hz)

    def close(self) -> None:
        """Close it."""
        self._pygame.display.quit()


_T_BASE_SEAT = from_rotation(quat_to_matrix(rpy_to_quat(0.0, 0.03, 0.0)) @ R_FLU_OPTICAL, (1.8, 0.0, 1.65))


def view_from_seat(stage: SensorStage, world: DrivingWorld, weather: Weather) -> NDArray[np.uint8]:
    """A picture from the driver's seat now, sRGB, shape (360, 640, 3).

    Raises:
        RenderError: OpenGL is missing on this machine.
    """
    renderer, now = stage.renderer(), world.now_ns
    snapshot = Snapshot.of(world.timeline, now)
    instances = instances_at(stage.library, stage.lenses, snapshot)
    picture = renderer.draw(Pinhole.from_fov(640, 360, 90.0), snapshot.T_world_base @ _T_BASE_SEAT, instances)
    return renderer.shade(picture, weather.at(now), stamp_ns=now, seed=stage.seed)


Observation = dict[str, NDArray[Any]]
"""Arrays by observation key."""


@runtime_checkable
class ObservedSample(Protocol):
    """A kind of sample from elsewhere that defines how it is observed."""

    def observed(self) -> NDArray[Any]:
        """The observed numbers, in the layout of the sensor's `streams`."""


class Observer:
    """Keeps the newest samples of a rig as one observation.

    A stream that measures several times in a step (IMU) is batched, the newest row last. Point
    clouds are padded by zero rows, and ``<stream>_count`` is the number of real rows.
    """

    def __init__(self, rig: Rig) -> None:
        self._batched: dict[str, int] = {}
        self._padded: set[str] = set()
        found: dict[str, spaces.Space[Any]] = {}
        for sensor in rig.sensors:
            for stream, space in sensor.streams().items():
                if not isinstance(space, spaces.Box):
                    raise TypeError(f"stream '{stream}' has a {type(space).__name__} space, not a Box")
                batch = sensor.samples_per_step
                if batch > 1:
                    self._batched[stream] = batch
                    space = _batch(space, batch)
                found[stream] = space
                if stream in sensor.padded_streams:
                    self._padded.add(stream)
                    *shape, most, _ = space.shape
                    found[f"{stream}_count"] = spaces.Box(0, most, (*shape, 1), np.int32)
        self.space = spaces.Dict(found)
        self._newest: Observation = {}
        self.reset()

    def reset(self) -> None:
        """Forget all samples; every key is zero."""
        spaces_of = self.space.spaces.items()
        self._newest = {key: np.zeros(space.shape or (), space.dtype) for key, space in spaces_of}

    def add(self, samples: Iterable[Sample]) -> None:
        """Take over samples, given in stamp order; those of streams that the rig lacks are left out."""
        for sample in samples:
            key = sample.sensor
            held = self._newest.get(key)
            if held is None:
                continue
            if key in self._padded:
                self._put_cloud(key, columns_of(sample))
            elif key in self._batched:
                self._newest[key] = np.concatenate([held[1:], values_of(sample)[None].astype(held.dtype)])
            else:
                self._newest[key] = values_of(sample).reshape(held.shape).astype(held.dtype)

    def newest(self) -> Observation:
        """The newest of all samples so far; the arrays are the caller's own."""
        return {key: array.copy() for key, array in self._newest.items()}

    def _put_cloud(self, key: str, columns: Sequence[NDArray[Any]]) -> None:
        held = self._newest[key]
        fresh, count = np.zeros_like(held), np.zeros_like(self._newest[f"{key}_count"])
        if key in self._batched:
            fresh[:-1], count[:-1] = held[1:], self._newest[f"{key}_count"][1:]
        cloud = fresh[-1] if key in self._batched else fresh
        count[-1] = points = min(len(columns[0]), len(cloud))
        for k, column in enumerate(columns):
            cloud[:points, k] = column[:points]
        self._newest[key], self._newest[f"{key}_count"] = fresh, count


def values_of(sample: Sample) -> NDArray[Any]:
    """The observed numbers of one sample, in the layout of its sensor's `streams`.

    Raises:
        TypeError: the kind of sample has no place in observations.
    """
    if isinstance(sample, Image):
        return sample.rgb
    if isinstance(sample, DepthImage):
        return sample.depth_m
    if isinstance(sample, SemanticImage):
        return sample.tag
    if isinstance(sample, Imu):
        return np.concatenate([sample.specific_force_mps2, sample.angular_rate_radps])
    if isinstance(sample, GnssFix):
        if not sample.has_fix:
            return np.zeros(4)
        return np.array([sample.latitude_deg, sample.longitude_deg, sample.altitude_m, 1.0])
    if isinstance(sample, Speed):
        return np.array([sample.speed_mps])
    if isinstance(sample, WheelTicks):
        return np.concatenate([sample.ticks.astype(np.float64), sample.rate_radps])
    if isinstance(sample, ObservedSample):
        return sample.observed()
    raise TypeError(f"{type(sample).__name__} has no place in observations; give it a method observed()")


def columns_of(sample: Sample) -> Sequence[NDArray[Any]]:
    """Columns of a sample of N rows, (N,) each: x, y, z [m], then intensity, or cos incidence, instance, tag.

    A cloud goes to its observation column by column, since rows would be copied once more.
    """
    if isinstance(sample, RadarScan):
        return [*sample.points_xyz_m.T, sample.doppler_mps, sample.snr_db, sample.rcs_dbsm]
    if not isinstance(sample, PointCloud):
        return list(values_of(sample).T)
    if sample.tag is None or sample.instance is None or sample.cos_incidence is None:
        return [*sample.points_xyz_m.T, sample.intensity]
    return [*sample.points_xyz_m.T, sample.cos_incidence, sample.instance, sample.tag]


def _batch(space: spaces.Box, count: int) -> spaces.Box:
    shape = (count,) + (1,) * len(space.shape)
    return spaces.Box(np.tile(space.low, shape), np.tile(space.high, shape), dtype=space.dtype.type)
