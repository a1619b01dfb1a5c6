"""Fast roads: they are laid and kept better than streets."""

from __future__ import annotations

from collections.abc import Sequence

from carlaloc_env.scene.materials import Material
from carlaloc_env.town.ground.paved_areas import JunctionArea
from carlaloc_env.town.ground.road_edges import road_limit_mps
from carlaloc_env.town.opendrive.records import Road

FAST_MPS = 70.0 / 3.6 - 0.1
"""Limit from which a road is fast [m/s]."""
SURFACE = Material.ASPHALT_MOTORWAY
"""Material of their driving lanes."""
DETAILS = 0.3
"""Repairs and cracks on them, as a share of those on streets; covers lie beside them."""


def is_fast(road: Road) -> bool:
    """Whether a road is laid and kept as fast roads are."""
    return road.type == "motorway" or road_limit_mps(road) >= FAST_MPS


def is_fast_junction(junction: JunctionArea, roads: Sequence[Road]) -> bool:
    """Whether all roads through a junction are fast: where carriageways part and merge."""
    return all(is_fast(roads[strip.road]) for strip in junction.strips)
