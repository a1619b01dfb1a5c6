"""Builds a map's lane network with all that stands along it."""

from pathlib import Path

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.build_lanes import build_lanes, road_map
from carlaloc_env.map.lanes.crosswalks import find_crosswalks
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.signals import find_signals
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.opendrive.records import OpenDrive
from carlaloc_env.road.road_profile import Relief


def build_network(xodr: OpenDrive | Path | bytes, relief: Relief | None = None) -> LaneNetwork:
    """The network of a map, of an OpenDRIVE file or of its bytes.

    Args:
        xodr: The map.
        relief: Undulation that the file does not hold; None: heights are exactly the file's.

    Raises:
        MapError: The map cannot be used, is too large, or has a lane that is not finite.
    """
    roads = road_map(xodr if isinstance(xodr, OpenDrive) else read_opendrive(xodr), relief)
    with np.errstate(all="ignore"):
        network = LaneNetwork(lambda: roads, build_lanes(roads))
        network.signals, network.static_signs = find_signals(network)
        network.crosswalks = find_crosswalks(network)
        network.bank = _banks(network)
    return network


def _banks(network: LaneNetwork) -> Array:
    """Rise per metre to the left at all samples: superelevation, lateral shape and heights of lanes."""
    tables = network.tables
    lane = np.repeat(np.arange(len(tables.count)), tables.count)
    station = (np.arange(len(lane)) - tables.first[lane]) * tables.step_m[lane]
    s = network.s_m(lane, station)
    return np.where(network.forward[lane], 1.0, -1.0) * network.surface.lane_bank(lane, s)
