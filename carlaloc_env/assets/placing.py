"""Where the movable models stand: from the state of actors, signals and ego to `Instances`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.assets.catalog import EGO_TINT, GAIT_PHASES, VEHICLES, WALKERS
from carlaloc_env.errors import ConfigError, unknown_name
from carlaloc_env.scene import EGO_INSTANCE, Instances, ModelLibrary
from carlaloc_env.semantics import Tag
from carlaloc_env.timeline import LIGHT_BRAKE, LIGHT_LEFT, LIGHT_RIGHT, ActorCatalog, ActorFrame

_BLINK_NS = 666_666_666
"""Period of the indicators [ns]."""
_STANDING_MPS = 0.05
"""Walkers below this speed [m/s] stand."""
_LIT = ("signal_red", "signal_yellow", "signal_green")
"""Model of a lit lens for the signal states 1, 2, 3."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalLenses:
    """Lens discs of all traffic-light heads of a town, parallel arrays of L lenses."""

    signal: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Index of the signal whose state lights the lens, shape (L,)."""
    state: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    """State in which the lens is lit (1 red, 2 yellow, 3 green), shape (L,)."""
    T_world_lens: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """Pose of each lens, x out of it, shape (L, 4, 4)."""
    instance: NDArray[np.uint32] | None = None
    """Instance id of each lens' traffic light, shape (L,); none when left out."""

    def __len__(self) -> int:
        return len(self.signal)


def place_actors(catalog: ActorCatalog, frame: ActorFrame, library: ModelLibrary) -> Instances:
    """One instance per actor, in the catalogue's order.

    Vehicles follow heading and pitch; walkers stay upright, and the distance they walked chooses
    the phase of their gait.

    Args:
        catalog: Who takes part.
        frame: Their state.
        library: Models of `assets.library.build_library`.

    Raises:
        ConfigError: the catalogue names a model that does not exist.
    """
    family, of_actor = np.unique(np.array(catalog.model, dtype=np.str_), return_inverse=True)
    first, stand, stride = (
        (np.array(column) for column in zip(*(_family(str(name), library) for name in family), strict=True))
        if len(family)
        else (np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0))
    )
    first, stand, stride = first[of_actor], stand[of_actor], stride[of_actor]
    walks = stride > 0
    turns = frame.travelled_m.astype(np.float64) / np.where(walks, stride, 1.0)
    phase = np.floor(turns * GAIT_PHASES + 0.5).astype(np.int64) % GAIT_PHASES
    moving = np.abs(frame.speed_mps) >= _STANDING_MPS
    model = np.where(walks, np.where(moving, first + phase, stand), first)
    pitch = np.where(walks, 0.0, frame.pitch_rad)
    return Instances(
        model=model.astype(np.int32),
        T_world_model=ground_poses(frame.position_m, frame.heading_rad, pitch),
        instance=catalog.id,
        tint=catalog.tint,
    )


def place_lights(catalog: ActorCatalog, frame: ActorFrame, library: ModelLibrary, stamp_ns: int) -> Instances:
    """Lit brake lamps and indicators of vehicles, to be drawn over their bodies by cameras.

    Args:
        catalog: Who takes part.
        frame: Their state.
        library: Models of `assets.library.build_library`.
        stamp_ns: Time [ns]; indicators blink with it.
    """
    blink = (stamp_ns % _BLINK_NS) * 2 < _BLINK_NS
    lit = {
        "brake": frame.lights & LIGHT_BRAKE,
        "left": frame.lights & LIGHT_LEFT,
        "right": frame.lights & LIGHT_RIGHT,
    }
    actor: list[NDArray[np.intp]] = []
    model: list[NDArray[np.int32]] = []
    for lamp, bits in lit.items():
        if lamp != "brake" and not blink:
            continue
        chosen = np.flatnonzero((bits > 0) & (catalog.tag != Tag.PEDESTRIAN))
        names = np.array(catalog.model, dtype=np.str_)[chosen] if len(chosen) else np.zeros(0, np.str_)
        family, of_actor = np.unique(names, return_inverse=True)
        index = np.array([library.index(f"{name}/{lamp}") for name in family], dtype=np.int32)
        actor.append(chosen)
        model.append(index[of_actor] if len(chosen) else np.zeros(0, np.int32))
    who = np.concatenate(actor)
    return Instances(
        model=np.concatenate(model).astype(np.int32),
        T_world_model=ground_poses(frame.position_m[who], frame.heading_rad[who], frame.pitch_rad[who]),
        instance=catalog.id[who],
        tint=np.full((len(who), 3), 255, np.uint8),
    )


def place_signals(lenses: SignalLenses, states: NDArray[np.uint8], library: ModelLibrary) -> Instances:
    """Lit lenses of all traffic lights.

    Args:
        lenses: Lenses of the town.
        states: State of every signal (0 off, 1 red, 2 yellow, 3 green), shape (S,).
        library: Models of `assets.library.build_library`.
    """
    lit = np.flatnonzero((states[lenses.signal] == lenses.state) & (lenses.state > 0))
    models = np.array([library.index(name) for name in _LIT], dtype=np.int32)
    return Instances(
        model=models[lenses.state[lit].astype(np.int64) - 1],
        T_world_model=lenses.T_world_lens[lit],
        instance=np.zeros(len(lit), np.uint32) if lenses.instance is None else lenses.instance[lit],
        tint=np.full((len(lit), 3), 255, np.uint8),
    )


def place_ego(T_world_base: ArrayLike, library: ModelLibrary) -> Instances:
    """The ego's own body at its `base_link` pose (4, 4)."""
    return Instances(
        model=np.array([library.index("ego")], dtype=np.int32),
        T_world_model=np.asarray(T_world_base, dtype=np.float64).reshape(1, 4, 4).copy(),
        instance=np.array([EGO_INSTANCE], dtype=np.uint32),
        tint=np.array([EGO_TINT], dtype=np.uint8),
    )


def ground_poses(position_m: ArrayLike, heading_rad: ArrayLike, pitch_rad: ArrayLike) -> NDArray[np.float64]:
    """Transforms (N, 4, 4) of things at a position [m], facing a heading, nose up by a pitch [rad]."""
    p = np.asarray(position_m, dtype=np.float64)
    heading, pitch = np.asarray(heading_rad, dtype=np.float64), np.asarray(pitch_rad, dtype=np.float64)
    c, s, cp, sp = np.cos(heading), np.sin(heading), np.cos(pitch), np.sin(pitch)
    T = np.zeros((len(p), 4, 4))
    T[:, 0, 0], T[:, 0, 1], T[:, 0, 2] = c * cp, -s, -c * sp
    T[:, 1, 0], T[:, 1, 1], T[:, 1, 2] = s * cp, c, -s * sp
    T[:, 2, 0], T[:, 2, 2] = sp, cp
    T[:, :3, 3] = p
    T[:, 3, 3] = 1.0
    return T


def _family(name: str, library: ModelLibrary) -> tuple[int, int, float]:
    """First model, standing model and stride [m] of a family; stride 0 for vehicles."""
    if name in WALKERS:
        return library.index(f"{name}/00"), library.index(f"{name}/stand"), WALKERS[name].stride_m
    if name in VEHICLES:
        return library.index(name), library.index(name), 0.0
    raise ConfigError(unknown_name("actor model", name, (*VEHICLES, *WALKERS)))
