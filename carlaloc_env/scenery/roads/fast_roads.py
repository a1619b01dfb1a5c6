"""Fast roads: which roads are laid and kept better than streets, and how."""

from collections.abc import Sequence

from carlaloc_env.map.lanes.speed_limits import road_limit_mps
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scene.materials import Material
from carlaloc_env.scenery.ground.paved_areas import JunctionArea

MOTORWAY_MPS = 70.0 / 3.6 - 0.1
"""Limit from which a road is fast [m/s]."""
FAST_SURFACE = Material.ASPHALT_MOTORWAY
"""Material of driving lanes of fast roads."""
FAST_DETAILS = 0.3
"""Repairs and cracks on fast roads, as a share of those on streets; covers lie beside them."""


def is_fast(road: Road) -> bool:
    """Whether a road is laid and kept as fast roads are."""
    return road.type == "motorway" or road_limit_mps(road) >= MOTORWAY_MPS


def is_fast_junction(junction: JunctionArea, roads: Sequence[Road]) -> bool:
    """Whether all roads through a junction are fast: where carriageways part and merge."""
    return all(is_fast(roads[strip.road]) for strip in junction.strips)
