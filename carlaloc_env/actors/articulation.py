"""Moving parts of actors: wheels that turn and steer, phases of a gait; tables for placing them."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.assets.catalog import ALL_VEHICLES, GAIT_PHASES, LOW_GAIT_PHASES, WALKERS
from carlaloc_env.assets.model_library import vehicle
from carlaloc_env.assets.vehicles.lit_lamps import LAMPS
from carlaloc_env.assets.vehicles.vehicle_parts import VehicleParts
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.scene.mesh import Mesh, ModelLibrary
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame

LOW_FROM_M = 30.0
"""Distance from the ego from which vehicles are drawn in few triangles and without turning wheels [m]."""
LOW_WALKER_FROM_M = 20.0
"""The same for walkers [m]."""
STEER_STEP_RAD = float(np.radians(4.0))
"""Steps in which LiDAR sees steered wheels: a tyre's edge lies within 12 mm of its true place."""
_STEER_STEPS = 10
STANDING_MPS = 0.05
"""Walkers below this speed [m/s] stand."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Families:
    """Model indices of F families of actors, and the parts of their vehicles, parallel arrays."""

    whole: Index
    """Whole vehicle, or first phase of a gait, shape (F,)."""
    body: Index
    """Vehicle without wheels; as `whole` where the library has no parts."""
    low: Index
    """Few triangles: whole vehicle, or first phase."""
    stand: Index
    low_stand: Index
    stride_m: Array
    """0 for vehicles."""
    phases: Index
    """Number of postures of pedalling, which follow `whole`, `body` and `low`; 1 for all but cycles."""
    crank_travel_m: Array
    """Distance on which cranks turn once [m]."""
    coarse: NDArray[np.bool_]
    """Whether the library holds the family in few triangles."""
    parted: NDArray[np.bool_]
    """Whether wheels and plates are drawn separately."""
    wheel_begin: Index
    """First row of each family in the wheel arrays; one more for the end, shape (F + 1,)."""
    wheel_model: Index
    wheel_centre_m: Array
    wheel_radius_m: Array
    wheel_steered: NDArray[np.bool_]
    wheel_right: NDArray[np.bool_]
    plate_begin: Index
    """As `wheel_begin`, for the plate arrays."""
    plate_model: Index
    """First of the plates of the family's tag."""
    plate_position_m: Array
    plate_facing: Array
    plate_scale: Array
    lamps: dict[str, tuple[Index, Index]]
    """Models of lit lamps by `LAMPS`, and those in few triangles, shape (F,) each; 0 where there are none."""


@lru_cache(maxsize=8)
def families(library: ModelLibrary, names: tuple[str, ...]) -> Families:
    """Tables of some families.

    Args:
        library: Models of `assets.model_library.build_library`, or any that holds the plain names.
        names: Families, keys of `ALL_VEHICLES` and `WALKERS`.

    Raises:
        ConfigError: no actor has such a name.
    """
    models = set(library.names)
    heads = [_heads(name, library, models) for name in names]
    whole, body, low, stand, low_stand = (np.array([h[k] for h in heads], dtype=np.intp) for k in range(5))
    parts = [vehicle(name) if f"{name}/body" in models else None for name in names]
    wheels = [(f, w) for f, part in enumerate(parts) if part for w in part.wheels]
    plates = [(f, p) for f, part in enumerate(parts) if part for p in part.plates]
    tags = [ALL_VEHICLES[name].tag.name if name in ALL_VEHICLES else "" for name in names]
    return Families(
        whole=whole,
        body=body,
        low=low,
        stand=stand,
        low_stand=low_stand,
        stride_m=np.array([WALKERS[name].stride_m if name in WALKERS else 0.0 for name in names]),
        phases=np.array([part.phases if part else 1 for part in parts], dtype=np.intp),
        crank_travel_m=np.array([part.crank_travel_m if part else 1.0 for part in parts]),
        coarse=low != whole,
        parted=np.array([part is not None for part in parts], dtype=bool),
        wheel_begin=_begin([f for f, _ in wheels], len(names)),
        wheel_model=np.array(
            [library.index(f"{names[f]}/wheel{_kind(parts[f], w.mesh)}") for f, w in wheels], dtype=np.intp
        ),
        wheel_centre_m=np.array([w.centre_m for _, w in wheels], dtype=np.float64).reshape(-1, 3),
        wheel_radius_m=np.array([w.radius_m for _, w in wheels]),
        wheel_steered=np.array([w.steered for _, w in wheels], dtype=bool),
        wheel_right=np.array([w.right for _, w in wheels], dtype=bool),
        plate_begin=_begin([f for f, _ in plates], len(names)),
        plate_model=np.array([library.index(f"plate/{tags[f]}/00") for f, _ in plates], dtype=np.intp),
        plate_position_m=np.array([p.position_m for _, p in plates], dtype=np.float64).reshape(-1, 3),
        plate_facing=np.array([p.facing for _, p in plates]),
        plate_scale=np.array([p.width_m / 0.52 for _, p in plates]),
        lamps={
            lamp: (_lamps(names, library, models, f"/{lamp}"), _lamps(names, library, models, f"/low/{lamp}"))
            for lamp in LAMPS
        },
    )


@lru_cache(maxsize=8)
def tables_of(catalog: ActorCatalog, library: ModelLibrary) -> tuple[Families, NDArray[np.intp]]:
    """Tables of the families that take part, and each actor's family, shape (N,)."""
    names, of_actor = np.unique(np.array(catalog.model, dtype=np.str_), return_inverse=True)
    return families(library, tuple(str(name) for name in names)), of_actor.astype(np.intp)


def far_away(
    tables: Families, family: NDArray[np.intp], frame: ActorFrame, eye_m: ArrayLike | None
) -> NDArray[np.bool_]:
    """Whether each actor is drawn in few triangles, shape (N,)."""
    if eye_m is None:
        return np.zeros(len(family), dtype=bool)
    away = frame.position_m.astype(np.float64) - np.asarray(eye_m, dtype=np.float64)
    limit = np.where(tables.stride_m[family] > 0, LOW_WALKER_FROM_M, LOW_FROM_M)
    far: NDArray[np.bool_] = (np.sum(away * away, axis=1) > limit * limit) & tables.coarse[family]
    return far


def gait(travelled_m: Array, stride_m: Array, phases: int) -> tuple[Index, Array]:
    """Posture of walkers, and how far ahead of that posture's place they are [m].

    A posture holds for a fraction of the stride. Drawn at the walker's place minus that remainder, the
    foot on the ground stays exactly where it was set down.

    Args:
        travelled_m: Distance walked [m], shape (N,).
        stride_m: Distance of a whole stride [m], shape (N,).
        phases: Number of postures of a stride.
    """
    turns = travelled_m / stride_m * phases
    nearest = np.floor(turns + 0.5)
    return nearest.astype(np.int64) % phases, (turns - nearest) * stride_m / phases


def walker_models(
    tables: Families, family: Index, travelled_m: Array, moving: NDArray[np.bool_], low: NDArray[np.bool_]
) -> tuple[Index, Array]:
    """Model of each of N walkers, and how far it stands behind the walker's place [m]."""
    stride = tables.stride_m[family]
    phase, ahead = gait(travelled_m, stride, GAIT_PHASES)
    low_phase, low_ahead = gait(travelled_m, stride, LOW_GAIT_PHASES)
    walking = np.where(low, tables.low[family] + low_phase, tables.whole[family] + phase)
    still = np.where(low, tables.low_stand[family], tables.stand[family])
    behind = np.where(moving, np.where(low, low_ahead, ahead), 0.0)
    return np.where(moving, walking, still), behind


def pedalling(tables: Families, family: Index, travelled_m: NDArray[np.floating]) -> Index:
    """Phase of pedalling of each of N actors by the distance covered; 0 for all but cycles."""
    turns = np.asarray(travelled_m, dtype=np.float64) / tables.crank_travel_m[family]
    count = tables.phases[family]
    return np.floor(turns * count + 0.5).astype(np.intp) % count


def steer_step(steer_rad: NDArray[np.floating]) -> Index:
    """Number of the stored angle nearest to the front wheels' angle, shape (N,)."""
    step = np.rint(np.asarray(steer_rad, dtype=np.float64) / STEER_STEP_RAD).astype(np.intp)
    return np.clip(step, -_STEER_STEPS, _STEER_STEPS)


def steered_mesh(library: ModelLibrary, model: int, step: int) -> Mesh:
    """A model with its front wheels turned to one of the stored angles, as LiDAR sees it."""
    name, _, phase = library.names[model].partition("/")
    whole = name in ALL_VEHICLES and (not phase or phase.isdigit())
    if step == 0 or not whole or f"{name}/body" not in library.names:
        return library.meshes[model]
    return vehicle(name).steered(step * STEER_STEP_RAD, int(phase or 0))


def _heads(name: str, library: ModelLibrary, models: set[str]) -> tuple[int, int, int, int, int]:
    """Indices of whole, body, low, standing and low standing model."""
    if name in WALKERS:
        first, stand = library.index(f"{name}/00"), library.index(f"{name}/stand")
        coarse = f"{name}/low/00" in models
        low = library.index(f"{name}/low/00") if coarse else first
        return first, first, low, stand, library.index(f"{name}/low/stand") if coarse else stand
    if name in ALL_VEHICLES:
        whole = library.index(name)
        body = library.index(f"{name}/body") if f"{name}/body" in models else whole
        low = library.index(f"{name}/low") if f"{name}/low" in models else whole
        return whole, body, low, whole, low
    raise ConfigError(unknown_name("actor model", name, (*ALL_VEHICLES, *WALKERS)))


def _lamps(names: tuple[str, ...], library: ModelLibrary, models: set[str], lamp: str) -> Index:
    """Index of a lamp's model for each family, 0 where there is none."""
    return np.array([library.index(name + lamp) if name + lamp in models else 0 for name in names], np.intp)


def _kind(parts: VehicleParts | None, mesh: Mesh) -> int:
    """Number of a wheel among a vehicle's different wheels."""
    assert parts is not None
    return list(dict.fromkeys(place.mesh for place in parts.wheels)).index(mesh)


def _begin(owner: list[int], count: int) -> Index:
    """First row of each of `count` owners in rows sorted by owner, and the end, shape (count + 1,)."""
    return np.searchsorted(np.array(owner, dtype=np.intp), np.arange(count + 1)).astype(np.intp)
