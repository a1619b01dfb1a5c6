"""Everything that lies or grows between roads and buildings, by zone."""

from __future__ import annotations

from collections.abc import Hashable

from carlaloc_env.town.farmland import add_plots, lay_plots
from carlaloc_env.town.land import Land
from carlaloc_env.town.meshing import MeshBuilder
from carlaloc_env.town.planting import plant
from carlaloc_env.town.promenade import line_waterfront
from carlaloc_env.town.prop_field import PropField
from carlaloc_env.town.wayside import line_highways


def dress_land(raised: MeshBuilder, cover: MeshBuilder, solid: MeshBuilder, land: Land) -> PropField:
    """Fields, waysides, promenades and plants.

    Args:
        raised: Takes ground that carries cars.
        cover: Takes what is seen but gives way, such as crops.
        solid: Takes what is hit.
        land: The town's land.
    """
    props = PropField()
    line_highways(raised, solid, props, land)
    line_waterfront(props, land)
    fields = add_plots(cover, props, land, lay_plots(land))
    plant(land, props, fields)
    return props


def is_tree(key: Hashable) -> bool:
    """Whether a prop is a tree, whose trunk is solid."""
    return isinstance(key, tuple) and str(key[0]).startswith("tree ")
