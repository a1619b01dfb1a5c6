"""Cutting a laid-out road at its gores into the roads of the map."""

from carlaloc_env.authoring.elements.cross_sections import road_sections
from carlaloc_env.authoring.elements.ids import OBJECT, ROAD, Numbers
from carlaloc_env.authoring.elements.map_parts import RoadPart, StretchPart
from carlaloc_env.authoring.geometry.elevation import Record
from carlaloc_env.authoring.geometry.newton import PlanError
from carlaloc_env.authoring.geometry.plan_view_curves import Path

from .auxiliary_lanes import add_extra_lanes
from .curves import cut
from .layout import Laid, along, nearest
from .profiles import cut_profile
from .ramps import Gore, auxiliary_lanes


def road_parts(laid: Laid, numbers: Numbers) -> list[RoadPart]:
    """Roads of the map that make up one road of the plan, by station.

    Raises:
        PlanError: Gores overlap, or lanes do not fit.
    """
    road = laid.road
    if not road.gores:
        if road.closed:
            raise PlanError(f"loop '{road.name}' needs a gore: OpenDRIVE has no roads without ends")
        return [_whole(laid, numbers)]
    if road.extra:
        raise PlanError(f"road '{road.name}' has both gores and extra lanes; split it at a node")
    parts = []
    for k, (before, after, first, last) in enumerate(_spans(laid)):
        path, elevation, tilt = _piece(laid, first, last)
        ends = (
            "plain" if before is not None else road.ends[0],
            "plain" if after is not None else road.ends[1],
        )
        sections = road_sections(road.cross, path.length, ends, road.taper_m, road.stores_m)
        extra = auxiliary_lanes(before, after, road.cross, path.length)
        sections = add_extra_lanes(sections, road.cross, path.length, extra)
        name = f"{road.name} {k + 1}"
        part = RoadPart(numbers.next(ROAD), name, path, elevation, sections, road.speed_kmh)
        part.street, part.kind, part.tilt = road.name, road.kind, tilt
        parts.append(part)
    _place_bridges(laid, parts, numbers)
    return parts


def _whole(laid: Laid, numbers: Numbers) -> RoadPart:
    road, path = laid.road, laid.path
    sections = road_sections(road.cross, path.length, road.ends, road.taper_m, road.stores_m)
    sections = add_extra_lanes(sections, road.cross, path.length, road.extra)
    number = numbers.next(ROAD)
    part = RoadPart(number, road.name, path, laid.elevation, sections, road.speed_kmh)
    part.street, part.kind, part.tilt = road.name, road.kind, laid.tilt
    if road.tunnel is not None:
        name, length = road.tunnel
        part.tunnels.append(StretchPart(numbers.next(OBJECT), name, laid.bottom_m - length / 2, length))
    for name, x, y, length in road.bridges:
        straight = path.pieces[0].kind == "line"
        middle = along(path, x, y) if straight else nearest(path, [(x, y)])[0]
        part.bridges.append(StretchPart(numbers.next(OBJECT), name, middle - length / 2, length))
    return part


def _spans(laid: Laid) -> list[tuple[Gore | None, Gore | None, float, float]]:
    """Gore before, gore after, first and last station along the path of every part."""
    gores, length = laid.road.gores, laid.path.length
    lows = [gore.low_m - laid.first_m for gore in gores]
    highs = [gore.high_m - laid.first_m for gore in gores]
    befores: list[Gore | None] = [None, *gores]
    afters: list[Gore | None] = [*gores, None]
    firsts, lasts = [0.0, *highs], [*lows, length]
    if laid.road.closed:
        befores, firsts = [gores[-1], *gores[:-1]], [highs[-1] - length, *highs[:-1]]
        afters, lasts = [*gores], lows
    spans = list(zip(befores, afters, firsts, lasts, strict=True))
    for _, after, first, last in spans:
        if last - first < 1.0:
            name = laid.road.name if after is None else after.name
            raise PlanError(f"road '{laid.road.name}': no room before '{name}' ({last - first:.1f} m)")
    return spans


def _piece(laid: Laid, first: float, last: float) -> tuple[Path, list[Record], list[Record]]:
    closed, length = laid.road.closed, laid.path.length
    if first < 0.0:
        first, last = first + length, last + length
    path = cut(laid.path, first, last, closed=closed).settled()
    tilt = cut_profile(laid.tilt, first, last, length)
    return path, cut_profile(laid.elevation, first, last, length), tilt


def _place_bridges(laid: Laid, parts: list[RoadPart], numbers: Numbers) -> None:
    for name, x, y, length in laid.road.bridges:

        def distance(part: RoadPart, x: float = x, y: float = y) -> float:
            pose = part.path.at(nearest(part.path, [(x, y)])[0])
            return (pose.x - x) ** 2 + (pose.y - y) ** 2

        part = min(parts, key=distance)
        first = max(nearest(part.path, [(x, y)])[0] - length / 2, 0.0)
        length = min(length, part.length - first)
        part.bridges.append(StretchPart(numbers.next(OBJECT), name, first, length))
