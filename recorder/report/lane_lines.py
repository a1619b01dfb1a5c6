"""Centre lines of a town's driving lanes, for maps."""

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import is_name
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.sources import known_towns


def lane_lines(network: LaneNetwork) -> list[Array]:
    """Centre lines of driving lanes [m], shape (K, 3) each."""
    tables = network.tables
    return [
        tables.position_m[int(tables.first[lane.index]) :][: int(tables.count[lane.index])]
        for lane in network.lanes
        if lane.type == "driving"
    ]


def lane_lines_of(town: str) -> list[Array]:
    """Centre lines of a town's driving lanes [m]; empty for an unknown town."""
    source = known_towns().get(town) if is_name(town) else None
    return [] if source is None else lane_lines(build_network(read_opendrive(source)))
