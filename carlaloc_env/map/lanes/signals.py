"""Traffic lights and signs: where they stand, and which lanes must stop where."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.transforms import from_rotation
from carlaloc_env.map.lanes.lanes import SIGN_CODES, SIGN_KINDS, SignalHead, StaticSign
from carlaloc_env.map.opendrive.read_lane_sections import MPS_PER_UNIT
from carlaloc_env.map.opendrive.records import Road, RoadObject, SignalRecord, Validity

if TYPE_CHECKING:
    from carlaloc_env.map.lanes.lane_network import LaneNetwork


@dataclass(frozen=True, slots=True)
class _Effect:
    """Lane and station where a signal acts."""

    lane: int
    station_m: float


def find_signals(network: LaneNetwork) -> tuple[tuple[SignalHead, ...], tuple[StaticSign, ...]]:
    """All traffic lights and all signs of a map, each in file order."""
    references = _references(network)
    controller = {s: c.id for c in network.xodr.controllers for s in c.signal_ids}
    by_controller = {c.id: j.id for j in network.xodr.junctions for c in j.controllers}
    sequence = {(j.id, c.id): c.sequence for j in network.xodr.junctions for c in j.controllers}
    heads, signs = [], []
    for road in network.xodr.roads:
        for signal in road.signals:
            effects = _dedupe([*_effects_of(network, road, signal), *references[signal.id]])
            stops, inside = _stop_lines(network, effects)
            pose = _pose(network, road, signal, stops)
            lanes, stations = tuple(e.lane for e in stops), tuple(e.station_m for e in stops)
            if signal.dynamic:
                group = controller.get(signal.id)
                named = [network.lanes[n].junction_id for n in inside]
                junction = named[0] if named else by_controller.get(group or "")
                heads.append(
                    SignalHead(
                        id=signal.id,
                        name=signal.name,
                        type=signal.type,
                        T_world_signal=pose,
                        width_m=signal.width_m,
                        height_m=signal.height_m,
                        lanes=lanes,
                        stop_station_m=stations,
                        junction_lanes=inside,
                        controller_id=group,
                        junction_id=junction,
                        sequence=sequence.get((junction or "", group or "")),
                        road_id=road.id,
                        s_m=signal.s_m,
                        t_m=signal.t_m,
                    )
                )
            else:
                signs.append(_sign(road, signal, pose, lanes, stations))
        signs.extend(_speed_objects(network, road))
    return tuple(heads), tuple(signs)


def _sign(
    road: Road,
    signal: SignalRecord,
    pose: NDArray[np.float64],
    lanes: tuple[int, ...],
    stations: tuple[float, ...],
) -> StaticSign:
    kind = SIGN_KINDS.get(signal.type, "other")
    speed = None
    if kind == "speed" and signal.value is not None and signal.value > 0.0:
        speed = signal.value * MPS_PER_UNIT.get(signal.unit or "km/h", 1.0 / 3.6)
    return StaticSign(
        id=signal.id,
        kind=kind,
        type=signal.type,
        T_world_sign=pose,
        lanes=lanes,
        stop_station_m=stations,
        speed_mps=speed,
        road_id=road.id,
    )


def _speed_objects(network: LaneNetwork, road: Road) -> Iterable[StaticSign]:
    """RoadRunner writes speed signs as objects named Speed_30, in mph."""
    for item in road.objects:
        match = re.fullmatch(r"[Ss]peed_(\d{1,3})", item.name.split("__")[0])
        if match is not None:
            yield StaticSign(
                id=item.id,
                kind="speed",
                type=SIGN_CODES["speed"],
                T_world_sign=object_pose(network, road, item),
                lanes=(),
                stop_station_m=(),
                speed_mps=float(match[1]) * MPS_PER_UNIT["mph"],
                road_id=road.id,
            )


def object_pose(network: LaneNetwork, road: Road, item: RoadObject) -> NDArray[np.float64]:
    """Pose (4, 4) of an object's own frame: x along its heading, z up."""
    return _stand(network, road, item.s_m, item.t_m, item.z_offset_m, item.heading_rad)


def _references(network: LaneNetwork) -> defaultdict[str, list[_Effect]]:
    effects: defaultdict[str, list[_Effect]] = defaultdict(list)
    for road in network.xodr.roads:
        for ref in road.signal_references:
            effects[ref.id] += _effects(network, road, ref.s_m, ref.orientation, ref.validity)
    return effects


def _effects_of(network: LaneNetwork, road: Road, signal: SignalRecord) -> list[_Effect]:
    here = (0, *(lane_id for lane_id, _ in network.lanes_at(road.id, signal.s_m)))
    if not signal.validity or any(v.holds(lane_id) for v in signal.validity for lane_id in here):
        return _effects(network, road, signal.s_m, signal.orientation, signal.validity)
    # SUMO counts lanes from the right edge and leaves out the sign.
    return _below(network, road, signal)


def _below(network: LaneNetwork, road: Road, signal: SignalRecord) -> list[_Effect]:
    """The lane of a signal's orientation over which it hangs, if there is one."""
    s = np.array([signal.s_m])
    for _, number in network.lanes_at(road.id, signal.s_m):
        lane = network.lanes[number]
        facing = signal.orientation == "none" or (signal.orientation == "+") == lane.forward
        if lane.type == "driving" and facing:
            table, numbers = network.surface.edges, np.array([number])
            edges = [float(table.inner(numbers, s).t_m[0]), float(table.outer(numbers, s).t_m[0])]
            if min(edges) <= signal.t_m <= max(edges):
                return [_Effect(number, network.station_at(number, signal.s_m))]
    return []


def _effects(
    network: LaneNetwork, road: Road, s_m: float, orientation: str, validity: tuple[Validity, ...]
) -> list[_Effect]:
    """Lanes at s that a signal names; without validity, the lanes of its orientation."""
    effects = []
    for lane_id, lane in network.lanes_at(road.id, s_m):
        if network.lanes[lane].type != "driving":
            continue
        if validity:
            named = any(v.holds(lane_id) for v in validity)
        else:
            named = orientation == "none" or (orientation == "+") == network.lanes[lane].forward
        if named:
            effects.append(_Effect(lane, network.station_at(lane, s_m)))
    return effects


def _dedupe(effects: Sequence[_Effect]) -> list[_Effect]:
    return list({e.lane: e for e in reversed(effects)}.values())[::-1]


def _stop_lines(network: LaneNetwork, effects: Sequence[_Effect]) -> tuple[list[_Effect], tuple[int, ...]]:
    """Where cars stop, and the junction lanes that are held closed.

    A signal that acts on a connecting road holds cars at the end of the lanes that lead there.
    """
    stops: list[_Effect] = []
    inside: list[int] = []
    for effect in effects:
        lane = network.lanes[effect.lane]
        if lane.junction_id is None:
            stops.append(effect)
            inside += [n for n in _next_junction_lanes(network, effect.lane) if n not in inside]
        else:
            inside.append(effect.lane)
            for before in lane.predecessors:
                if network.lanes[before].junction_id is None:
                    stops.append(_Effect(before, network.lanes[before].length_m))
    return _dedupe(stops), tuple(dict.fromkeys(inside))


def _next_junction_lanes(network: LaneNetwork, lane: int) -> list[int]:
    """Junction lanes that a lane leads to within its road and the next few sections."""
    frontier = [lane]
    for _ in range(4):
        following = [n for m in frontier for n in network.lanes[m].successors]
        inside = [n for n in following if network.lanes[n].junction_id is not None]
        if inside:
            return inside
        frontier = following
    return []


def _pose(
    network: LaneNetwork, road: Road, signal: SignalRecord, stops: Sequence[_Effect]
) -> NDArray[np.float64]:
    """Pose of a signal.

    RoadRunner's hOffset is the direction the face looks to, the standard's the direction of the
    traffic: so the half turn is taken that lets its own drivers see it.
    """
    T = _stand(network, road, signal.s_m, signal.t_m, signal.z_offset_m, signal.h_offset_rad)
    if stops:
        lane = np.array([e.lane for e in stops])
        station = np.array([e.station_m for e in stops])
        heading = network.tables.pose(lane, station).heading_rad
        looking = T[0, 0] * elementary.cos(heading).sum() + T[1, 0] * elementary.sin(heading).sum()
    elif network.xodr.vendor == "VectorZero":
        # RoadRunner's poles without lanes already look at their drivers.
        looking = 0.0
    else:
        road_number, s = np.array([network.road_index[road.id]]), np.array([signal.s_m])
        heading_s = float(network.surface.heading(road_number, s)[0])
        along = T[0, 0] * elementary.cos(heading_s) + T[1, 0] * elementary.sin(heading_s)
        looking = -along if signal.orientation == "-" else along
    if looking > 0.0:
        T[:3, :2] *= -1.0
    return T


def _stand(
    network: LaneNetwork, road: Road, s_m: float, t_m: float, z_m: float, heading_rad: float
) -> NDArray[np.float64]:
    n, s = np.array([network.road_index[road.id]]), np.array([s_m])
    position = network.surface.position(n, s, np.array([t_m]))[0] + np.array([0.0, 0.0, z_m])
    h = float(network.surface.heading(n, s)[0]) + heading_rad
    c, w = elementary.cos(h), elementary.sin(h)
    return from_rotation(np.array([[c, -w, 0.0], [w, c, 0.0], [0.0, 0.0, 1.0]]), position)
