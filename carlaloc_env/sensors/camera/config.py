"""Configuration of cameras."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.core.clock import TICK_NS, Schedule
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.scene.materials import TAG_TABLES
from carlaloc_env.sensors.base import Mount, SensorConfig
from carlaloc_env.sensors.event_camera.config import EventConfig
from carlaloc_env.sensors.imaging.imager import ImagerConfig
from carlaloc_env.sensors.imaging.shutter_config import ShutterConfig
from carlaloc_env.sensors.imaging.state_chain import beginning_ns

OUTPUTS = ("rgb", "depth", "semantic", "flow", "normal", "events")
"""What a camera can give; stream names are ``<output>_<name>``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig(SensorConfig):
    """A camera; the defaults are the CARLA-Loc paper's."""

    kind: ClassVar[str] = "camera"
    sensor: ClassVar[str] = "carlaloc_env.sensors.camera.camera:CameraSensor"

    name: str = "left"
    """Name of the camera; its streams end with it, and its frame is ``camera_<name>``."""
    mount: Mount = field(default_factory=lambda: Mount(axes="optical"))
    """Where it sits on the car."""
    rate_hz: float = 20.0
    """Pictures per second [Hz]."""
    pinhole: Pinhole = field(default_factory=Pinhole)
    """Intrinsics."""
    lens: Lens = field(default_factory=Lens)
    """Distortion; the default has none."""
    imager: ImagerConfig | None = None
    """Exposure control, noise and tone curve; None: the renderer's own picture, which has noise by night."""
    shutter: ShutterConfig | None = None
    """Motion blur and rolling shutter, which need an imager; None: an infinitely short exposure."""
    leaf_wind_mps: float = 0.0
    """Wind that sways leaves [m/s], the same in all weathers; LiDARs, events and flow see still leaves."""
    lens_drops: bool = False
    """Whether drops cling to the lens while it rains."""
    outputs: tuple[str, ...] = ("rgb", "depth", "semantic")
    """Streams, of `OUTPUTS`; with ``flow`` all of them come one period late in a live run."""
    events: EventConfig = field(default_factory=EventConfig)
    """Pixels of the event camera behind the same lens, if ``events`` is given; falling drops fire none."""
    tag_table: str = TAG_TABLES[0]
    """Numbers of the semantic tags: as in CARLA ``0.9.14`` and later, or up to ``0.9.13``."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        if not self.outputs or set(self.outputs) - set(OUTPUTS):
            raise ConfigError(
                f"camera '{self.name}': outputs {list(self.outputs)}; choose from {', '.join(OUTPUTS)}"
            )
        if self.shutter is not None and self.imager is None:
            raise ConfigError(f"camera '{self.name}': a shutter needs an imager, which sets its exposure")
        if not 0.0 <= self.leaf_wind_mps <= 40.0:
            raise ConfigError(f"camera '{self.name}': leaf_wind_mps must lie between 0 and 40")
        if self.tag_table not in TAG_TABLES:
            raise ConfigError(unknown_name("tag table", self.tag_table, TAG_TABLES))

    @property
    def frame_id(self) -> str:
        """Optical frame: x right, y down, z forward."""
        return f"camera_{self.name}"

    def remembers_from_ns(self, stamp_ns: int) -> int:
        """Stamp of the earliest picture on which that of a stamp depends [ns].

        Event pixels and exposure control remember, and begin anew every `restart_s`.
        """
        period_ns = Schedule.from_hz(self.rate_hz).period_ticks * TICK_NS
        restarts_s = [self.events.restart_s] if "events" in self.outputs else []
        if self.imager is not None and "rgb" in self.outputs:
            restarts_s.append(self.imager.restart_s)
        begun = [beginning_ns(stamp_ns, period_ns, round(1e9 * restart_s)) for restart_s in restarts_s]
        return min(begun, default=stamp_ns)
