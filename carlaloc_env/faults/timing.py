"""Faults of time (lost samples, one by one or in bursts, and wrong stamps) and of the written mount."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from carlaloc_env.core import clock
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.faults.fields import check_fields, fault, setting
from carlaloc_env.samples import Sample
from carlaloc_env.sensors.base import SensorConfig

_KALIBR = "Furgale et al., IROS 2013"
_GILBERT = "Gilbert, BSTJ 1960; Elliott, BSTJ 1963"
JITTER_MAX_PERIODS = 0.45
"""Largest jitter of a stamp, so that samples keep their order [periods]."""
PREFIX = "calib_"
"""Beginning of the names of all faults of calibration."""
_PLACE = "added to the written mount, along the car's {} axis"
_TURN = "added to the written {} of the mount"


@dataclass(frozen=True, slots=True, kw_only=True)
class Draws:
    """Random numbers of a sensor's faults."""

    seed: int
    """Seed of the noise."""
    target: str
    """What the faults were given for, e.g. ``lidar`` or ``camera.left``."""
    period_ns: int
    """Time between two samples [ns]."""

    def at(self, what: str, stamp_ns: int = 0) -> np.random.Generator:
        """Generator of a fault and stamp, the same in any order of calls."""
        return clock.stream(self.seed, f"{self.target}/fault/{what}", stamp_ns)

    def is_in_burst(self, what: str, stamp_ns: int, share: float, length: float) -> bool:
        """Whether a sample lies in a burst of Gilbert's and Elliott's chain in its stationary state.

        Two chains that draw the same numbers meet at a number which leads both states into one. From the
        last such number on the state is known, whatever came before (Propp and Wilson 1996, coupling from
        the past), so that any stamp can be asked for alone.

        Args:
            what: Name of the fault.
            stamp_ns: The stamp [ns].
            share: Share of the samples that lie in bursts, 0–0.99.
            length: Mean length of a burst [samples].
        """
        if share <= 0.0:
            return False
        stay = 1.0 - 1.0 / length
        enter = min((1.0 - stay) * share / (1.0 - share), 1.0)
        later: list[float] = []
        while True:
            u = float(self.at(what, stamp_ns - len(later) * self.period_ns).random())
            if not min(enter, stay) <= u < max(enter, stay):
                break
            later.append(u)
        inside = u < enter
        for u in reversed(later):
            inside = u < (stay if inside else enter)
        return inside

    def burst_begin_ns(self, what: str, stamp_ns: int, share: float, length: float) -> int | None:
        """First stamp of the burst that a sample lies in [ns]; None: it lies in none."""
        begin_ns = None
        while self.is_in_burst(what, stamp_ns, share, length):
            begin_ns = stamp_ns
            stamp_ns -= self.period_ns
        return begin_ns


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingFaults:
    """Faults of time of any sensor, and when its faults act."""

    begin_s: float = setting(
        "s", "faults of the sensor's data act from this time of the drive on", default=0.0
    )
    end_s: float = setting("s", "they act before this time", default=float("inf"))
    drop_share: float = fault(
        "1", "share of the samples that is lost, each by itself", worst=0.9, low=0.0, high=1.0
    )
    burst_share: float = fault(
        "1", "share of the samples that is lost in bursts", worst=0.8, low=0.0, high=0.99, source=_GILBERT
    )
    burst_length: float = setting("samples", "mean length of a burst", default=5.0, low=1.0)
    time_offset_ms: float = fault("ms", "added to every stamp", worst=200.0, source=_KALIBR)
    time_jitter_ms: float = fault(
        "ms", "standard deviation of a normal error of every stamp, cut at 0.45 periods", worst=20.0, low=0.0
    )
    time_drift_ppm: float = fault(
        "µs/s", "the clock gains so much; stamps are right at the drive's beginning", worst=5000.0
    )

    def __post_init__(self) -> None:
        check_fields(self, "fault")
        for name in ("burst", "outage"):
            share, length = getattr(self, f"{name}_share", 0.0), getattr(self, f"{name}_length", 1.0)
            # A sample at least lies between two bursts.
            if share > length / (length + 1.0):
                raise ConfigError(
                    f"share {share:g} of {name}s of {length:g} samples; give longer ones or less"
                )

    def acts_at(self, stamp_ns: int) -> bool:
        """Whether faults of the data act at a true stamp [ns]."""
        return self.begin_s * 1e9 <= stamp_ns < self.end_s * 1e9

    def faulty_stamp_ns(self, stamp_ns: int, draws: Draws) -> int | None:
        """Stamp that a sample gets [ns]; None: the sample is lost."""
        if self.drop_share and draws.at("drop", stamp_ns).random() < self.drop_share:
            return None
        if draws.is_in_burst("burst", stamp_ns, self.burst_share, self.burst_length):
            return None
        late_ns = 1e6 * self.time_offset_ms + 1e-6 * self.time_drift_ppm * stamp_ns
        if self.time_jitter_ms:
            most_ns = JITTER_MAX_PERIODS * draws.period_ns
            jitter_ns = 1e6 * self.time_jitter_ms * draws.at("jitter", stamp_ns).standard_normal()
            late_ns += min(max(jitter_ns, -most_ns), most_ns)
        return stamp_ns + round(late_ns)

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A sample with the data of a faulty sensor, its stamp unchanged; the same where they are sound.

        Args:
            sample: Sample of a sound sensor, at its true stamp.
            draws: Random numbers of the faults.
        """
        return sample

    def believed(self, config: SensorConfig) -> SensorConfig:
        """The configuration that calibration files and readers show of a sensor."""
        return config


@dataclass(frozen=True, slots=True, kw_only=True)
class MountedFaults(TimingFaults):
    """Faults of a sensor whose place on the car is calibrated against the IMU."""

    calib_x_m: float = fault("m", _PLACE.format("forward"), worst=0.5)
    calib_y_m: float = fault("m", _PLACE.format("left"), worst=0.5)
    calib_z_m: float = fault("m", _PLACE.format("upward"), worst=0.5)
    calib_roll_deg: float = fault("deg", _TURN.format("roll"), worst=10.0)
    calib_pitch_deg: float = fault("deg", _TURN.format("pitch"), worst=10.0)
    calib_yaw_deg: float = fault("deg", _TURN.format("yaw"), worst=10.0)

    def believed(self, config: SensorConfig) -> SensorConfig:
        """The configuration with the written mount."""
        moved = (self.calib_x_m, self.calib_y_m, self.calib_z_m)
        turned = (self.calib_roll_deg, self.calib_pitch_deg, self.calib_yaw_deg)
        place: Any = tuple(a + b for a, b in zip(config.mount.position_m, moved, strict=True))
        turn: Any = tuple(a + b for a, b in zip(config.mount.rpy_deg, turned, strict=True))
        return replace(config, mount=replace(config.mount, position_m=place, rpy_deg=turn))
