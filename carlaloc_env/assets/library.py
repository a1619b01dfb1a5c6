"""All movable models by name, as camera and LiDAR draw them."""

from __future__ import annotations

from functools import lru_cache

from carlaloc_env.assets.catalog import VEHICLES
from carlaloc_env.assets.ego import ego_body
from carlaloc_env.assets.lamps import lit_lamps
from carlaloc_env.assets.shapes import Look, disc
from carlaloc_env.assets.vehicles import vehicle
from carlaloc_env.assets.walkers import walker_models
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, ModelLibrary
from carlaloc_env.semantics import Tag

LENS_RADIUS_M = 0.15
"""Radius of a traffic light's lens [m]."""
LENS_LIFT_M = 0.012
"""How far a lit lens stands before the dark one [m]."""

_LENSES = {
    "signal_red": Material.LAMP_RED,
    "signal_yellow": Material.LAMP_AMBER,
    "signal_green": Material.LAMP_GREEN,
}


@lru_cache(maxsize=1)
def build_library() -> ModelLibrary:
    """Vehicles, walkers in each phase of their gait, the ego's body and lit signal lenses.

    Names: every key of `VEHICLES`; ``walker/00`` … ``walker/15`` and ``walker/stand`` for every key of
    `WALKERS`; ``vehicle/brake``, ``vehicle/left``, ``vehicle/right`` (lit lamps);
    ``ego``; ``signal_red``, ``signal_yellow``, ``signal_green``.
    """
    models: dict[str, Mesh] = {name: vehicle(name) for name in VEHICLES}
    models.update(lit_lamps(models))
    models.update(walker_models())
    models["ego"] = ego_body()
    for name, material in _LENSES.items():
        models[name] = disc(Look(material, Tag.TRAFFIC_LIGHT), LENS_RADIUS_M, 16, LENS_LIFT_M)
    return ModelLibrary(models)
