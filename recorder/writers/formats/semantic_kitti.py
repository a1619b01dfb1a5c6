"""Labels of SemanticKITTI for our semantic tags, moving classes included.

Numbers are those of semantic-kitti-api's ``config/semantic-kitti.yaml`` (Behley et al., "SemanticKITTI:
A Dataset for Semantic Scene Understanding of LiDAR Sequences", ICCV 2019). Falling snow has WADS' number
(Bos et al., "Autonomy at the end of the Earth", 2020), which that file does not name.
"""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.scene.semantic_tags import Tag

_LABEL = {
    Tag.ROAD: 40, Tag.ROAD_LINE: 60, Tag.SIDEWALK: 48, Tag.GROUND: 49, Tag.WATER: 49, Tag.RAIL_TRACK: 49,
    Tag.BUILDING: 50, Tag.WALL: 52, Tag.BRIDGE: 52, Tag.FENCE: 51, Tag.GUARD_RAIL: 51, Tag.POLE: 80,
    Tag.TRAFFIC_SIGN: 81, Tag.TRAFFIC_LIGHT: 99, Tag.VEGETATION: 70, Tag.TERRAIN: 72, Tag.CAR: 10,
    Tag.TRUCK: 18, Tag.BUS: 13, Tag.TRAIN: 16, Tag.MOTORCYCLE: 15, Tag.BICYCLE: 11, Tag.PEDESTRIAN: 30,
    Tag.RIDER: 31, Tag.STATIC: 99, Tag.DYNAMIC: 99, Tag.OTHER: 99, Tag.SNOW: 110,
}  # fmt: skip
_MOVING_LABEL = {
    Tag.CAR: 252, Tag.TRUCK: 258, Tag.BUS: 257, Tag.TRAIN: 256, Tag.MOTORCYCLE: 255, Tag.BICYCLE: 253,
    Tag.RIDER: 253, Tag.PEDESTRIAN: 254,
}  # fmt: skip
"""The benchmark counts riders and what they ride as one moving class."""


def _table(moving: bool) -> NDArray[np.uint32]:
    table = np.zeros(256, np.uint32)
    for tag, label in {**_LABEL, **(_MOVING_LABEL if moving else {})}.items():
        table[tag] = label
    return table


_STILL, _MOVING = _table(False), _table(True)


def semantic_kitti_labels(
    tag: NDArray[np.uint8], instance: NDArray[np.uint32], moving: NDArray[np.uint32]
) -> NDArray[np.uint32]:
    """Labels of points: class in the lower 16 bits, instance in the upper ones, shape (N,).

    Args:
        tag: Semantic `Tag` of each point, shape (N,).
        instance: Instance id of each point, shape (N,); its lower 16 bits are kept.
        moving: Instance ids of all that moves, shape (M,).
    """
    label = np.where(np.isin(instance, moving), _MOVING[tag], _STILL[tag])
    thing = np.isin(tag, np.array(list(_MOVING_LABEL), np.uint8))
    return (label | np.where(thing, (instance & 0xFFFF) << 16, 0)).astype(np.uint32)
