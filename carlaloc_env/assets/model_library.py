"""All movable models by name, as camera and LiDAR draw them.

Every vehicle of the catalogue, made of its parts.

The walkers of the catalogue, in every phase of their gait.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from carlaloc_env.assets.catalog import GAIT_PHASES, LOW_GAIT_PHASES, PLATE_SIZE_M, PLATES, VEHICLES, WALKERS
from carlaloc_env.assets.primitives import Look, disc
from carlaloc_env.assets.vehicles.car_ends import lit_lamps
from carlaloc_env.assets.vehicles.car_models import CARS
from carlaloc_env.assets.vehicles.cars import car, ego_body
from carlaloc_env.assets.vehicles.cycles import bicycle, motorcycle
from carlaloc_env.assets.vehicles.heavy_vehicles import bus, truck
from carlaloc_env.assets.vehicles.wheels import PlateMount, VehicleParts, plate
from carlaloc_env.assets.walkers.clothing import Build
from carlaloc_env.assets.walkers.figure import skin_of
from carlaloc_env.assets.walkers.gait import posture, standing
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


_GREY = (150, 148, 145)
_BROWN, _BLOND = (40, 20, 8), (130, 88, 34)

BUILDS: dict[str, tuple[Build, float]] = {
    "walker_man": (
        Build(stature_m=1.76, lower=(14, 20, 44), hair=(14, 9, 5), inner=(190, 188, 182), shoes=(60, 40, 24)),
        3.0,
    ),
    "walker_man_suit": (
        Build(
            stature_m=1.80, upper=(12, 14, 22), lower=(12, 14, 22), inner=(200, 204, 212), hair=_BROWN,
            skin=(175, 118, 88), carrier=(26, 14, 8), shoes=(4, 4, 4),
        ),
        2.0,
    ),
    "walker_man_stout": (
        Build(
            stature_m=1.74, girth=1.10, belly=1.28, lower=(52, 44, 32), skin=(70, 36, 22), bald=True,
            beard=True, hair=(10, 8, 7), short_sleeves=True, shoes=(120, 120, 118),
        ),
        0.0,
    ),
    "walker_youth": (
        Build(
            stature_m=1.70, girth=0.90, lower=(30, 32, 36), hair=(10, 7, 5), hat=(110, 12, 14),
            skin=(110, 62, 40), backpack=(14, 18, 26), shoes=(190, 190, 190),
        ),
        3.0,
    ),
    "walker_woman": (
        Build(
            stature_m=1.63, girth=0.86, hips=1.12, lower=(18, 26, 58), skin=(165, 108, 78), hair=_BROWN,
            long_hair=True, handbag=(96, 26, 12),
        ),
        2.0,
    ),
    "walker_woman_skirt": (
        Build(
            stature_m=1.66, girth=0.84, hips=1.10, lower=(60, 12, 18), skin=(180, 126, 96), hair=_BLOND,
            long_hair=True, skirt=True, short_sleeves=True, shoes=(90, 10, 14),
        ),
        1.0,
    ),
    "walker_woman_coat": (
        Build(
            stature_m=1.65, girth=0.88, hips=1.08, lower=(10, 10, 12), skin=(96, 54, 34), hair=(6, 5, 4),
            coat=True, carrier=(200, 190, 160), shoes=(20, 10, 6),
        ),
        2.0,
    ),
    "walker_elderly": (
        Build(
            stature_m=1.68, girth=1.02, belly=1.15, lower=(66, 58, 46), skin=(165, 104, 78), hair=_GREY,
            hat=(34, 30, 26), stick=True,
        ),
        12.0,
    ),
    "walker_elderly_woman": (
        Build(
            stature_m=1.58, girth=0.96, hips=1.12, belly=1.1, lower=(46, 40, 52), skin=(172, 116, 92),
            hair=_GREY, coat=True, handbag=(20, 12, 10),
        ),
        10.0,
    ),
    "walker_child": (
        Build(
            stature_m=1.28, girth=0.94, lower=(24, 44, 90), skin=(150, 92, 60), hair=(30, 16, 8), shorts=True,
            short_sleeves=True, backpack=(150, 24, 20), shoes=(170, 170, 170),
        ),
        2.0,
    ),
    "walker_girl": (
        Build(
            stature_m=1.18, girth=0.92, lower=(150, 40, 80), skin=(180, 120, 90), hair=_BLOND, long_hair=True,
            skirt=True, shoes=(180, 180, 180),
        ),
        1.0,
    ),
}  # fmt: skip
"""Build and forward lean [deg] of each walker."""


def walker_models() -> dict[str, Mesh]:
    """Meshes ``name/00`` … and ``name/stand``, and in few triangles ``name/low/00`` … ``name/low/stand``."""
    models: dict[str, Mesh] = {}
    for name, (build, stoop_deg) in BUILDS.items():
        person = WALKERS[name]
        for prefix, low, phases in ((name, False, GAIT_PHASES), (f"{name}/low", True, LOW_GAIT_PHASES)):
            postures = [
                posture(k / phases, person.stature_m, person.stride_m, stoop_deg=stoop_deg)
                for k in range(phases)
            ]
            postures.append(standing(person.stature_m, stoop_deg=stoop_deg))
            names = [*(f"{prefix}/{k:02d}" for k in range(phases)), f"{prefix}/stand"]
            skin = skin_of(build, Tag.PEDESTRIAN, low)
            models.update(zip(names, skin.posed_all(postures), strict=True))
    return models


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


@lru_cache(maxsize=1)
def build_library() -> ModelLibrary:
    """All models by name, from the cache when they were made before.

    Vehicles and their parts, walkers in each phase of their gait, the ego's body, lit signal lenses.

    Names, for every key of `VEHICLES`: ``name`` the whole vehicle, wheels straight; ``name/body`` without
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
        parts = vehicle(name)
        models[name] = parts.whole
        models |= {f"{name}/{k + 1:02d}": parts.steered(0.0, k + 1) for k in range(len(parts.pedalled))}
        bodies, lows = zip((parts.body, parts.low), *parts.pedalled, strict=True)
        for kind, phases in (("body", bodies), ("low", lows)):
            models[f"{name}/{kind}"] = phases[0]
            models |= {f"{name}/{kind}/{k:02d}": mesh for k, mesh in enumerate(phases[1:], 1)}
        for k, mesh in enumerate(dict.fromkeys(mount.mesh for mount in parts.wheels)):
            models[f"{name}/wheel{k}"] = mesh
        models.update(lit_lamps(name, parts.body))
    models.update(_plates())
    models.update(walker_models())
    models["ego"] = ego_body()
    lit = lit_lamps("ego", models["ego"])
    models |= {name: mesh for name, mesh in lit.items() if "/low/" not in name}
    for name, material in _LENSES.items():
        models[name] = disc(Look(material, Tag.TRAFFIC_LIGHT), LENS_RADIUS_M, 16, LENS_LIFT_M)
    return models


def _plates() -> dict[str, Mesh]:
    mount = PlateMount(position_m=(0.0, 0.0, 0.0), facing=1.0, width_m=PLATE_SIZE_M[0])
    tags = sorted({model.tag for model in VEHICLES.values()})
    return {f"plate/{tag.name}/{k:02d}": plate(mount, k, tag) for tag in tags for k in range(PLATES)}
