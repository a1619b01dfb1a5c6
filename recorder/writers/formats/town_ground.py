"""A town as perception datasets hold it: a mask of its roads and walks, and boxes of its parked cars."""

from dataclasses import dataclass

import cv2
import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.outline import TownOutline
from carlaloc_env.town.town import Town

PIXEL_M = 0.1
"""Size of a pixel of the mask [m], the only one that nuScenes' devkit reads."""
MARGIN_M, SIDE_MAX_M = 50.0, 3000.0
"""Room around all lanes, and the longest side of a mask [m]; of larger maps, a square about the origin."""
_UNPAVED = ("none", "median", "border", "restricted", "rail", "tram")
"""Types of lanes that are no part of the mask."""
_TRIANGLES = 10
"""Triangles of a parked car's box, which has no bottom."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TownGround:
    """Fixed things on the ground of a town."""

    name: str
    """Name of the town."""
    origin_m: Array
    """Lower left corner of the mask in the world, whole metres, shape (2,)."""
    mask: U8
    """255 where lanes and sidewalks lie, else 0; the first row is the northernmost, shape (H, W)."""
    parked_centre_m: Array
    """Middles of parked cars in the world [m], shape (P, 3)."""
    parked_heading_rad: Array
    """Directions that they face, anticlockwise from east [rad], shape (P,)."""
    parked_size_m: Array
    """Length, width, height [m], shape (P, 3)."""


def ground_of(town: Town, *, parked_cars: bool) -> TownGround:
    """Mask and parked cars of a town.

    Args:
        town: The town.
        parked_cars: Whether cars are parked there.
    """
    origin_m, mask = lane_mask(town.network)
    boxes = parked_boxes(town.outline)
    kept = slice(None) if parked_cars else slice(0)
    return TownGround(
        name=town.name,
        origin_m=origin_m,
        mask=mask,
        parked_centre_m=boxes[0][kept],
        parked_heading_rad=boxes[1][kept],
        parked_size_m=boxes[2][kept],
    )


def lane_mask(network: LaneNetwork) -> tuple[Array, U8]:
    """Origin [m] and mask of all lanes and sidewalks, as `TownGround` holds them."""
    tables = network.tables
    across = 0.5 * tables.width_m[:, None] * np.stack([-tables.tangent[:, 1], tables.tangent[:, 0]], axis=-1)
    left, right = tables.position_m[:, :2] + across, tables.position_m[:, :2] - across
    both = np.concatenate([left, right])
    low = np.maximum(np.floor(both.min(axis=0) - MARGIN_M), -0.5 * SIDE_MAX_M)
    high = np.minimum(np.ceil(both.max(axis=0) + MARGIN_M), 0.5 * SIDE_MAX_M)
    columns, rows = np.rint((high - low) / PIXEL_M).astype(int).tolist()
    mask = np.zeros((rows, columns), np.uint8)
    for lane in (lane for lane in network.lanes if lane.type not in _UNPAVED):
        first = int(tables.first[lane.index])
        span = slice(first, first + int(tables.count[lane.index]))
        line = (np.concatenate([left[span], right[span][::-1]]) - low) / PIXEL_M - 0.5
        pixels = np.stack([line[:, 0], rows - 1 - line[:, 1]], axis=-1)
        cv2.fillPoly(mask, [np.rint(16 * pixels).astype(np.int32)], (255,), shift=4)
    return low, mask


def parked_boxes(outline: TownOutline) -> tuple[Array, Array, Array]:
    """Middles [m] (P, 3), headings [rad] (P,) and sizes [m] (P, 3) of a town's parked cars.

    The town holds each as a box of five faces: the first is its right side, from its tail to its nose.
    """
    triangles = outline.collision_triangles[outline.collision_tags == Tag.CAR]
    corners = outline.collision_vertices_m[triangles.reshape(-1, _TRIANGLES, 3)]
    tail, nose = corners[:, 0, 0], corners[:, 0, 1]
    ahead = nose - tail
    far = corners[:, 2, 1]
    low, high = corners.min(axis=(1, 2)), corners.max(axis=(1, 2))
    length, width = (np.hypot(side[:, 0], side[:, 1]) for side in (ahead, far - nose))
    size = np.stack([length, width, high[:, 2] - low[:, 2]], axis=-1)
    return 0.5 * (low + high), elementary.arctan2(ahead[:, 1], ahead[:, 0]), size
