"""Green close to the road: climbers on façades, beds at their feet, along kerbs and on medians.

All of it gives way and is drawn from streams of its own: the towns' drives do not change with it.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from carlaloc_env.assets.plants import bed, climber
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import distance_along, interpolated
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.buildings.building_lots import Lot
from carlaloc_env.scenery.ground.land import Land
from carlaloc_env.scenery.meshing.props import PropField
from carlaloc_env.scenery.roads.sidewalks import GRASS_MEDIAN_M, raised_runs, run_edges

GREEN_SHARE = {"dwelling": 0.8, "shop": 0.7, "lobby": 0.7, "hall": 0.6}
"""Share of the buildings of each kind of ground floor that have plants at their front."""
CLIMBER_SHARE, BUSH_SHARE = 0.25, 0.6
"""Share of the piers of such a front that are overgrown, and of the places at its foot that are planted."""
DOOR_CLEAR_M = 1.3
"""Nothing grows nearer to a door's middle [m]."""
KERB_M, BED_M, END_M = 0.6, 3.0, 10.0
"""Distance of beds from the kerb, their length, and length of a road's ends that stays free [m]."""
NARROW_M, POST_CLEAR_M = 2.4, 2.2
"""Narrower sidewalks have no beds [m]; nor do places nearer than this to what stands on one [m]."""
BED_SHARE = {"residential": 0.5, "small_town": 0.5, "downtown": 0.5, "skyscraper": 0.5, "waterfront": 0.4}
"""Share of a sidewalk's length that is planted, by zone."""
MEDIAN_SHARE = 0.65
"""The same of medians that carry grass."""
HUES = ((205, 220, 185), (170, 205, 150), (225, 225, 165), (150, 175, 140))
"""Tints of leaves, of which each plant has one."""


def add_street_greenery(props: PropField, land: Land, lots: Sequence[Lot], posts_m: Array) -> None:
    """Plant fronts and kerbs.

    Args:
        props: Takes the plants.
        land: The town's land.
        lots: Its buildings.
        posts_m: Base points of all that stands on sidewalks [m], shape (K, 2).
    """
    for lot in lots:
        _front(props, land, lot)
    _roadsides(props, land, posts_m)


def _front(props: PropField, land: Land, lot: Lot) -> None:
    """Climbers on the piers between windows; at the foot beds, or tubs between shop windows."""
    style, width_m = lot.plan.appearance.style, lot.plan.width_m
    draw = clock.stream(land.seed, lot.name, index=5)
    if draw.random() > GREEN_SHARE[style.ground]:
        return
    along = np.array([elementary.cos(lot.heading_rad), elementary.sin(lot.heading_rad)])
    outward = np.array([along[1], -along[0]])
    bays = max(1, round((width_m - 0.8) / style.bay_m))
    pitch = (width_m - 0.8) / bays
    pier, door_m = 0.4 + pitch * np.arange(bays + 1.0), 0.4 + pitch * (bays // 2 + 0.5)

    def put(name: str, make: Callable[[int], Mesh], a: Array, b: float, scale: Array) -> None:
        bases_m = land.on_ground(lot.corner_m + a[:, None] * along + b * outward, -0.05)
        _put(props, name, make, bases_m, np.full(len(a), lot.heading_rad), scale, draw)

    grown: Array = pier[draw.random(bays + 1) < CLIMBER_SHARE]
    put("climber", climber, grown, 0.02, draw.uniform(0.7, 1.3, len(grown)))
    if style.ground in ("shop", "lobby"):
        beside: Array = pier[1:-1][draw.random(bays - 1) < BUSH_SHARE] - 0.6
        put("tub", partial(bed, length_m=1.2), beside, 0.42, draw.uniform(0.8, 1.1, len(beside)))
        return
    spots = np.arange(0.6, width_m - 3.4, 3.2)
    spots = spots[
        (np.abs(spots + 1.5 - door_m) > 1.5 + DOOR_CLEAR_M) & (draw.random(len(spots)) < BUSH_SHARE)
    ]
    put("bed", bed, spots, 0.5, draw.uniform(0.8, 1.3, len(spots)))


def _roadsides(props: PropField, land: Land, posts_m: Array) -> None:
    """Beds between kerb and walkers and on medians, where nothing else stands."""
    posts = cKDTree(posts_m) if len(posts_m) else None
    for strip in land.strips:
        for first, last in raised_runs(strip) if strip.junction_id is None else ():
            left, right = run_edges(strip, first, last)
            across_m = np.hypot(*(left - right)[:, :2].T)
            width_m = float(np.median(across_m))
            if strip.kind(first) == "median":
                line, least_m = 0.5 * (left + right), GRASS_MEDIAN_M
            else:
                beside = first > 0 and strip.kind(first - 1) == "roadway"
                share = KERB_M / max(width_m, KERB_M)
                line = left + share * (right - left) if beside else right + share * (left - right)
                least_m = NARROW_M
            if width_m >= least_m:
                name = f"roadside/{strip.road_id}/{strip.section}/{first}"
                room_m = across_m - least_m
                _beds(props, land, line, room_m, posts, strip.kind(first), clock.stream(land.seed, name))


def _beds(
    props: PropField,
    land: Land,
    line_m: Array,
    room_m: Array,
    posts: cKDTree | None,
    kind: str,
    draw: np.random.Generator,
) -> None:
    """Beds along a line, as often as the zone has them, and where there is room at both of their ends."""
    length_m = distance_along(line_m)
    if length_m[-1] < 2 * END_M + BED_M:
        return
    at = np.arange(END_M, length_m[-1] - END_M - BED_M, BED_M + 0.2)
    base_m, end = (interpolated(at + step, length_m, line_m) for step in (0.0, BED_M))
    zones = land.zones.kinds_at(base_m[:, :2])
    share = [MEDIAN_SHARE if kind == "median" else BED_SHARE.get(str(zone), 0.0) for zone in zones]
    keep = draw.random(len(at)) < np.array(share)
    for step in (0.0, BED_M):
        keep &= np.interp(at + step, length_m, room_m) > -0.01
    if posts is not None:
        keep &= posts.query(0.5 * (base_m + end)[:, :2])[0] > POST_CLEAR_M
    way = (end - base_m)[keep]
    size = draw.uniform(0.9, 1.35, len(way)) if kind == "median" else draw.uniform(0.7, 1.0, len(way))
    bases_m = base_m[keep] - [0.0, 0.0, 0.05]
    _put(props, "bed", bed, bases_m, elementary.arctan2(way[:, 1], way[:, 0]), size, draw)


def _put(
    props: PropField,
    name: str,
    make: Callable[[int], Mesh],
    bases_m: Array,
    yaw_rad: Array,
    scale: Array,
    draw: np.random.Generator,
) -> None:
    """Plants of four shapes and hues."""
    kind = draw.integers(0, len(HUES), len(bases_m))
    for k, hue in enumerate(HUES):
        rows = kind == k
        tint = np.array(hue) / 215.0
        props.put(("street", name, k), partial(make, k), bases_m[rows], yaw_rad[rows], scale[rows], tint)
