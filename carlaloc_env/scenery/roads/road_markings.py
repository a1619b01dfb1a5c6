"""Painted lines: road marks as thin geometry just above the road."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.map.opendrive.records import Road, RoadMark
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder

PAINT_M = 0.005
"""Height of paint above the road [m]."""
LINE_M = 0.13
"""Width of a line where the map does not say [m]."""
DOUBLE_GAP_M = 0.12
"""Clear distance between the two lines of a double mark [m]."""
KERB_LINE_M = 0.08
"""Distance of edge lines from kerbs [m]."""
LOOSE_LINE_M = 0.04
"""Distance of edge lines from unpaved shoulders [m]."""
NEAR_END_M = 9.0
"""Stop lines and crosswalks this near to a road's end belong to the junction there [m]."""
DASHES: dict[str, tuple[float, float]] = {
    "default": (3.0, 6.0),
    "motorway": (3.05, 9.15),
    "dotted": (0.9, 1.5),
}
"""Length and gap of dashes [m] where the map does not say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One painted line beside a lane edge."""

    offset_m: float
    """Its middle to the left of the edge [m]."""
    width_m: float
    """Its width [m]."""
    dash_m: float
    """Length of dashes [m]; 0 for a solid line."""
    gap_m: float
    """Gap between dashes [m]."""


def add_markings(out: MeshBuilder, strips: Sequence[Strip], roads: Sequence[Road]) -> None:
    """Road marks of all strips outside junctions."""
    for strip in strips:
        if strip.junction_id is None:
            _strip_marks(out, strip, roads[strip.road])


def mark_lines(mark: RoadMark, road_type: str, side: int) -> tuple[Line, ...]:
    """Painted lines of a road mark; `side` is +1 for lanes left of the centre line."""
    if mark.type in ("none", "curb", "edge", "grass", "custom") and not mark.lines:
        return ()
    default = LINE_M * (2.0 if mark.weight == "bold" else 1.0)
    width = mark.width_m if mark.width_m is not None and mark.width_m > 0.0 else default
    if mark.lines:
        return tuple(
            Line(
                offset_m=line.t_offset_m,
                width_m=line.width_m or width,
                dash_m=line.length_m if line.space_m > 0.0 else 0.0,
                gap_m=line.space_m,
            )
            for line in mark.lines
        )
    dash, gap = DASHES["motorway" if road_type == "motorway" else "default"]
    if mark.type == "botts dots":
        dash, gap = DASHES["dotted"]
    parts = mark.type.split()
    if len(parts) == 1:
        solid = mark.type == "solid"
        return (Line(offset_m=0.0, width_m=width, dash_m=0.0 if solid else dash, gap_m=gap),)
    # Doubles name the line nearer to the reference line first.
    away = (width + DOUBLE_GAP_M) / 2 * (-side if side else 1)
    return tuple(
        Line(offset_m=shift, width_m=width, dash_m=0.0 if part == "solid" else dash, gap_m=gap)
        for part, shift in zip(parts, (away, -away), strict=False)
    )


def crossing_spans(road: Road) -> list[tuple[float, float]]:
    """Stations [m] that lines leave to crosswalks: these, and from the stop line to the road's end."""
    spans = []
    for item in road.objects:
        crosswalk, stop = item.type == "crosswalk", "StopLine" in item.name
        if not (crosswalk or stop):
            continue
        half = max(item.length_m / 2, 0.1) + (0.15 if crosswalk else 0.0)
        low, high = item.s_m - half, item.s_m + half
        if high > road.length_m - NEAR_END_M:
            high = road.length_m + 1.0
        if low < NEAR_END_M:
            low = -1.0
        if crosswalk or high - low > 3 * half:
            spans.append((low, high))
    return spans


def _outside(span: tuple[float, float], holes: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Parts of a span that lie in no hole."""
    parts = [span]
    for low, high in holes:
        parts = [
            piece
            for a, b in parts
            for piece in ((a, min(b, low)), (max(a, high), b))
            if piece[1] - piece[0] > 1e-6
        ]
    return parts


def _strip_marks(out: MeshBuilder, strip: Strip, road: Road) -> None:
    section = road.sections[strip.section]
    crossings = crossing_spans(road)
    left_count = sum(1 for lane in strip.lanes if lane.id > 0)
    for lane in section.lanes:
        if lane.id > 0:
            edge, side = [own.id for own in strip.lanes].index(lane.id), 1
        elif lane.id < 0:
            edge, side = [own.id for own in strip.lanes].index(lane.id) + 1, -1
        else:
            edge, side = left_count, 0
        for index, mark in enumerate(lane.road_marks):
            start = strip.s_m[0] + mark.s_offset_m
            after = lane.road_marks[index + 1].s_offset_m if index + 1 < len(lane.road_marks) else np.inf
            end = min(strip.s_m[-1], strip.s_m[0] + after)
            for line in mark_lines(mark, road.type, side):
                for span in _outside((start, end), crossings):
                    _paint(out, strip, edge, line, span, mark.colour)


def _paint(
    out: MeshBuilder, strip: Strip, edge: int, line: Line, span: tuple[float, float], colour: str
) -> None:
    start, end = span
    if end - start < 0.05 or not _flat(strip, edge):
        return
    shift = line.offset_m + _away_from_kerb(strip, edge, line.width_m)
    if line.dash_m > 0.0:
        begin = np.arange(start, end - 0.3, line.dash_m + line.gap_m)
        pieces = [(s, min(s + line.dash_m, end)) for s in begin]
    else:
        pieces = [(start, end)]
    if not pieces:
        return
    yellow = colour == "yellow"
    material = Material.ROAD_PAINT_YELLOW if yellow else Material.ROAD_PAINT_WHITE
    stations = []
    for low, high in pieces:
        inner = strip.s_m[(strip.s_m > low + 1e-3) & (strip.s_m < high - 1e-3)]
        stations.append(np.concatenate([[low], inner, [high]]))
    half = line.width_m / 2
    # All dashes at once: one look at the road's table costs as much as a hundred points.
    at = np.concatenate(stations)
    both = [beside(strip, edge, at, shift + side) for side in (-half, half)]
    points = np.stack(both, axis=1)
    points[..., 2] += PAINT_M
    uv = np.stack(np.broadcast_arrays(np.array([0.0, line.width_m])[None], at[:, None]), axis=-1)
    end_row = 0
    for s in stations:
        rows = slice(end_row, end_row := end_row + len(s))
        out.grid(points[rows], material=material, tag=Tag.ROAD_LINE, uv_m=uv[rows])


def _flat(strip: Strip, edge: int) -> bool:
    """Whether the edge touches a paved roadway on at least one side."""
    return any(_paintable(strip, lane) for lane in (edge - 1, edge))


def _paintable(strip: Strip, lane: int) -> bool:
    inside = 0 <= lane < len(strip.lanes)
    return inside and strip.kind(lane) == "roadway" and not strip.unpaved(lane)


def _away_from_kerb(strip: Strip, edge: int, width_m: float) -> float:
    """How far a line moves to the left so that it lies beside a kerb, or on what is paved [m]."""
    paved = [_paintable(strip, lane) for lane in (edge - 1, edge)]
    loose = [0 <= lane < len(strip.lanes) and bool(strip.unpaved(lane)) for lane in (edge - 1, edge)]
    if loose[0] and paved[1]:
        return -(width_m / 2 + LOOSE_LINE_M)
    if loose[1] and paved[0]:
        return width_m / 2 + LOOSE_LINE_M
    kinds = [strip.kind(lane) if 0 <= lane < len(strip.lanes) else "none" for lane in (edge - 1, edge)]
    if kinds[0] in ("sidewalk", "median") and kinds[1] == "roadway":
        return -(width_m / 2 + KERB_LINE_M)
    if kinds[1] in ("sidewalk", "median") and kinds[0] == "roadway":
        return width_m / 2 + KERB_LINE_M
    return 0.0


def beside(strip: Strip, edge: int, s: Array, offset_m: Array | float) -> Array:
    """Points (K, 3) on the triangles of the road, `offset_m` [m] to the left of a lane edge."""
    lines = np.stack([interpolated(s, strip.s_m, row) for row in strip.edges_m])
    across = (lines[0] - lines[-1])[:, :2]
    left = across / np.maximum(np.sqrt(np.sum(across**2, axis=1, keepdims=True)), 1e-6)
    offset = np.broadcast_to(np.asarray(offset_m, dtype=np.float64), s.shape)
    # Lanes lean each by itself: the height is that between the two edges on whose sides a point lies.
    aside = np.sum((lines - lines[edge])[..., :2] * left, axis=-1)
    lane, row = np.sum(aside[1:-1] > offset, axis=0), np.arange(len(s))
    start, end = aside[lane, row], aside[lane + 1, row]
    share = np.clip((start - offset) / np.maximum(start - end, 1e-6), 0.0, 1.0)
    z = lines[..., 2]
    height = z[lane, row] + share * (z[lane + 1, row] - z[lane, row])
    return np.column_stack([lines[edge, :, :2] + left * offset[:, None], height])
