"""Cover of the land between roads and buildings, by zone: fields, verges, waterfronts, gardens and plants."""

from collections.abc import Hashable, Sequence

from carlaloc_env.scenery.buildings.building_lots import Lot
from carlaloc_env.scenery.ground.land import Land
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import PropField
from carlaloc_env.scenery.vegetation.farmland import add_plots, lay_plots
from carlaloc_env.scenery.vegetation.gardens import add_gardens
from carlaloc_env.scenery.vegetation.planting import plant
from carlaloc_env.scenery.vegetation.verges import line_highways
from carlaloc_env.scenery.vegetation.waterfronts import line_waterfront


def dress_land(
    raised: MeshBuilder, cover: MeshBuilder, solid: MeshBuilder, land: Land, lots: Sequence[Lot]
) -> PropField:
    """Fields, waysides, promenades, gardens and plants.

    Args:
        raised: Takes ground that carries cars.
        cover: Takes what is seen but gives way, such as crops.
        solid: Takes what is hit.
        land: The town's land.
        lots: Its buildings.
    """
    props = PropField()
    line_highways(raised, solid, props, land)
    line_waterfront(props, land)
    add_gardens(cover, props, land, lots)
    fields = add_plots(cover, props, land, lay_plots(land))
    plant(land, props, fields)
    return props


def is_tree(key: Hashable) -> bool:
    """Whether a prop is a tree, whose trunk is solid."""
    return isinstance(key, tuple) and str(key[0]).startswith("tree ")
