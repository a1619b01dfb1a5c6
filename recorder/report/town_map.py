"""Marks lanes, route, spawn points and lights on a view of a town from above, with a legend and a scale."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import apply, invert
from carlaloc_env.town.town import Town
from recorder.report.lane_lines import lane_lines

Point = tuple[int, int]
Rgb = tuple[int, int, int]

LANE: Rgb = (60, 210, 255)
ROUTE: Rgb = (255, 120, 20)
SPAWN: Rgb = (60, 230, 90)
SIGNAL: Rgb = (255, 40, 60)
LAMP: Rgb = (255, 236, 150)
STRIP_PX = 64
"""Height of the strip below the map [px]."""
_BAR_M = (1, 2, 5, 10, 20, 50, 100, 200, 500)
_BAR_ROOM_PX = 140
"""Width that stays free for the scale [px]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapView:
    """A camera that looks down on a town."""

    camera: Pinhole
    T_world_camera: Array

    def pixels(self, points_m: Array) -> tuple[list[Point], NDArray[np.bool_]]:
        """Pixels of world points (N, 3), and whether each lies in the image, shape (N,)."""
        uv = np.rint(self.camera.project(apply(invert(self.T_world_camera), points_m))).astype(int)
        inside = (uv[:, 0] >= 0) & (uv[:, 0] < self.camera.width_px)
        inside &= (uv[:, 1] >= 0) & (uv[:, 1] < self.camera.height_px)
        return [(int(u), int(v)) for u, v in uv], inside

    def px_per_m(self, z_m: float) -> float:
        """Scale at a height [px/m]."""
        return float(self.camera.fx_px / (self.T_world_camera[2, 3] - z_m))


def draw_map(town: Town, view: MapView, image: U8, spawn_m: Array) -> U8:
    """The view from above with everything marked and a legend below it, sRGB, shape (H + STRIP_PX, W, 3).

    Args:
        town: The town.
        view: The camera of the image.
        image: The town seen by it.
        spawn_m: Places where vehicles start [m], shape (K, 3).
    """
    plan = (0.80 * image).astype(np.uint8)
    for line in lane_lines(town.network):
        _line(plan, view, line, LANE, 1)
    _dots(plan, view, spawn_m, SPAWN, 2)
    _dots(plan, view, town.outline.lamps_m, LAMP, 1)
    if town.route is not None:
        line = town.route.position_m
        line = np.concatenate([line, line[:1]]) if town.route.closed else line
        _line(plan, view, line, (0, 0, 0), 6)
        _line(plan, view, line, ROUTE, 3)
        ends = view.pixels(town.route.position_m[[0, -1]])[0]
        cv2.circle(plan, ends[0], 9, (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(plan, ends[0], 6, ROUTE, -1, cv2.LINE_AA)
        if not town.route.closed:
            cv2.drawMarker(plan, ends[1], (255, 255, 255), cv2.MARKER_TILTED_CROSS, 18, 5, cv2.LINE_AA)
            cv2.drawMarker(plan, ends[1], ROUTE, cv2.MARKER_TILTED_CROSS, 16, 2, cv2.LINE_AA)
    _dots(plan, view, np.asarray(town.outline.lenses.T_world_lens[:, :3, 3]), SIGNAL, 4)
    px_per_m = view.px_per_m(float(np.median(town.network.tables.position_m[:, 2])))
    return np.vstack([plan, _strip(town, len(spawn_m), plan.shape[1], px_per_m)])


def _line(plan: U8, view: MapView, points_m: Array, colour: Rgb, width_px: int) -> None:
    corners = np.array(view.pixels(points_m)[0], dtype=np.int32)
    cv2.polylines(plan, [corners], False, colour, width_px, cv2.LINE_AA)


def _dots(plan: U8, view: MapView, points_m: Array, colour: Rgb, radius_px: int) -> None:
    if not len(points_m):
        return
    pixels, inside = view.pixels(points_m)
    for k in np.flatnonzero(inside):
        cv2.circle(plan, pixels[k], radius_px, colour, -1, cv2.LINE_AA)


def _strip(town: Town, spawn_points: int, width_px: int, px_per_m: float) -> U8:
    """Name, scale and the meaning of the colours, in a strip below the map."""
    strip = np.full((STRIP_PX, width_px, 3), 24, np.uint8)
    font, base = cv2.FONT_HERSHEY_SIMPLEX, STRIP_PX // 2 + 7
    length = "no route" if town.route is None else f"route {town.route.length_m:.0f} m"
    signals = len(np.unique(town.outline.lenses.signal))
    rows: tuple[tuple[str, Rgb], ...] = (
        (length, ROUTE),
        ("driving lanes", LANE),
        (f"{spawn_points} spawn points", SPAWN),
        (f"{signals} traffic lights", SIGNAL),
        (f"{len(town.outline.lamps_m)} street lamps", LAMP),
    )
    widths_px = [40 + cv2.getTextSize(text, font, 0.58, 1)[0][0] for text, _ in rows]
    name = town.name
    while cv2.getTextSize(name, font, 1.0, 2)[0][0] > width_px - sum(widths_px) - 40 - _BAR_ROOM_PX:
        name = name[:-1]
    cv2.putText(strip, name, (16, base + 3), font, 1.0, (255, 255, 255), 2, cv2.LINE_AA)
    x = 40 + cv2.getTextSize(name, font, 1.0, 2)[0][0]
    for (text, colour), own_px in zip(rows, widths_px, strict=True):
        cv2.circle(strip, (x, base - 6), 7, colour, -1, cv2.LINE_AA)
        cv2.putText(strip, text, (x + 16, base), font, 0.58, (255, 255, 255), 1, cv2.LINE_AA)
        x += own_px
    bar_m = max((m for m in _BAR_M if m * px_per_m < width_px - x - 60), default=_BAR_M[0])
    end = width_px - 24
    begin = end - round(bar_m * px_per_m)
    cv2.line(strip, (begin, base + 8), (end, base + 8), (255, 255, 255), 3, cv2.LINE_AA)
    cv2.putText(strip, f"{bar_m} m", (begin, base - 4), font, 0.55, (255, 255, 255), 1, cv2.LINE_AA)
    if "OpenStreetMap" in town.config.description:
        words = "(c) OpenStreetMap contributors"
        cv2.putText(strip, words, (16, STRIP_PX - 5), font, 0.42, (200, 200, 200), 1, cv2.LINE_AA)
    return strip
