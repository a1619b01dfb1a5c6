"""Raw GNSS receivers on simple drives, their files, and RTKLIB's solutions of these."""

import dataclasses
import shutil
import subprocess
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.samples import GnssFix, GnssRaw
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.raw_gnss.config import RangeErrors, RawConfig
from recorder.writers.formats.rinex import RinexEncoder, RinexWriter

MOUNT = Mount(position_m=(0.7, 0.1, 1.5))
BASE_M = (1500.0, -2000.0, 20.0)
"""A base station, 2.5 km away."""
OFF = RangeErrors.off()
MODELS = dataclasses.replace(
    OFF, receiver_clock=True, satellite_clocks=True, ambiguities=True, ionosphere=1e-9, troposphere_m=1e-9
)
"""Clocks, group delays and the air as the models have them, without any noise."""


def config(errors: RangeErrors = OFF, rate_hz: float = 1.0, **receiver: Any) -> GnssConfig:
    raw = RawConfig(errors=errors, **receiver)
    return GnssConfig(raw=True, rate_hz=rate_hz, mount=MOUNT, receiver=raw)


def measured(world: Any, drive: Any, receiver: GnssConfig, seconds: float) -> dict[str, list[Any]]:
    """Samples by stream."""
    period_ns = round(1e9 / receiver.rate_hz)
    samples = receiver.build(world).measure(drive, list(range(0, round(seconds * 1e9), period_ns)))
    return {name: [s for s in samples if s.sensor == name] for name in ("gnss", "gnss_raw", "gnss_base")}


def in_a_street(
    seconds: float, half_width_m: float = 10.0, height_m: float = 25.0, **receiver: Any
) -> tuple[Any, Any, dict[str, list[Any]]]:
    """World, drive at 8 m/s between two walls, and samples, with all errors."""
    scenery, middle_m = Scenery(), half_width_m + 5.0
    walls = [scenery.box([-400, s * middle_m - 5, 0], [900, s * middle_m + 5, height_m]) for s in (-1, 1)]
    world, drive = scenery.world(walls), scenery.drive(scenery.straight(8.0), seconds + 5.0)
    return world, drive, measured(world, drive, config(RangeErrors(), **receiver), seconds)


def places(world: Any, fixes: list[GnssFix]) -> np.ndarray:
    """Positions of fixes, world [m]."""
    return np.array(
        world.geo.geodetic_to_enu([[f.latitude_deg, f.longitude_deg, f.altitude_m] for f in fixes])
    )


def antenna(drive: Any, samples: list[Any]) -> np.ndarray:
    """True positions of the antenna, world [m]."""
    motion = drive.ego_motion([sample.stamp_ns for sample in samples])
    return np.array(motion.at_mount(MOUNT.T_base_sensor).position_m)


def write(folder: Path, samples: dict[str, list[Any]]) -> Path:
    """The files of a sequence."""
    with RinexWriter(folder, RinexEncoder()) as writer:
        for sample in sorted((s for part in samples.values() for s in part), key=lambda s: s.stamp_ns):
            writer.write(sample)
    return folder


def rtklib(folder: Path, mode: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unix times [s], latitude, longitude and height, and quality of rnx2rtkp's solutions."""
    if shutil.which("rnx2rtkp") is None:
        pytest.skip("rnx2rtkp is not installed; apt-get install rtklib")
    files = ["gnss.obs", *(["gnss_base.obs"] if mode == "rtk" else []), "gnss.nav"]
    command = ["rnx2rtkp", "-k", f"gnss_{mode}.conf", "-o", "out.pos", *files]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=600)
    lines = [line.split() for line in (folder / "out.pos").read_text().splitlines() if line[:1] != "%"]
    rows = np.array([[float(value) for value in line[:6]] for line in lines])
    unix_s = rows[:, 0] * 604_800 + rows[:, 1] + 315_964_800 - 18
    return unix_s, rows[:, 2:5], rows[:, 5]


def of_times(samples: dict[str, list[Any]], unix_s: np.ndarray, date: str) -> list[GnssFix]:
    """Fixes of the epochs at true times [s]."""
    begin_s = datetime.fromisoformat(f"{date}+00:00" if "T" in date else f"{date}T00:00+00:00").timestamp()
    by_time = {round(fix.stamp_ns * 1e-9, 1): fix for fix in samples["gnss"]}
    return [by_time[round(time, 1)] for time in unix_s - begin_s]


def first_signals(raw: GnssRaw) -> np.ndarray:
    """Rows of the first signal of each satellite."""
    return np.flatnonzero(np.isin(raw.code, ["1C", "2I"]))
