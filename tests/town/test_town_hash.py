"""The towns of the package are those that their hashes name."""

from dataclasses import replace

import numpy as np
import pytest
from shared_fixtures.worlds.small_towns import Built

from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.map.roads import TownRoads
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import town_hash

HASHES = {
    "Town01": "fb34fe7460423ee8177fcccc3b090d63",
    "Town03": "7f661527708167652fbd47a1ce059f35",
    "Town04": "2f419c37c38afe16a18d5b7969e26b4b",
    "Town05": "67713735c6c8d2162463e889c5ace218",
    "Town06": "8aebcf79cfd0ce57c070bf94f2f778c8",
    "Town07": "b7c805e65c28c9a8987036590de0fd86",
    "Town10": "1555aef2f126324d4dc96b459156d3d1",
}
"""A town that changes makes all its episodes useless: it needs a line in the changelog, and its hash here."""
MARKS = dict.fromkeys(("Town01", "Town07", "Town10"), pytest.mark.long) | dict.fromkeys(
    ("Town04", "Town05", "Town06"), pytest.mark.soak
)
"""Of towns that no other test builds; Town03 is there from the start."""


@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, ())) for name in HASHES])
def test_towns_are_those_that_drives_were_recorded_in(name: str) -> None:
    assert load_town(name).town_hash == HASHES[name]


def test_what_is_driven_on_or_hit_counts_and_what_is_seen_does_not(river: Built) -> None:
    outline = river.scenery
    assert outline is not None
    roads = TownRoads(network=river.network, geo=GeoReference(latitude_deg=1.0, longitude_deg=2.0))
    before = town_hash(roads, outline)
    moved = outline.collision_vertices_m.copy()
    moved[7, 2] = np.nextafter(moved[7, 2], np.inf)
    assert town_hash(roads, replace(outline, collision_vertices_m=moved)) != before
    elsewhere = GeoReference(latitude_deg=1.0, longitude_deg=2.1)
    assert town_hash(replace(roads, geo=elsewhere), outline) != before
    assert town_hash(roads, replace(outline, lamps_m=outline.lamps_m + 1.0)) == before
