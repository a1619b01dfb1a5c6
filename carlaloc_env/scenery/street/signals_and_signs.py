"""Traffic lights and signs of the map, standing where it says and facing whom it says."""

import numpy as np

from carlaloc_env.assets.signs import sign
from carlaloc_env.assets.traffic_lights import traffic_light
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import apply
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import SignalHead, StaticSign
from carlaloc_env.map.opendrive.read_lane_sections import MPS_PER_UNIT
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.scenery.ground.height_fields import HeightOf
from carlaloc_env.scenery.meshing.props import InstanceIds, copies, poses

SHORTEST_ARM_M, LONGEST_ARM_M = 3.5, 11.0
"""Mast arms that are built; nearer lanes are served from the post [m]."""
_POST_ROOM_M, _FARTHEST_POST_M = 0.5, 16.0


def add_signals(
    network: LaneNetwork, floor: HeightOf, ids: InstanceIds
) -> tuple[list[Mesh], SignalLenses, Array]:
    """Meshes of all traffic lights, their lenses, and the base points of their posts [m] (S, 3)."""
    meshes: list[Mesh] = []
    lens_poses, signal, state, instance = [], [], [], []
    bases_m = np.zeros((len(network.signals), 3))
    for number, head in enumerate(network.signals):
        place = _beside_lanes(network, head)
        bases_m[number] = (*place, floor(place[None])[0])
        yaw = elementary.arctan2(head.T_world_signal[1, 0], head.T_world_signal[0, 0])
        T = poses(bases_m[number], yaw)
        arm, heads = _arm(network, head, T[0])
        mesh, lenses = traffic_light(heads, arm)
        head_id = ids.take()
        meshes.append(copies(mesh, T, head_id))
        for k in range(lenses.shape[0]):
            for lens in range(lenses.shape[1]):
                lens_poses.append(_product(T[0], lenses[k, lens]))
                signal.append(number)
                state.append(lens + 1)
                instance.append(head_id)
    signal_lenses = SignalLenses(
        signal=np.array(signal, dtype=np.int32),
        state=np.array(state, dtype=np.uint8),
        T_world_lens=np.array(lens_poses, dtype=np.float64).reshape(-1, 4, 4),
        instance=np.array(instance, dtype=np.uint32),
    )
    return meshes, signal_lenses, bases_m


def add_signs(network: LaneNetwork, floor: HeightOf, ids: InstanceIds) -> tuple[list[Mesh], Array]:
    """Meshes of all signs, and the base points of their posts [m] (K, 3)."""
    meshes: list[Mesh] = []
    bases_m = []
    for item in network.static_signs:
        kind = _kind(item)
        if kind is None:
            continue
        position = item.T_world_sign[:3, 3]
        base_m = np.array([*position[:2], floor(position[None, :2])[0]])
        yaw = elementary.arctan2(item.T_world_sign[1, 0], item.T_world_sign[0, 0])
        meshes.append(copies(sign(*kind), poses(base_m, yaw), ids.take()))
        bases_m.append(base_m)
    return meshes, np.array(bases_m).reshape(-1, 3)


def _beside_lanes(network: LaneNetwork, head: SignalHead) -> Array:
    """Where a light's post stands (2,): where the map says, or beside the lanes if it hangs over one."""
    place: Array = head.T_world_signal[:2, 3]
    near = network.nearest(place[None])
    if not head.lanes or near.distance_m[0] > 0.5 * network.width_m(near.lane, near.station_m)[0]:
        return place
    pose = network.pose(np.array(head.lanes[:1]), np.array(head.stop_station_m[:1]))
    left = np.array([-elementary.sin(pose.heading_rad[0]), elementary.cos(pose.heading_rad[0])])
    kerb = network.lanes[head.lanes[0]].kerb_side * left
    away = np.arange(0.0, _FARTHEST_POST_M, 0.25)
    for side in (kerb, -kerb):
        places: Array = place + away[:, None] * side
        near = network.nearest(places)
        free = near.distance_m > 0.5 * network.width_m(near.lane, near.station_m) + _POST_ROOM_M
        if free.any():
            base_m: Array = places[int(np.argmax(free))]
            return base_m
    return place


def _arm(network: LaneNetwork, head: SignalHead, T: Array) -> tuple[float, int]:
    """Length of the mast arm [m], as `traffic_light` takes it, and number of heads, from its lanes."""
    if not head.lanes:
        return 0.0, 1
    stops = network.pose(np.array(head.lanes), np.array(head.stop_station_m)).position_m
    # The arm reaches from the kerb over the road; the lanes' distance there is what it must span.
    kerb_side = network.lanes[head.lanes[0]].kerb_side
    reach = float(np.max(np.sum((stops - T[:3, 3]) * (kerb_side * T[:3, 1]), axis=1)))
    if reach < SHORTEST_ARM_M or len(head.lanes) < 2:
        return 0.0, 1
    return -kerb_side * min(reach + 0.3, LONGEST_ARM_M), min(len(head.lanes), 2) + 1


def _kind(item: StaticSign) -> tuple[str, str | None] | None:
    if item.kind in ("stop", "yield"):
        return item.kind, None
    if item.kind == "speed" and item.speed_mps is not None:
        mph = item.speed_mps / MPS_PER_UNIT["mph"]
        whole = abs(mph - 5 * round(mph / 5)) < 0.01
        return "speed", str(round(mph if whole else item.speed_mps * 3.6))
    return None


def _product(A: Array, B: Array) -> Array:
    """A·B of rigid transforms, written out without BLAS."""
    T = np.eye(4)
    T[:3, 3] = apply(A, B[:3, 3])
    T[:3, :3] = (apply(A, B[:3, :3].T) - A[:3, 3]).T
    return T
