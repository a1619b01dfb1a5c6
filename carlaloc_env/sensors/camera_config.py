"""Settings of cameras: their imager and shutter, and the event camera behind the same lens.

Light, so that a rig can be read before a renderer is loaded.
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.core.clock import TICK_NS, Schedule
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.sensors.base import Mount, SensorConfig

OUTPUTS = ("rgb", "depth", "semantic", "flow", "normal", "events")
"""What a camera can give; stream names are ``<output>_<name>``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImagerConfig:
    """A global-shutter imager with 3 µm pixels behind f/2.8, and its exposure control."""

    exposure_min_ms: float = 0.05
    """Shortest exposure [ms]."""
    exposure_max_ms: float = 20.0
    """Longest exposure [ms]; the control lengthens the exposure before it raises the gain."""
    gain_max_db: float = 24.0
    """Highest gain [dB]."""
    target: float = 0.18
    """Mean level that the control aims at, as a share of the largest number, before the tone curve."""
    reaction_s: float = 0.3
    """Time in which the control makes up 63 % of an error [s]."""
    electrons_per_cd_m2_s: float = 2000.0
    """Electrons in a pixel per luminance and time [e⁻/(cd/m²·s)]: 3 µm, f/2.8, 60 % quantum efficiency."""
    full_well_e: float = 10000.0
    """Electrons that give the largest number at 0 dB [e⁻]."""
    read_noise_e: float = 3.0
    """Standard deviation of reading a pixel [e⁻]."""
    dark_signal_e: float = 1.0
    """Standard deviation of the pixels' fixed offsets [e⁻] (DSNU)."""
    response: float = 0.005
    """Standard deviation of the pixels' fixed sensitivities, as a share (PRNU)."""
    noise: bool = True
    """Whether there is any noise."""
    adc_bits: int = 12
    """Bits of the converter."""
    gamma: float = 2.2
    """Exponent of the tone curve; 1 = linear."""
    vignetting: float = 0.3
    """Light lost at the farthest corner, as a share; it grows with the square of the distance."""
    lens_blur_px: float = 0.0
    """Deviation of the blur by lens and pixel area [px]; 0 = pixels see what lies at their middle."""
    bayer: bool = False
    """Whether each pixel sees one colour, in squares of RGGB, and the others are filled in from beside it."""
    restart_s: float = 5.0
    """The control begins anew, settled, at multiples of this time [s]."""

    def __post_init__(self) -> None:
        if not 0 < self.exposure_min_ms <= self.exposure_max_ms:
            raise ConfigError("imager: exposure_min_ms must be above zero and not above exposure_max_ms")
        if not 0 < self.target < 1 or not 8 <= self.adc_bits <= 16 or not 0 <= self.vignetting < 1:
            ranges = "target must lie between 0 and 1, adc_bits from 8 to 16, vignetting from 0 to 1"
            raise ConfigError(f"imager: {ranges}")
        positive = (self.reaction_s, self.electrons_per_cd_m2_s, self.full_well_e, self.gamma, self.restart_s)
        noises = (
            self.gain_max_db, self.read_noise_e, self.dark_signal_e, self.response, self.lens_blur_px
        )  # fmt: skip
        if min(positive) <= 0 or min(noises) < 0:
            raise ConfigError("imager: sizes and times must be above zero, noise and gain not below")

    def settled(self, level_cd_m2: float) -> float:
        """Exposure times gain [s] that brings a mean luminance [cd/m²] to the target, within limits."""
        wanted = self.target * self.full_well_e / (self.electrons_per_cd_m2_s * max(level_cd_m2, 1e-6))
        highest = 1e-3 * self.exposure_max_ms * 10 ** (self.gain_max_db / 20)
        return float(min(max(wanted, 1e-3 * self.exposure_min_ms), highest))

    def controlled(self, product_s: float, level_cd_m2: float, period_s: float) -> float:
        """Exposure times gain [s] of the next picture: a first-order lag of its logarithm."""
        share = 1.0 - math.exp(-period_s / self.reaction_s)
        return float(product_s * (self.settled(level_cd_m2) / product_s) ** share)

    def split(self, product_s: float) -> tuple[float, float]:
        """Exposure [s] and gain (factor) of their product."""
        exposure_s = min(product_s, 1e-3 * self.exposure_max_ms)
        return exposure_s, product_s / exposure_s


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutterConfig:
    """Times at which rows of a picture gather light; the stamp is the middle of the middle row's exposure."""

    motion_blur: bool = True
    """Whether light is gathered during the exposure, or at its middle."""
    readout_ms: float = 0.0
    """Time from the first row's exposure to the last row's [ms]; 0 = global shutter."""

    def __post_init__(self) -> None:
        if self.readout_ms < 0:
            raise ConfigError("shutter: readout_ms must not be negative")

    def span_ns(self, exposure_max_ms: float) -> int:
        """Time around the stamp in which any row may gather light [ns]."""
        return round(1e6 * (self.readout_ms + (exposure_max_ms if self.motion_blur else 0.0)))

    def rows_ns(self, stamp_ns: int, exposure_s: float, height: int) -> NDArray[np.float64]:
        """Beginning and end of every row's light [ns], shape (H, 2)."""
        middle = stamp_ns + 1e6 * self.readout_ms * (np.arange(height) / max(height - 1, 1) - 0.5)
        half = 0.5e9 * exposure_s if self.motion_blur else 0.0
        return np.stack([middle - half, middle + half], axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True)
class EventConfig:
    """Pixels of an event camera; the defaults are CARLA's threshold with the noise of a good chip."""

    threshold_on: float = 0.3
    """Rise of log intensity that makes an event, no unit."""
    threshold_off: float = 0.3
    """Fall of log intensity that makes an event, no unit."""
    threshold_sigma: float = 0.03
    """Standard deviation of both thresholds between pixels, no unit (v2e: 0.03)."""
    refractory_us: int = 500
    """Shortest time between two events of a pixel [µs] (v2e: 500)."""
    leak_hz: float = 0.1
    """Positive events of a pixel in steady light [Hz]."""
    shot_hz: float = 0.1
    """Noise events of a pixel [Hz]."""
    dark_cd_m2: float = 0.05
    """Luminance whose photocurrent equals the dark current [cd/m²]."""
    rate_max_mev_s: float = 0.0
    """Most events the read-out passes on [million/s]; 0 = all."""
    step_px: float = 1.0
    """Farthest that anything moves between two samples of the signal [px]."""
    restart_s: float = 10.0
    """Pixels' memory begins anew at multiples of this time [s]."""

    def __post_init__(self) -> None:
        if min(self.threshold_on, self.threshold_off) < 0.01:
            raise ConfigError("event thresholds must be at least 0.01")
        rates = (self.leak_hz, self.shot_hz, self.rate_max_mev_s, self.threshold_sigma)
        if min(*rates, self.refractory_us) < 0:
            raise ConfigError(
                "leak, shot noise, refractory time and rate limit of events must not be negative"
            )
        if self.dark_cd_m2 <= 0 or self.step_px <= 0 or self.restart_s <= 0:
            raise ConfigError("dark_cd_m2, step_px and restart_s of events must be above zero")


def beginning_ns(stamp_ns: int, period_ns: int, restart_ns: int) -> int:
    """Stamp of the state without history from which that at a stamp follows [ns].

    Args:
        stamp_ns: A multiple of the period [ns].
        period_ns: Time between two states [ns].
        restart_ns: States at its multiples do not depend on earlier ones [ns].
    """
    restarted_ns = (stamp_ns - period_ns) // restart_ns * restart_ns
    return max(rounded_up_ns(restarted_ns, period_ns), 0)


def rounded_up_ns(stamp_ns: int, period_ns: int) -> int:
    """The next multiple of a period, or the stamp itself [ns]."""
    return -(-stamp_ns // period_ns) * period_ns


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig(SensorConfig):
    """A camera; the defaults are the CARLA-Loc paper's."""

    kind: ClassVar[str] = "camera"
    sensor: ClassVar[str] = "carlaloc_env.sensors.camera:CameraSensor"

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
    """Whether drops or flakes cling to the lens while it rains or snows."""
    outputs: tuple[str, ...] = ("rgb", "depth", "semantic")
    """Streams, of `OUTPUTS`; with ``flow`` all of them come one period late in a live run."""
    events: EventConfig = field(default_factory=EventConfig)
    """Pixels of the event camera behind the same lens, if ``events`` is given; flakes fire, drops do not."""

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
