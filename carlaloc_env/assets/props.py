"""Still props by name; every one stands with its foot at the origin, z up, its front along +x."""

from __future__ import annotations

from collections.abc import Callable

from carlaloc_env.assets import roadside, street
from carlaloc_env.assets.shrubs import hedge, shrub
from carlaloc_env.assets.signals import pedestrian_head, traffic_light
from carlaloc_env.assets.signs import sign
from carlaloc_env.assets.trees import tree
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.scene.mesh import Mesh

PROPS: dict[str, Callable[[], Mesh]] = {
    "lamp": street.lamp,
    "bench": street.bench,
    "bin": street.bin_,
    "hydrant": street.hydrant,
    "bollard": street.bollard,
    "bus_shelter": street.bus_shelter,
    "billboard": street.billboard,
    "banner": street.banner,
    "advertising_column": street.advertising_column,
    "newspaper_box": street.newspaper_box,
    "post_box": street.post_box,
    "cabinet": street.cabinet,
    "planter": street.planter,
    "utility_pole": roadside.utility_pole,
    "fence": roadside.fence,
    "guard_rail": roadside.guard_rail,
    "barrier": roadside.barrier,
    "delineator": roadside.delineator,
    "pedestrian_head": pedestrian_head,
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
