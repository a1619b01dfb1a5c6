"""What agents see: the state vector, the bird's-eye view, or the sensors of a rig.

The bird's-eye view: roads, lanes, route, road users and lights from above, the car's heading upwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.envs.base_env import Observer
from carlaloc_env.envs.task.state_vector import StateVector, state_space
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.rigs.presets import RIGS, rig_by_name
from carlaloc_env.rigs.rig import SensorRig, check_memory
from carlaloc_env.samples import Sample
from carlaloc_env.scene.materials import Tag
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.signals import SignalState

SIZE_PX = 96
"""Rows and columns."""
PX_M = 0.5
"""Side of a pixel [m]."""
AHEAD_M = 36.0
"""How far the picture reaches ahead of `base_link` [m]; the rest of its 48 m lies behind."""
CHANNELS = ("road", "lanes", "route", "actors", "lights")
"""What each channel shows."""
VEHICLE, WALKER = 255, 128
"""Values of road users."""
LIGHTS = {SignalState.RED: 255, SignalState.YELLOW: 170, SignalState.GREEN: 85}
"""Values of stop lines by what their light shows."""
_SUBPIXEL_BITS = 4
"""Corners are given to a sixteenth of a pixel."""
_STRIP_ROWS = 8
"""Rows of the half-metre tables of lanes between the ends of one piece."""
_STOREY_M = 4.0
"""What lies so far above or below is on another road [m]."""
_REACH_M = AHEAD_M * 1.42 + 8.0
"""Pieces whose middle is farther away cannot show [m]."""
_STOP_LINE_M = 3.5
"""Length of a stop line across the route [m]."""


def birds_eye_space() -> spaces.Box:
    """Space of the picture, (rows, columns, channels)."""
    return spaces.Box(0, 255, (SIZE_PX, SIZE_PX, len(CHANNELS)), np.uint8)


class BirdsEyeView:
    """Draws what lies round the car in one town."""

    def __init__(self, network: LaneNetwork) -> None:
        """Cut the driving lanes into pieces of four metres."""
        self._corners_m, self._middle_m = _pieces(network)

    def draw(self, world: TaskWorld) -> NDArray[np.uint8]:
        """The picture now, uint8, shape (96, 96, 5); channels are named in `CHANNELS`."""
        state = world.state
        place = _Place(state.position_m, state.heading_rad)
        out = np.zeros((len(CHANNELS), SIZE_PX, SIZE_PX), np.uint8)
        near = place.near(self._middle_m)
        corners = _touching(place.pixels(self._corners_m[near]))
        _fill(out[0], corners, 255)
        for side in (corners[:, :2], corners[:, 2:]):
            _line(out[1], side, 1)
        self._route(world, place, out[2])
        self._actors(world, place, out[3])
        self._lights(world, place, out[4])
        return np.ascontiguousarray(np.moveaxis(out, 0, -1))

    def _route(self, world: TaskWorld, place: _Place, out: NDArray[np.uint8]) -> None:
        route = world.route
        rows = np.arange(0, int(_REACH_M / route.step_m), 4) + route.row_at(world.route_s_m)
        rows = rows % len(route.position_m) if route.closed else rows[rows < len(route.position_m)]
        if len(rows) > 1:
            _line(out, place.pixels(route.position_m[None, rows, :2]), round(2.0 / PX_M))

    def _actors(self, world: TaskWorld, place: _Place, out: NDArray[np.uint8]) -> None:
        frame, catalog = world.actors(), world.timeline.catalog
        near = place.near(frame.position_m.astype(np.float64))
        if not len(near):
            return
        c, s = np.cos(frame.heading_rad[near]), np.sin(frame.heading_rad[near])
        half = 0.5 * catalog.size_m[near, :2]
        along = np.stack([c, s], axis=-1) * half[:, :1]
        across = np.stack([-s, c], axis=-1) * half[:, 1:]
        centre = frame.position_m[near, :2]
        boxes = np.stack([centre + a * along + b * across for a, b in _BOX], axis=1)
        on_foot = catalog.tag[near] == Tag.PEDESTRIAN
        for which, value in ((on_foot, WALKER), (~on_foot, VEHICLE)):
            _fill(out, _touching(place.pixels(boxes[which])), value)

    def _lights(self, world: TaskWorld, place: _Place, out: NDArray[np.uint8]) -> None:
        lines, route = world.stop_lines, world.route
        if not len(lines.s_m):
            return
        rows = np.array([route.row_at(s) for s in lines.s_m.tolist()])
        signals = world.signals()
        for number in place.near(route.position_m[rows]).tolist():
            shown = SignalState(int(signals[lines.heads[number]].max()))
            heading = float(route.heading_rad[rows[number]])
            across = 0.5 * _STOP_LINE_M * np.array([-np.sin(heading), np.cos(heading)])
            middle = route.position_m[rows[number], :2]
            ends = place.pixels(np.array([[middle - across, middle + across]]))
            _line(out, ends, 2, LIGHTS.get(shown, 0))


_BOX = ((1, 1), (1, -1), (-1, -1), (-1, 1))
"""Corners of a box: signs of its length and its width."""


class _Place:
    """Where the picture is taken."""

    def __init__(self, position_m: Array, heading_rad: float) -> None:
        self._position_m = position_m
        self._cos, self._sin = float(np.cos(heading_rad)), float(np.sin(heading_rad))

    def near(self, points_m: Array) -> NDArray[np.intp]:
        """Which of some points (N, 3) can show."""
        away = np.abs(points_m - self._position_m)
        return np.flatnonzero((away[:, 0] < _REACH_M) & (away[:, 1] < _REACH_M) & (away[:, 2] < _STOREY_M))

    def pixels(self, points_m: Array) -> NDArray[np.int32]:
        """Columns and rows of world points (…, 2) in sixteenths of a pixel."""
        dx, dy = points_m[..., 0] - self._position_m[0], points_m[..., 1] - self._position_m[1]
        ahead, left = self._cos * dx + self._sin * dy, self._cos * dy - self._sin * dx
        column, row = 0.5 * SIZE_PX - left / PX_M, (AHEAD_M - ahead) / PX_M
        # Pixel (0, 0) covers 0…1: its centre, which OpenCV counts from, lies at a half.
        scaled = (np.stack([column, row], axis=-1) - 0.5) * (1 << _SUBPIXEL_BITS)
        return np.rint(scaled).astype(np.int32)


def _touching(polygons: NDArray[np.int32]) -> NDArray[np.int32]:
    """Those polygons (N, corners, 2) that lie in the picture, or within two pixels of it."""
    margin, size = 2 << _SUBPIXEL_BITS, SIZE_PX << _SUBPIXEL_BITS
    touches = (polygons.max(axis=1) > -margin) & (polygons.min(axis=1) < size + margin)
    return polygons[touches.all(axis=1)]


def _fill(out: NDArray[np.uint8], polygons: NDArray[np.int32], value: int) -> None:
    """Fill polygons, shape (N, corners, 2); one by one, since `cv2.fillPoly` leaves out what two share."""
    for polygon in polygons:
        cv2.fillConvexPoly(out, polygon, value, shift=_SUBPIXEL_BITS)


def _line(out: NDArray[np.uint8], lines: NDArray[np.int32], width_px: int, value: int = 255) -> None:
    """Draw lines, shape (N, points, 2)."""
    cv2.polylines(out, list(lines), False, value, width_px, shift=_SUBPIXEL_BITS)


def _pieces(network: LaneNetwork) -> tuple[Array, Array]:
    """Corners (N, 4, 2) [m], two on the left and two on the right side, and middles (N, 3) [m] of lanes."""
    tables = network.tables
    begins, ends = [], []
    for lane in network.lanes:
        if lane.type == "driving":
            first = int(tables.first[lane.index])
            rows = np.arange(first, first + int(tables.count[lane.index]))
            cuts = np.append(rows[:-1:_STRIP_ROWS], rows[-1])
            begins.append(cuts[:-1])
            ends.append(cuts[1:])
    begin, end = np.concatenate(begins), np.concatenate(ends)
    left = np.stack([-tables.tangent[:, 1], tables.tangent[:, 0]], axis=1) * (0.5 * tables.width_m[:, None])
    at = tables.position_m[:, :2]
    on_left, on_right = at + left, at - left
    corners = np.stack([on_left[begin], on_left[end], on_right[end], on_right[begin]], 1)
    return corners, 0.5 * (tables.position_m[begin] + tables.position_m[end])


AGENT_RIGS = ("state", "bev")
"""What agents see without sensors: the state vector, and the bird's-eye view with it."""


class AgentView(Protocol):
    """What an agent sees of a drive."""

    space: spaces.Space[Any]
    """Space of the observations."""
    samples: list[Sample]
    """Samples of sensors in the last step."""

    def reset(self, world: TaskWorld) -> Any:
        """The first observation of a drive."""

    def follow(self, world: TaskWorld) -> None:
        """Take note of a step of 50 ms; called for every step, also for those without an observation."""

    def observe(self, world: TaskWorld, standing_s: float) -> Any:
        """The observation now."""


class StateView:
    """The state vector alone (`rig="state"`), or with the bird's-eye view (`rig="bev"`)."""

    def __init__(self, world: TaskWorld, *, from_above: bool) -> None:
        self.samples: list[Sample] = []
        self._above = BirdsEyeView(world.town.network) if from_above else None
        self.space: spaces.Space[Any] = state_space()
        if from_above:
            self.space = spaces.Dict({"state": state_space(), "bev": birds_eye_space()})
        self._state: StateVector | None = None

    def reset(self, world: TaskWorld) -> Any:
        """The first observation of a drive."""
        self._state = StateVector(world)
        return self.observe(world, 0.0)

    def follow(self, world: TaskWorld) -> None:
        """Take note of a step of 50 ms."""
        assert self._state is not None
        self._state.follow()

    def observe(self, world: TaskWorld, standing_s: float) -> Any:
        """The observation now."""
        assert self._state is not None
        state = self._state.observe(standing_s)
        return state if self._above is None else {"state": state, "bev": self._above.draw(world)}


class SensorView:
    """The newest samples of a rig's sensors."""

    def __init__(self, rig: SensorRig, stage: SensorStage) -> None:
        self.samples: list[Sample] = []
        self._config, self._stage = rig, stage
        self._rig = rig.build(stage)
        self._observer = Observer(self._rig)
        self.space: spaces.Space[Any] = self._observer.space
        self._before_ns = -1

    def reset(self, world: TaskWorld) -> Any:
        """The first observation of a drive."""
        self._rig = self._config.build(self._stage)
        self._observer.reset()
        self._before_ns = -1
        self.follow(world)
        return self.observe(world, 0.0)

    def follow(self, world: TaskWorld) -> None:
        """Take note of a step of 50 ms: measure it."""
        self.samples = self._rig.measure(world.timeline, self._before_ns, world.now_ns)
        self._observer.add(self.samples)
        self._before_ns = world.now_ns

    def observe(self, world: TaskWorld, standing_s: float) -> Any:
        """The observation now."""
        return self._observer.newest()


def rig_of(rig: str | Path | SensorRig | Mapping[str, Any], quality: str) -> str | SensorRig:
    """What a rig means: `state` and `bev` as they are; a rig's name, its YAML file or plain data as a rig.

    Raises:
        ConfigError: there is no such rig, or its pictures of a quality need more memory than there is.
    """
    if isinstance(rig, str) and rig in AGENT_RIGS:
        return rig
    if isinstance(rig, Mapping):
        rig = SensorRig.from_mapping(rig, bases=RIGS)
    elif not isinstance(rig, SensorRig):
        known = {*RIGS, *AGENT_RIGS}
        if str(rig) not in known and Path(rig).suffix not in (".yaml", ".yml"):
            raise ConfigError(unknown_name("rig", str(rig), known) + ", or a .yaml file")
        rig = rig_by_name(rig)
    check_memory(rig, quality=quality)
    return rig


def agent_view(rig: str | SensorRig, world: TaskWorld, stage: SensorStage) -> AgentView:
    """What an agent sees with a rig, as `rig_of` gives it."""
    if isinstance(rig, SensorRig):
        return SensorView(rig, stage)
    return StateView(world, from_above=rig == "bev")
