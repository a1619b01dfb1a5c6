"""Base classes of sensors: a configuration with mount and rate, and a sensor that measures a Timeline."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.clock import STEP_NS, Schedule
from carlaloc_env.core.errors import ConfigError, check_name, unknown_name
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.samples import Sample
from carlaloc_env.timeline.timeline import Timeline

if TYPE_CHECKING:
    from gymnasium import spaces

    from carlaloc_env.raycast import RayScene
    from carlaloc_env.render.renderer import SceneRenderer
    from carlaloc_env.road.road_profile import RoughTable
    from carlaloc_env.road.wheel_tracks import WheelTracks
    from carlaloc_env.scene.mesh import ModelLibrary
    from carlaloc_env.scene.signal_lenses import SignalLenses
    from carlaloc_env.weather.parameters import WeatherParameters
    from carlaloc_env.weather.schedule import Weather
from carlaloc_env.sensors.limits import check_limits

_AXES = {"flu": np.eye(3), "optical": transforms.R_FLU_OPTICAL, "paper_imu": transforms.R_FLU_PAPER_IMU}
"""Rotations that map FLU to the axes of a convention, (3, 3)."""


class World(Protocol):
    """Services of a town that a sensor uses beside the Timeline; nothing in it moves by itself."""

    @property
    def seed(self) -> int:
        """Seed of all noise."""

    @property
    def geo(self) -> GeoReference:
        """Place of the world's origin on the Earth."""

    @property
    def weather(self) -> Weather:
        """Weather of the images, or a schedule of it."""

    @property
    def library(self) -> ModelLibrary:
        """Movable models."""

    @property
    def lenses(self) -> SignalLenses:
        """Lens discs of the traffic lights."""

    @property
    def roughness(self) -> RoughTable | None:
        """Waves and events of the roads that their meshes lack; None: there are none."""

    def wheel_tracks(self) -> WheelTracks:
        """Where wheels clear snow, made when first asked for."""

    def renderer(self) -> SceneRenderer:
        """The renderer of this town, made when first asked for."""

    def rays(self) -> RayScene:
        """The ray caster of this town, made when first asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """Pose of a sensor on the car, in `base_link` (FLU, on the ground below the rear axle)."""

    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Forward, left, up [m]."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch (nose down positive), yaw (left positive) of the axes before `axes` [deg]."""
    axes: str = "flu"
    """Axis convention of the sensor frame: ``flu``, ``optical`` or ``paper_imu`` (up, right, forward)."""

    def __post_init__(self) -> None:
        if self.axes not in _AXES:
            raise ConfigError(f"mount axes '{self.axes}'; use one of {', '.join(_AXES)}")

    @property
    def T_base_sensor(self) -> NDArray[np.float64]:
        """Maps sensor coordinates to `base_link`, shape (4, 4)."""
        turn = transforms.quat_to_matrix(transforms.rpy_to_quat(*np.radians(self.rpy_deg)))
        axes = transforms.apply(transforms.from_rotation(turn), _AXES[self.axes].T).T
        return transforms.from_rotation(axes, self.position_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorConfig(ABC):
    """Common part of all sensor configurations."""

    kind: ClassVar[str] = ""
    """Name of the sensor type in YAML files."""
    sensor: ClassVar[str] = ""
    """The sensor's class as ``module:Class``, imported when it is built; or override `build`."""
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Values of named variants; in YAML the key ``preset`` chooses one."""

    name: str
    """Name of the sensor in the rig; its noise streams are keyed by it."""
    mount: Mount = field(default_factory=Mount)
    """Where it sits on the car."""
    rate_hz: float = 20.0
    """Measurements per second [Hz]; divides 200."""

    def __post_init__(self) -> None:
        check_name(f"name of a {self.kind or 'sensor'}:", self.name)
        check_name(f"frame of '{self.name}':", self.frame_id)
        check_limits(self)
        Schedule.from_hz(self.rate_hz)

    @classmethod
    def preset_values(cls, name: str) -> dict[str, Any]:
        """Values of a named variant, e.g. ``ImuConfig(**ImuConfig.preset_values("consumer"), rate_hz=100)``.

        Raises:
            ConfigError: there is no such variant; the message names the nearest.
        """
        if name not in cls.presets:
            raise ConfigError(unknown_name(f"preset of {cls.kind}", name, cls.presets))
        return dict(cls.presets[name])

    @classmethod
    def preset_keys(cls) -> set[str]:
        """Names of all values that some variant has."""
        return {key for values in cls.presets.values() for key in values}

    @classmethod
    def file_values(cls, values: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
        """Values of a rig's file over those of a preset or of the rig that it extends.

        Args:
            values: Values of the file.
            base: The other values; nested mappings are merged.

        Raises:
            ConfigError: a value has the wrong type.
        """
        nested = {
            key: {**base[key], **value}
            for key, value in values.items()
            if isinstance(value, Mapping) and isinstance(base.get(key), Mapping)
        }
        return {**base, **values, **nested}

    @property
    def frame_id(self) -> str:
        """Name of the sensor's coordinate frame."""
        return self.name

    def build(self, world: World) -> Sensor:
        """The sensor in a world."""
        module, _, name = self.sensor.partition(":")
        sensor: Sensor = getattr(import_module(module), name)(self, world)
        return sensor


class Sensor(ABC):
    """Turns a Timeline into samples; has no memory, so any stamp may be asked for in any order."""

    def __init__(self, config: SensorConfig) -> None:
        self.config = config
        self.schedule = Schedule.from_hz(config.rate_hz)

    latency_ns: int = 0
    """How long after its stamp a sample is complete [ns]; one sweep for a LiDAR."""
    padded_streams: tuple[str, ...] = ()
    """Streams whose samples vary in length; observations pad them and give a count."""
    depends_on_weather: bool = False
    """Whether samples differ between weathers of the same drive."""

    @property
    def samples_per_step(self) -> int:
        """Most samples of one stream in one 50 ms step."""
        return max(1, STEP_NS // (self.schedule.period_ticks * 5_000_000))

    @abstractmethod
    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Observation space of one sample per stream, keyed by the stream's name."""

    @abstractmethod
    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """Samples of all streams at the given stamps [ns], in stamp order."""

    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[list[Sample]]:
        """Samples of one instant under several weathers, one list per weather.

        The samples are measured once for all weathers; sensors that depend on the weather override this.
        """
        samples = self.measure(timeline, [stamp_ns])
        return [samples for _ in weathers]


class Camera(Sensor):
    """A sensor whose images depend on the weather."""

    depends_on_weather = True

    @abstractmethod
    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather]
    ) -> list[list[Sample]]:
        """Samples of one instant under several weathers, one list per weather; geometry drawn once.

        A schedule may stand for a weather: sensors that remember look at it at other times as well.
        """

    def recall(self, timeline: Timeline, stamp_ns: int, weathers: Sequence[Weather]) -> Iterator[int]:
        """Stamps of the pictures before one that the sensor must have seen [ns]; each is seen in its turn.

        Measuring that picture sees those that are missing, too; this shows the progress. A sensor
        without a memory has none.
        """
        return iter(())
