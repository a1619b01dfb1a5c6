"""Lines and heights of all roads of a plan, before they are cut into legs and sections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from carlaloc_env.authoring.elements.cross_sections import CrossSection
from carlaloc_env.authoring.geometry.elevation import Record, height_at, hermite, level
from carlaloc_env.authoring.geometry.junction_planes import leaning
from carlaloc_env.authoring.geometry.newton import PlanError
from carlaloc_env.authoring.geometry.plan_view_curves import Path, Pose, curve_between

from .curves import fillet, meeting, trimmed
from .junctions import setbacks
from .profiles import Climb, Dip, Profile, climb, dip, ramp, smooth, vertical_curves
from .ramps import Gore, OnRay, RampEnd, ramp_end

if TYPE_CHECKING:
    from .plan import RoadPlan, TownPlan

WALKERS_SETBACK_M = 1.5
"""Half the length of the junction that stands for a crosswalk with lights between junctions [m]."""
VERTICAL_ACCELERATION_MPS2 = 0.27
"""What the vertical curves of ramps ask of a car at the limit, a tenth below the bound of our maps."""


@dataclass(slots=True)
class Laid:
    """One road's line and heights between the junctions at its ends."""

    road: RoadPlan
    axis: Path
    """From node to node."""
    path: Path
    """Without what belongs to the junctions."""
    first_m: float
    """Station of the axis at which the path begins [m]."""
    elevation: list[Record] = field(default_factory=list)
    """Along the path."""
    tilt: list[Record] = field(default_factory=list)
    """Superelevation along the path [rad]; empty: level across."""
    bottom_m: float = 0.0
    """Lowest point of a `Dip` along the path [m]."""
    ends: dict[str, RampEnd] = field(default_factory=dict)
    """Lines of a ramp in its gores, by their names."""

    def grade_at(self, axis_m: float) -> tuple[float, float]:
        """Height [m] and grade at a station of the axis."""
        s = axis_m - self.first_m
        return height_at(self.elevation, s % self.path.length if self.road.closed else s)


def lay_out(plan: TownPlan) -> list[Laid]:
    """Lines and heights of all roads, in the plan's order.

    Raises:
        PlanError: Ends are unknown, or the geometry does not fit.
    """
    gores = {gore.name: (road, gore) for road in plan.roads for gore in road.gores}
    axes: dict[str, Path] = {}
    ends: dict[str, dict[str, RampEnd]] = {}
    for road in _in_order(plan, gores):
        ends[road.name] = {
            name: ramp_end(gores[name][1], axes[gores[name][0].name], gores[name][0].closed,
                           gores[name][0].cross, road.cross)
            for name in (road.a, road.b) if name in gores
        }  # fmt: skip
        axes[road.name] = _axis(plan, road, ends[road.name])
    trims = _trims(plan, axes)
    laid: dict[str, Laid] = {}
    for road in _in_order(plan, gores):
        first, last = trims[road.name]
        path = trimmed(axes[road.name], first, last).settled()
        road_laid = Laid(road, axes[road.name], path, first, ends=ends[road.name])
        levels = [_level(name, laid, gores) for name in (road.a, road.b)]
        road_laid.elevation, road_laid.bottom_m = _elevation(plan, road_laid, levels[0], levels[1])
        road_laid.tilt = _tilt(plan, road_laid)
        laid[road.name] = road_laid
    return [laid[road.name] for road in plan.roads]


def _in_order(plan: TownPlan, gores: dict[str, tuple[RoadPlan, Gore]]) -> list[RoadPlan]:
    """Roads, each after those that it leaves or joins."""
    done: list[RoadPlan] = []
    rest = list(plan.roads)
    while rest:
        names = {road.name for road in done}
        ready = [
            r for r in rest
            if all(n not in gores or gores[n][0].name in names for n in (r.a, r.b))
        ]  # fmt: skip
        if not ready:
            raise PlanError(f"ramps lead from each other in a circle: {', '.join(r.name for r in rest)}")
        done += ready
        rest = [road for road in rest if road not in ready]
    return done


def _axis(plan: TownPlan, road: RoadPlan, ends: dict[str, RampEnd]) -> Path:
    if road.path is not None:
        return road.path
    for name in (road.a, road.b):
        if name not in plan.nodes and name not in ends:
            raise PlanError(f"road '{road.name}' ends at '{name}', which is no node and no gore of the plan")
    if ends:
        return _ramp_axis(plan, road, ends)
    a, b = plan.nodes[road.a], plan.nodes[road.b]
    first, last = road.shifts
    inner = [_fixed(road, bend) for bend in road.bends]
    points = [
        (a.x + first[0], a.y + first[1]),
        *((x, y) for x, y, _, _ in inner),
        (b.x + last[0], b.y + last[1]),
    ]
    return fillet(points, [(radius, spiral) for _, _, radius, spiral in inner])


def _fixed(
    road: RoadPlan, bend: tuple[float, float, float, float] | OnRay
) -> tuple[float, float, float, float]:
    if isinstance(bend, OnRay):
        raise PlanError(f"road '{road.name}' has a bend on a ray at an end that is no gore")
    return bend


def _ramp_axis(plan: TownPlan, road: RoadPlan, ends: dict[str, RampEnd]) -> Path:
    """Lead out of a gore, straights with bends, lead into a gore."""
    leaving, joining = ends.get(road.a), ends.get(road.b)
    start = leaving.straight(merges=False) if leaving else None
    end = joining.straight(merges=True) if joining else None
    if start is not None and end is not None and not road.bends:
        middle = curve_between(start, end)
    else:
        points, corners = _corners(plan, road, start, end)
        middle = fillet(points, corners)
    pieces = middle.pieces
    if leaving is not None:
        pieces = (leaving.lead, *pieces)
    if joining is not None:
        pieces = (*pieces, joining.lead)
    return Path(leaving.inside.end if leaving else middle.start, pieces)


def _corners(
    plan: TownPlan, road: RoadPlan, start: Pose | None, end: Pose | None
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    first = (start.x, start.y) if start else (plan.nodes[road.a].x, plan.nodes[road.a].y)
    last = (end.x, end.y) if end else (plan.nodes[road.b].x, plan.nodes[road.b].y)
    points, corners = [first], []
    for k, bend in enumerate(road.bends):
        if isinstance(bend, OnRay):
            points.append(
                _on_ray(road, bend, start if k == 0 else None, end if k == len(road.bends) - 1 else None)
            )
            corners.append((bend.radius_m, bend.clothoid_m))
        else:
            points.append((bend[0], bend[1]))
            corners.append((bend[2], bend[3]))
    return [*points, last], corners


def _on_ray(road: RoadPlan, bend: OnRay, start: Pose | None, end: Pose | None) -> tuple[float, float]:
    if start is not None and end is not None and bend.distance_m is None:
        at = start.ahead(meeting(start, end)[0])
    elif bend.distance_m is None or (start is None and end is None):
        raise PlanError(f"ramp '{road.name}': a bend on a ray stands next to its gore and has a distance")
    else:
        at = start.ahead(bend.distance_m) if start is not None else end.ahead(-bend.distance_m)  # type: ignore[union-attr]
    return at.x, at.y


def _trims(plan: TownPlan, axes: dict[str, Path]) -> dict[str, list[float]]:
    """What the junctions at both ends take from every road [m]."""
    trims = {road.name: [0.0, 0.0] for road in plan.roads}
    for node in plan.nodes.values():
        met = [
            (road, side)
            for road in plan.roads
            for side, name in enumerate((road.a, road.b))
            if name == node.name
        ]
        if not met:
            raise PlanError(f"no road ends at node '{node.name}'")
        headings = [axes[r.name].start.h if side == 0 else axes[r.name].end.h + math.pi for r, side in met]
        kerbs = [_kerb_m(road.cross, road.ends[side]) for road, side in met]
        if node.roundabout is not None:
            lengths = [node.roundabout.arm_m] * len(met)
        elif node.control == "bulb":
            lengths = [0.0]
        else:
            least = WALKERS_SETBACK_M if node.control == "walkers" else node.least_m
            lengths = setbacks(headings, kerbs, node.corner_m, least)
            wide = {name for pair in node.slips for name in pair}
            lengths = [max(s, node.slip_m) if road.name in wide else s
                       for (road, _), s in zip(met, lengths, strict=True)]  # fmt: skip
        for (road, side), length in zip(met, lengths, strict=True):
            trims[road.name][side] = length
    return trims


def _level(
    name: str, laid: dict[str, Laid], gores: dict[str, tuple[RoadPlan, Gore]]
) -> tuple[float, float] | None:
    """Height [m] and grade in travel direction that a gore gives to its ramp."""
    if name not in gores:
        return None
    road, gore = gores[name]
    z, grade = laid[road.name].grade_at(gore.ramp_m)
    return round(z, 9), round(grade if gore.side == "R" else -grade, 11)


def _elevation(
    plan: TownPlan, laid: Laid, first: tuple[float, float] | None, last: tuple[float, float] | None
) -> tuple[list[Record], float]:
    """Elevation records, and the station of the lowest point of a dip."""
    road, path, length = laid.road, laid.path, laid.path.length
    if isinstance(road.climb, Profile):
        points = [(s - laid.first_m, z) for s, z in road.climb.points]
        return vertical_curves(points, length, road.climb.k_m), 0.0
    if road.closed:
        return level(0.0), 0.0
    a, b = plan.nodes.get(road.a), plan.nodes.get(road.b)
    z0, grade0 = first if first is not None else a.plane.height(path.start)  # type: ignore[union-attr]
    z1, grade1 = last if last is not None else b.plane.height(path.end)  # type: ignore[union-attr]
    if first is not None or last is not None:
        k_m = (road.speed_kmh / 3.6) ** 2 / (100 * VERTICAL_ACCELERATION_MPS2)
        return ramp(z0, grade0, z1, grade1, length, k_m), 0.0
    assert a is not None
    assert b is not None
    if isinstance(road.climb, Dip):
        bottom = along(path, road.climb.x, road.climb.y)
        return dip(a.z, b.z, length, road.climb, bottom), bottom
    if isinstance(road.climb, Climb):
        return climb(a.z, b.z, length, road.climb), 0.0
    if not (a.plane.is_level and b.plane.is_level):
        return hermite(z0, grade0, z1, grade1, length), 0.0
    return (level(a.z) if a.z == b.z else smooth(a.z, b.z, length)), 0.0


def _tilt(plan: TownPlan, laid: Laid) -> list[Record]:
    """Superelevation that lays both ends of a road into the planes of their nodes."""
    road, path = laid.road, laid.path
    ends = [(plan.nodes.get(road.a), path.start), (plan.nodes.get(road.b), path.end)]
    tilts = [0.0 if node is None else node.plane.tilt(pose) for node, pose in ends]
    if any(tilts) and road.climb is not None:
        raise PlanError(f"road '{road.name}' has a climb, but ends at a node with a grade")
    return leaning(tilts[0], tilts[1], path.length)


def along(path: Path, x: float, y: float) -> float:
    """Station of a point beside the first straight of a road."""
    dx, dy = x - path.start.x, y - path.start.y
    return dx * math.cos(path.start.h) + dy * math.sin(path.start.h)


def nearest(path: Path, points: Sequence[tuple[float, float]], step_m: float = 1.0) -> list[float]:
    """Stations of a path that lie nearest to points, to within `step_m`."""
    count = max(2, int(path.length / step_m))
    poses = [path.at(path.length * k / count) for k in range(count + 1)]
    stations = []
    for x, y in points:
        k = min(range(count + 1), key=lambda k: (poses[k].x - x) ** 2 + (poses[k].y - y) ** 2)
        stations.append(path.length * k / count)
    return stations


def _kerb_m(cross: CrossSection, layout: str) -> float:
    """From the axis to the kerb at an end with this layout [m]."""
    half = 0.5 * cross.median_m
    return cross.kerb_m + (0.0 if layout == "plain" else max(half, 0.5 * cross.pocket_m) - half)
