"""Mesh of every vehicle in the catalogue."""

from __future__ import annotations

from collections.abc import Callable

from carlaloc_env.assets.cars import car
from carlaloc_env.assets.catalog import VEHICLES
from carlaloc_env.assets.cycles import bicycle, motorcycle
from carlaloc_env.assets.fleet import CARS
from carlaloc_env.assets.heavy import bus, lorry
from carlaloc_env.errors import ConfigError, unknown_name
from carlaloc_env.scene import Mesh

_OTHERS: dict[str, Callable[[], Mesh]] = {
    "lorry": lorry,
    "bus": bus,
    "motorcycle": motorcycle,
    "bicycle": bicycle,
}


def vehicle(name: str) -> Mesh:
    """Mesh of a vehicle, centred on its box, resting on z = 0, nose along +x.

    Raises:
        ConfigError: no vehicle has this name.
    """
    if name in CARS:
        return car(CARS[name])
    if name in _OTHERS:
        return _OTHERS[name]()
    raise ConfigError(unknown_name("vehicle", name, VEHICLES))
