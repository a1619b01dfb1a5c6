"""A map's lane network with all that stands along it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carlaloc_env.town.lanes.crosswalks import find_crosswalks
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.lanes.signals import find_signals
from carlaloc_env.town.opendrive.reader import read_opendrive
from carlaloc_env.town.opendrive.records import OpenDrive


def build_network(xodr: OpenDrive | Path | bytes) -> LaneNetwork:
    """The network of a map, of an OpenDRIVE file or of its bytes.

    Raises:
        MapError: The map cannot be used, is too large, or has a lane that is not finite.
    """
    network = LaneNetwork(xodr if isinstance(xodr, OpenDrive) else read_opendrive(xodr))
    with np.errstate(all="ignore"):
        network.signals, network.static_signs = find_signals(network)
        network.crosswalks = find_crosswalks(network)
    return network
