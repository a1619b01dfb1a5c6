"""Every vehicle of the catalogue, made of its parts."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from carlaloc_env.assets.catalog import VEHICLES
from carlaloc_env.assets.vehicles.bus import bus
from carlaloc_env.assets.vehicles.car_models import CARS
from carlaloc_env.assets.vehicles.cars import car
from carlaloc_env.assets.vehicles.cycles import bicycle, motorcycle
from carlaloc_env.assets.vehicles.parts import VehicleParts
from carlaloc_env.assets.vehicles.truck import truck
from carlaloc_env.core.errors import ConfigError, unknown_name

_OTHERS: dict[str, Callable[[], VehicleParts]] = {
    "lorry": truck,
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
