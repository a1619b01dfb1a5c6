"""Library of all movable models by name, as camera and LiDAR draw them."""

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from carlaloc_env.assets.catalog import ALL_VEHICLES, EGO_MODEL, VEHICLES
from carlaloc_env.assets.number_plates import PLATE_SIZE_M, PLATES
from carlaloc_env.assets.primitives import Look, disc
from carlaloc_env.assets.vehicles.buses import bus
from carlaloc_env.assets.vehicles.car_models import CARS
from carlaloc_env.assets.vehicles.cars import EGO_SPEC, car, ego_body
from carlaloc_env.assets.vehicles.cycles import bicycle, motorcycle
from carlaloc_env.assets.vehicles.lit_lamps import lit_lamps
from carlaloc_env.assets.vehicles.trucks import truck
from carlaloc_env.assets.vehicles.vehicle_parts import PlateMount, VehicleParts, plate
from carlaloc_env.assets.walkers.walker_models import walker_models
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.files.array_cache import cached
from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, ModelLibrary, meshes_from_arrays, meshes_to_arrays
from carlaloc_env.scene.semantic_tags import Tag

_OTHERS: dict[str, Callable[[], VehicleParts]] = {
    "lorry": truck,
    "bus": bus,
    "motorcycle": motorcycle,
    "bicycle": bicycle,
}
LENS_RADIUS_M = 0.15
"""Radius of a traffic light's lens [m]."""
LENS_LIFT_M = 0.012
"""How far a lit lens stands before the dark one [m]."""
KEPT_FILES = 3
"""Cached files of models kept, of this version and earlier ones."""
_LENSES = {
    "signal_red": Material.LAMP_RED,
    "signal_yellow": Material.LAMP_AMBER,
    "signal_green": Material.LAMP_GREEN,
}


@lru_cache(maxsize=len(ALL_VEHICLES))
def vehicle(name: str) -> VehicleParts:
    """Parts of a vehicle, centred on its box, resting on z = 0, nose along +x.

    Raises:
        ConfigError: no vehicle has this name.
    """
    if name == EGO_MODEL.name:
        return car(EGO_SPEC)
    if name in CARS:
        return car(CARS[name])
    if name in _OTHERS:
        return _OTHERS[name]()
    raise ConfigError(unknown_name("vehicle", name, VEHICLES))


@lru_cache(maxsize=1)
def build_library() -> ModelLibrary:
    """All models by name, from the cache when they were made before.

    Vehicles and their parts, walkers in each phase of their gait, the ego's body, lit signal lenses.

    Names, for every key of `ALL_VEHICLES`: ``name`` the whole vehicle, wheels straight; ``name/body`` without
    wheels and plates; ``name/wheel0`` … its wheels; ``name/low`` the whole in few triangles;
    ``name/brake``, ``name/left``, ``name/right``, ``name/reverse`` lit lamps, and the same under
    ``name/low/``. Cycles have their further phases of pedalling behind ``name``, ``name/body`` and
    ``name/low``: ``name/01``, ``name/body/01`` and so on.
    ``plate/CAR/00`` … number plates of each vehicle tag, facing +x at the origin. For every key of
    `WALKERS`: ``name/00`` …, ``name/stand``, ``name/low/00`` …, ``name/low/stand``. Besides: ``ego``,
    its lit lamps ``ego/brake``, ``ego/left``, ``ego/right`` and ``ego/reverse``, ``signal_red``,
    ``signal_yellow``, ``signal_green``.
    """
    models = cached(
        "models",
        "models",
        module=__name__,
        make=lambda: make_models(),
        to_arrays=_models_to_arrays,
        from_arrays=_models_from_arrays,
        kept_files=KEPT_FILES,
    )
    return ModelLibrary(models)


def _models_to_arrays(models: Mapping[str, Mesh]) -> Arrays:
    names = np.frombuffer("\n".join(models).encode(), np.uint8)
    return {"names": names, **meshes_to_arrays(list(models.values()))}


def _models_from_arrays(arrays: Arrays) -> dict[str, Mesh]:
    names = arrays["names"].tobytes().decode().split("\n")
    return dict(zip(names, meshes_from_arrays(arrays), strict=True))


def make_models() -> dict[str, Mesh]:
    """The models of `build_library` by name, made anew."""
    models: dict[str, Mesh] = {}
    for name in VEHICLES:
        models.update(_vehicle_models(name))
    models.update(_plates())
    models.update(walker_models())
    models["ego"] = ego_body()
    lit = lit_lamps("ego", models["ego"])
    models |= {name: mesh for name, mesh in lit.items() if "/low/" not in name}
    for name, material in _LENSES.items():
        models[name] = disc(Look(material, Tag.TRAFFIC_LIGHT), LENS_RADIUS_M, 16, LENS_LIFT_M)
    return models | _vehicle_models(EGO_MODEL.name)


def _vehicle_models(name: str) -> dict[str, Mesh]:
    """Whole vehicle, body, few triangles, wheels and lit lamps."""
    parts = vehicle(name)
    models = {name: parts.whole}
    models |= {f"{name}/{k + 1:02d}": parts.steered(0.0, k + 1) for k in range(len(parts.pedalled))}
    bodies, lows = zip((parts.body, parts.low), *parts.pedalled, strict=True)
    for kind, phases in (("body", bodies), ("low", lows)):
        models[f"{name}/{kind}"] = phases[0]
        models |= {f"{name}/{kind}/{k:02d}": mesh for k, mesh in enumerate(phases[1:], 1)}
    for k, mesh in enumerate(dict.fromkeys(mount.mesh for mount in parts.wheels)):
        models[f"{name}/wheel{k}"] = mesh
    return models | lit_lamps(name, parts.body)


def _plates() -> dict[str, Mesh]:
    mount = PlateMount(position_m=(0.0, 0.0, 0.0), facing=1.0, width_m=PLATE_SIZE_M[0])
    tags = sorted({model.tag for model in VEHICLES.values()})
    return {f"plate/{tag.name}/{k:02d}": plate(mount, k, tag) for tag in tags for k in range(PLATES)}
