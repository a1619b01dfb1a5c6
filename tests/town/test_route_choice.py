"""Routes that are chosen for towns whose owner has given none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.town.route_choice import choose_route, lanes_that_go_on

ROOT = Path(__file__).parents[2]
MAPS = sorted(
    [*(ROOT.parent / "shared/data/carla_xodr").glob("*.xodr"), *(ROOT / "maps").glob("*/town.xodr")]
)
CROSSING = Path(__file__).parent / "data" / "crossing.xodr"


@pytest.mark.parametrize("path", MAPS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_chosen_routes_follow_lanes(path: Path) -> None:
    """A chosen route has the length asked for and runs on driving lanes without a jump."""
    network = LaneNetwork.from_opendrive(path)
    route = choose_route(network, 800.0)
    assert route is not None
    assert route.length_m == pytest.approx(800.0, rel=0.03)
    steps = np.linalg.norm(np.diff(route.position_m, axis=0), axis=1)
    assert steps.max() < 1.2 * route.step_m + 0.1
    near = network.nearest(route.position_m)
    assert np.percentile(near.distance_m, 95) < 0.3
    assert all(network.lanes[lane].type == "driving" for lane in np.unique(route.lane))


def test_dead_ends_are_known() -> None:
    """On a lone crossing no lane goes on for ever; a route is found all the same."""
    network = LaneNetwork.from_opendrive(CROSSING)
    assert not lanes_that_go_on(network).any()
    route = choose_route(network)
    assert route is not None
    assert route.length_m > 50.0
