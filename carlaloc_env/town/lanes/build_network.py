"""A map's lane network with all that stands along it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carlaloc_env.core.road.road_profile import Relief
from carlaloc_env.town.lanes.centre_lines import KeepTables
from carlaloc_env.town.lanes.crosswalks import find_crosswalks
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.lanes.signals import find_signals
from carlaloc_env.town.opendrive.reader import read_opendrive
from carlaloc_env.town.opendrive.records import OpenDrive


def build_network(
    xodr: OpenDrive | Path | bytes, relief: Relief | None = None, *, keep: KeepTables | None = None
) -> LaneNetwork:
    """The network of a map, of an OpenDRIVE file or of its bytes.

    Args:
        xodr: The map.
        relief: Undulation that the file does not hold; None: heights are exactly the file's.
        keep: Gives the tables that were kept of these lanes, or what it is handed makes anew.

    Raises:
        MapError: The map cannot be used, is too large, or has a lane that is not finite.
    """
    network = LaneNetwork(xodr if isinstance(xodr, OpenDrive) else read_opendrive(xodr), relief, keep=keep)
    with np.errstate(all="ignore"):
        network.signals, network.static_signs = find_signals(network)
        network.crosswalks = find_crosswalks(network)
    return network
