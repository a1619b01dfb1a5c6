"""Packaged towns, each read or built once in a process."""

import functools
from pathlib import Path

import pytest

from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.sources import find_town
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town


@functools.cache
def network_at(path: Path) -> LaneNetwork:
    """Lanes of a map, read once in a process; tests only look at them."""
    return build_network(path)


def town_network(name: str) -> LaneNetwork:
    """Lanes of a packaged town."""
    return network_at(find_town(name))


@pytest.fixture(scope="session")
def town03() -> Town:
    """The whole of Town03."""
    return load_town("Town03")


@pytest.fixture(scope="session")
def town03_mesh(town03: Town) -> Mesh:
    """All that is seen of Town03 as one mesh."""
    return merge(town03.chunks)
