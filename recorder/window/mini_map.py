"""The small map: streets and route round the car, the driving direction up."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.route import Route
from carlaloc_env.timeline.actors import ActorFrame

_PX_PER_M = 1.0
_MARGIN_M = 120.0
_GROUND, _STREET, _JUNCTION, _ROUTE = (34, 40, 46), (120, 128, 136), (140, 148, 156), (70, 160, 255)
_EGO, _OTHER = (255, 225, 60), (225, 225, 225)


class MiniMap:
    """A map of the whole town, drawn once, of which the part about the car is shown.

    Args:
        network: Lanes of the town.
        route: Where to drive.
        size_px: Side of the square that is shown [px].
        reach_m: Distance from the car to its edge [m].
    """

    def __init__(
        self, network: LaneNetwork, route: Route, *, size_px: int = 180, reach_m: float = 90.0
    ) -> None:
        self._size_px, self._zoom = size_px, size_px / (2.0 * reach_m)
        tables = network.tables
        low = tables.position_m[:, :2].min(axis=0) - _MARGIN_M
        high = tables.position_m[:, :2].max(axis=0) + _MARGIN_M
        self._low_m, self._high_m = low, high
        width, height = np.ceil((high - low) * _PX_PER_M).astype(int)
        self._map = np.full((height, width, 3), _GROUND, np.uint8)
        for junctions in (False, True):
            for lane in network.lanes:
                if lane.type != "driving" or (lane.junction_id is not None) != junctions:
                    continue
                line = tables.position_m[tables.first[lane.index] :][: tables.count[lane.index], :2]
                self._line(line, _JUNCTION if junctions else _STREET, 3)
        s = np.arange(0.0, route.length_m, 2.0)
        self._line(route.at(s).position_m[:, :2], _ROUTE, 2)

    def image(
        self, position_m: NDArray[np.float64], heading_rad: float, actors: ActorFrame
    ) -> NDArray[np.uint8]:
        """The part about the car, sRGB (S, S, 3), with the car in the middle, heading up."""
        size, zoom = self._size_px, self._zoom
        centre = self._pixels(position_m[None, :2])[0]
        c, s = math.cos(heading_rad - math.pi / 2), math.sin(heading_rad - math.pi / 2)
        # Map pixels have y down: a turn by +angle of the world is one by −angle of the image.
        turn = np.array([[c, -s], [s, c]]) * zoom / _PX_PER_M
        shift = np.array([size / 2, size * 0.62]) - turn @ centre
        view = cv2.warpAffine(
            self._map, np.column_stack([turn, shift]), (size, size), borderValue=_GROUND, flags=cv2.INTER_AREA
        )
        dots = self._pixels(actors.position_m[:, :2].astype(np.float64)) @ turn.T + shift
        for x, y in dots[((dots > 2) & (dots < size - 2)).all(axis=1)].round().astype(int):
            cv2.circle(view, (int(x), int(y)), 2, _OTHER, -1)
        x, y = size // 2, round(size * 0.62)
        arrow = np.array([[x, y - 8], [x + 6, y + 6], [x, y + 3], [x - 6, y + 6]], np.int32)
        cv2.fillPoly(view, [arrow], _EGO, cv2.LINE_AA)
        return np.asarray(view, np.uint8)

    def _pixels(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        x = (points_m[:, 0] - self._low_m[0]) * _PX_PER_M
        y = (self._high_m[1] - points_m[:, 1]) * _PX_PER_M
        return np.stack([x, y], axis=-1)

    def _line(self, points_m: NDArray[np.float64], colour: tuple[int, int, int], width: int) -> None:
        points = (self._pixels(points_m) * 8.0).round().astype(np.int32)
        cv2.polylines(self._map, [points[:, None]], False, colour, width, cv2.LINE_AA, shift=3)
