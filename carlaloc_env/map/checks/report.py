"""The report on a map: its contents and its faults."""

import csv
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.output_paths import check_output_file
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.core.map_projection import ProjectedReference
from carlaloc_env.map.checks.graph import (
    graph_problems,
    link_problems,
    membership_problems,
    reciprocity_problems,
)
from carlaloc_env.map.checks.roads import (
    Problem,
    clearance_problems,
    passage_problems,
    plan_view_problems,
    road_problems,
)
from carlaloc_env.map.checks.signals import signal_problems
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.opendrive.records import OpenDrive

CSV_SUFFIXES = (".csv",)
"""Suffixes of tables."""
_NUMBER = re.compile(r"[-+]?\d[\w.+-]*")
"""Numbers and ids in messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapReport:
    """The contents of a map and its faults."""

    source: str
    revision: str
    roads: int
    junctions: int
    lanes: int
    driving_lanes: int
    lane_km: float
    """Length of all driving lanes, those in junctions included [km]."""
    junction_lane_km: float
    """Of that, inside junctions [km]."""
    signals: int
    signs: int
    crosswalks: int
    origin: dict[str, float]
    """The world's origin: latitude, longitude [deg], height [m], and azimuth of world y from north [deg]."""
    shift_m: tuple[float, float]
    """The world's origin in the coordinates of the file."""
    extent_min_m: tuple[float, float, float]
    """Lowest x, y, z of all driving lanes."""
    extent_max_m: tuple[float, float, float]
    """Highest x, y, z of all driving lanes."""
    problems: tuple[Problem, ...]

    @property
    def errors(self) -> tuple[Problem, ...]:
        """Problems of severity error."""
        return tuple(p for p in self.problems if p.severity == "error")

    def as_dict(self) -> dict[str, object]:
        """Plain values for JSON."""
        return asdict(self)


def check_map(path: Path) -> MapReport:
    """Reads a map and looks for faults.

    Raises:
        MapError: The file cannot be read as a map at all.
    """
    xodr = read_opendrive(path)
    return report(xodr, build_network(xodr))


def report(xodr: OpenDrive, network: LaneNetwork) -> MapReport:
    """The report of a map that is read already; problems in the order of the file."""
    rows = [
        *road_problems(xodr, network),
        *plan_view_problems(xodr, network),
        *clearance_problems(network),
        *passage_problems(network),
        *link_problems(network),
        *reciprocity_problems(xodr),
        *membership_problems(xodr),
        *graph_problems(network),
        *signal_problems(xodr, network),
    ]
    checked = [Problem(severity=s, element=e, id=i, line=n, message=m) for s, e, i, n, m in rows]
    problems = [*xodr.notes, *network.broken_links, *checked]
    driving = np.array([lane.type == "driving" for lane in network.lanes])
    inside = np.array([lane.junction_id is not None for lane in network.lanes])
    length = network.tables.length_m
    points = network.tables.position_m[np.repeat(driving, network.tables.count)]
    low = points.min(axis=0) if len(points) else np.zeros(3)
    high = points.max(axis=0) if len(points) else np.zeros(3)
    return MapReport(
        source=xodr.source,
        revision=".".join(str(n) for n in xodr.revision),
        roads=len(xodr.roads),
        junctions=len(xodr.junctions),
        lanes=len(network.lanes),
        driving_lanes=int(driving.sum()),
        lane_km=float(length[driving].sum()) / 1e3,
        junction_lane_km=float(length[driving & inside].sum()) / 1e3,
        signals=len(network.signals),
        signs=len(network.static_signs),
        crosswalks=len(network.crosswalks),
        origin=_origin(xodr.geo),
        shift_m=xodr.shift_m,
        extent_min_m=(float(low[0]), float(low[1]), float(low[2])),
        extent_max_m=(float(high[0]), float(high[1]), float(high[2])),
        problems=tuple(sorted(problems, key=lambda p: (p.severity, p.line))),
    )


def grouped(problems: Sequence[Problem]) -> list[tuple[Problem, int]]:
    """The first of all problems that differ in numbers and names alone, and how many there are of each."""
    first: dict[tuple[str, str, str], Problem] = {}
    counts: Counter[tuple[str, str, str]] = Counter()
    for problem in problems:
        key = (problem.severity, problem.element, _NUMBER.sub("#", problem.message))
        first.setdefault(key, problem)
        counts[key] += 1
    return [(problem, counts[key]) for key, problem in first.items()]


def _origin(geo: GeoReference | None) -> dict[str, float]:
    geo = geo or GeoReference(latitude_deg=0.0, longitude_deg=0.0)
    azimuth = geo.azimuth_rad if isinstance(geo, ProjectedReference) else 0.0
    return {
        "latitude_deg": geo.latitude_deg,
        "longitude_deg": geo.longitude_deg,
        "height_m": geo.height_m,
        "azimuth_deg": math.degrees(azimuth),
    }


def write_waypoints_csv(network: LaneNetwork, step_m: float, path: Path, *, overwrite: bool = False) -> int:
    """Writes the poses of all driving lanes every `step_m` of s; returns their number.

    Columns road_id, section, lane_id, s, x, y, z [m], heading [rad, travel direction], world frame.

    Raises:
        MapError: The step is not usable or the file cannot be written.
        OutputError: The file exists, or its name does not end in .csv.
    """
    check_output_file(path, suffixes=CSV_SUFFIXES, overwrite=overwrite)
    rows = network.waypoints(step_m)
    with atomic_write(path, MapError) as part, part.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(rows.dtype.names or ())
        out.writerows(rows.tolist())
    return len(rows)
