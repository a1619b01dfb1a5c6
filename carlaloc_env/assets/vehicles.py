"""Every vehicle of the catalogue, made of its parts."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from carlaloc_env.assets.bus import bus
from carlaloc_env.assets.cars import car
from carlaloc_env.assets.catalog import VEHICLES
from carlaloc_env.assets.cycles import bicycle, motorcycle
from carlaloc_env.assets.fleet import CARS
from carlaloc_env.assets.lorry import lorry
from carlaloc_env.assets.vehicle_parts import VehicleParts
from carlaloc_env.core.errors import ConfigError, unknown_name

_OTHERS: dict[str, Callable[[], VehicleParts]] = {
    "lorry": lorry,
    "bus": bus,
    "motorcycle": motorcycle,
    "bicycle": bicycle,
}


@lru_cache(maxsize=len(VEHICLES))
def vehicle(name: str) -> VehicleParts:
    """Parts of a vehicle, centred on its box, resting on z = 0, nose along +x.

    Raises:
        ConfigError: no vehicle has this name.
    """
    if name in CARS:
        return car(CARS[name])
    if name in _OTHERS:
        return _OTHERS[name]()
    raise ConfigError(unknown_name("vehicle", name, VEHICLES))
