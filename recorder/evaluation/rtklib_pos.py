"""Solutions of RTKLIB (``.pos``): latitudes, longitudes and heights, or Earth-fixed places, over time."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.core.geodesy import GeoReference, ecef_to_geodetic
from carlaloc_env.sensors.raw_gnss.systems import GPS_EPOCH_NS, LEAP_S, WEEK_S
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_checks import in_order

SUFFIX = ".pos"
"""Ending of RTKLIB's files."""
_FORM = "time, latitude [deg], longitude [deg], height [m], or time, x, y, z [m]"


def read_pos(path: Path, origin: Array | None = None) -> Trajectory:
    """Read a solution; without attitudes, positions are east, north, up of an origin.

    Args:
        path: The file, with out-solformat ``llh`` in degrees or ``xyz``, out-timesys ``gpst`` or ``utc``.
        origin: Latitude [deg], longitude [deg], height [m]; None: the first position.

    Raises:
        EvaluationError: the file is missing or of another form.
    """
    unix_ns, geodetic = _rows(path)
    latitude, longitude, height = (geodetic[0] if origin is None else origin).tolist()
    place = GeoReference(latitude_deg=latitude, longitude_deg=longitude, height_m=height)
    return in_order(path, np.array(unix_ns, np.int64), place.geodetic_to_enu(geodetic), None)


def origin_of(path: Path) -> Array:
    """Latitude [deg], longitude [deg] and height [m] of a file's first position.

    Raises:
        EvaluationError: the file is missing or of another form.
    """
    first: Array = _rows(path)[1][0]
    return first


def _rows(path: Path) -> tuple[list[int], Array]:
    """Unix times [ns], and latitude [deg], longitude [deg], height [m] (N, 3)."""
    lines = read_text(path, "solution", EvaluationError).splitlines()
    head = [line for line in lines if line.startswith("%") and ("GPST" in line or "UTC" in line)]
    rows = [line.split() for line in lines if line.strip() and not line.startswith("%")]
    if not head or not rows:
        raise EvaluationError(f"{path} holds no solutions of RTKLIB; give a file that rnx2rtkp has written")
    ahead_s = 0 if "UTC" in head[-1] else LEAP_S
    try:
        unix_ns = [_time_ns(row[0], row[1]) - ahead_s * 1_000_000_000 for row in rows]
        numbers = np.array([[float(value) for value in row[2:5]] for row in rows])
        if numbers.shape[1] != 3:
            raise ValueError
    except (IndexError, ValueError) as error:
        raise EvaluationError(f"{path} has other columns than {_FORM}; set out-solformat to llh") from error
    if "x-ecef" in head[-1]:
        return unix_ns, ecef_to_geodetic(numbers)
    if "latitude" not in head[-1]:
        raise EvaluationError(f"{path} has other columns than {_FORM}; set out-solformat to llh")
    return unix_ns, numbers


def _time_ns(day: str, time: str) -> int:
    """Time [ns since 1970] of ``yyyy/mm/dd hh:mm:ss.sss``, or of a GPS week and its seconds, as it stands."""
    if "/" not in day:
        return GPS_EPOCH_NS + int(day) * WEEK_S * 1_000_000_000 + round(float(time) * 1e9)
    hours, minutes, seconds = time.split(":")
    begin = datetime.strptime(day, "%Y/%m/%d").replace(tzinfo=timezone.utc).timestamp()
    whole_s = int(begin) + 3600 * int(hours) + 60 * int(minutes)
    return whole_s * 1_000_000_000 + round(float(seconds) * 1e9)
