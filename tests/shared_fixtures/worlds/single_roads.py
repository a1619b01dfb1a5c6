"""Maps of one road with any reference line, and points on it."""

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.opendrive.records import OpenDrive
from carlaloc_env.map.opendrive.reference_line import LinePose
from carlaloc_env.map.opendrive.road_surface import RoadSurface

X0, Y0, H0 = 3.0, -7.0, 0.6


WIDTH = '<width sOffset="0" a="3" b="0" c="0" d="0"/>'


LANES = (
    f'<laneSection s="0"><left><lane id="1" type="driving">{WIDTH}</lane></left>'
    '<center><lane id="0" type="none"/></center>'
    f'<right><lane id="-1" type="driving">{WIDTH}</lane></right></laneSection>'
)


FLAT = '<elevation s="0" a="0" b="0" c="0" d="0"/>'


def road(
    shape: str,
    length: float,
    *,
    lanes: str = LANES,
    offset: str = "",
    elevation: str = FLAT,
    lateral: str = "",
    head: str = "",
    attributes: str = "",
) -> OpenDrive:
    return read_opendrive(
        '<OpenDRIVE><header revMajor="1" revMinor="7"/>'
        f'<road id="1" length="{length!r}" junction="-1" {attributes}>{head}<planView>'
        f'<geometry s="0" x="{X0}" y="{Y0}" hdg="{H0}" length="{length!r}">{shape}</geometry></planView>'
        f"<elevationProfile>{elevation}</elevationProfile><lateralProfile>{lateral}</lateralProfile>"
        f"<lanes>{offset}{lanes}</lanes></road></OpenDRIVE>".encode()
    )


def line_at(xodr: OpenDrive, s: NDArray[np.float64]) -> LinePose:
    return RoadSurface(xodr.roads).plan_view.evaluate(np.zeros(len(s), dtype=np.int64), s)


def to_world(
    u: NDArray[np.float64], v: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return X0 + math.cos(H0) * u - math.sin(H0) * v, Y0 + math.sin(H0) * u + math.cos(H0) * v


def lane_points(network: LaneNetwork, lane_id: int, s: NDArray[np.float64]) -> NDArray[np.float64]:
    lane = next(n.index for n in network.lanes if n.lane_id == lane_id)
    return network.surface.lane_centre(np.full(len(s), lane), s).position_m
