"""Towns imported from sketches, checked: joints, radii, reachability."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shared_fixtures.worlds.street_sketches import Sketch

from carlaloc_env.map.checks.report import report
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.openstreetmap.import_town import ImportedTown, import_town, write_town


def made(sketch: Sketch, folder: Path, heights: Path | None = None) -> tuple[ImportedTown, LaneNetwork]:
    """A town, written to a folder, and its lanes."""
    town = import_town(sketch.write(folder / "a.osm"), heights=heights)
    write_town(town, folder)
    xodr = read_opendrive(folder / "town.xodr")
    network = build_network(xodr)
    assert report(xodr, network).errors == ()
    check_lanes(network)
    return town, network


def check_lanes(network: LaneNetwork) -> None:
    """The bars: joints of 1 mm and 1 mrad, radii of 6 m, one part in which every lane can be reached."""
    driving = [lane for lane in network.lanes if lane.type == "driving"]
    index = {lane.index: k for k, lane in enumerate(driving)}
    pairs = [(a.index, b) for a in driving for b in a.successors if b in index]
    a, b = np.array(pairs).T
    end = network.exact_pose(a, np.array([network.lanes[k].length_m for k in a]))
    start = network.exact_pose(b, np.zeros(len(b)))
    assert np.abs(np.asarray(end[0]) - np.asarray(start[0])).max() < 1e-3
    turn = np.asarray(end[1]) - np.asarray(start[1])
    assert np.abs((turn + np.pi) % (2 * np.pi) - np.pi).max() < 1e-3
    assert np.abs(np.asarray(end[3]) - np.asarray(start[3])).max() < 0.01
    for lane in driving:
        s = np.linspace(0.0, lane.length_m, max(3, int(lane.length_m / 0.5)))
        assert np.abs(network.exact_pose(np.full(len(s), lane.index), s)[3]).max() < 1 / 6.0
    beside = [(k.index, n) for k in driving for n in (k.left, k.right) if n in index]
    rows, columns = np.array([(index[p], index[q]) for p, q in pairs + beside]).T
    parts, _ = connected_components(
        coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(driving),) * 2), connection="strong"
    )
    assert parts == 1
    assert all(any(n in index for n in lane.successors) for lane in driving)
