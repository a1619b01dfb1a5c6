"""Still props by name; every one stands with its foot at the origin, z up, its front along +x."""

from __future__ import annotations

from collections.abc import Callable

from carlaloc_env.assets.street import fences_and_poles, furniture
from carlaloc_env.assets.street.traffic_lights import traffic_light, walker_signal_head
from carlaloc_env.assets.street.traffic_signs import sign
from carlaloc_env.assets.vegetation.shrubs import hedge, shrub
from carlaloc_env.assets.vegetation.trees import tree
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.scene.mesh import Mesh

PROPS: dict[str, Callable[[], Mesh]] = {
    "lamp": furniture.lamp,
    "bench": furniture.bench,
    "bin": furniture.bin_,
    "hydrant": furniture.hydrant,
    "bollard": furniture.bollard,
    "bus_shelter": furniture.bus_shelter,
    "billboard": furniture.billboard,
    "banner": furniture.banner,
    "advertising_column": furniture.advertising_column,
    "newspaper_box": furniture.newspaper_box,
    "post_box": furniture.post_box,
    "cabinet": furniture.cabinet,
    "planter": furniture.planter,
    "utility_pole": fences_and_poles.utility_pole,
    "fence": fences_and_poles.fence,
    "guard_rail": fences_and_poles.guard_rail,
    "barrier": fences_and_poles.barrier,
    "delineator": fences_and_poles.delineator,
    "pedestrian_head": walker_signal_head,
    "shrub": shrub,
    "hedge": hedge,
}
"""Props that need no arguments."""


def prop(name: str) -> Mesh:
    """A prop by its name.

    Raises:
        ConfigError: no prop has this name.
    """
    if name not in PROPS:
        raise ConfigError(unknown_name("prop", name, PROPS))
    return PROPS[name]()


__all__ = ["PROPS", "prop", "sign", "traffic_light", "tree"]
