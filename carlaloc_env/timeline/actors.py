"""Actors of a drive: their catalogue, fixed for all of it, and their state at one instant."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.parallel_arrays import ParallelArrays
from carlaloc_env.core.transforms import wrap_angle

LIGHT_BRAKE, LIGHT_LEFT, LIGHT_RIGHT, LIGHT_LOW_BEAM, LIGHT_REVERSE = 1, 2, 4, 8, 16
"""Bits of `ActorFrame.lights`."""
JUMP_M = 4.0
"""Nothing moves farther within a step [m]: 80 m/s."""
_STRIDE_M = 1.0
"""Nothing turns round within a step in which it moves farther [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActorCatalog:
    """The actors of a drive: fixed for all of it, parallel arrays of N actors."""

    id: NDArray[np.uint32]
    """Instance id of each actor, unique, ≥ 2**23, shape (N,)."""
    model: tuple[str, ...]
    """Name of each actor's model family in `assets`, e.g. ``saloon`` or ``walker_man``, length N."""
    tag: NDArray[np.uint8]
    """Semantic `Tag` of each actor, shape (N,)."""
    size_m: F32
    """Length, width, height of each actor's box [m], shape (N, 3)."""
    tint: NDArray[np.uint8]
    """Linear colour 0–255, shape (N, 3)."""

    def __len__(self) -> int:
        return len(self.id)

    def take(self, index: NDArray[np.intp]) -> ActorCatalog:
        """Catalogue of some of the actors."""
        return ActorCatalog(
            id=self.id[index],
            model=tuple(self.model[i] for i in index),
            tag=self.tag[index],
            size_m=self.size_m[index],
            tint=self.tint[index],
        )


def empty_catalog() -> ActorCatalog:
    """Catalogue without actors."""
    return ActorCatalog(
        id=np.zeros(0, np.uint32),
        model=(),
        tag=np.zeros(0, np.uint8),
        size_m=np.zeros((0, 3), np.float32),
        tint=np.zeros((0, 3), np.uint8),
    )


def came_in_elsewhere(change_m: ArrayLike, turn_rad: ArrayLike) -> NDArray[np.bool_]:
    """Whether actors left the map within a step and came in elsewhere, with no place in between.

    Args:
        change_m: Change of position [m], shape (..., 3).
        turn_rad: Change of heading [rad], shape (...).
    """
    far_m = np.abs(change_m).max(axis=-1, initial=0.0)
    if not (far_m > _STRIDE_M).any():
        return np.zeros(far_m.shape, dtype=np.bool_)
    back = np.abs(wrap_angle(np.asarray(turn_rad, dtype=np.float64))) > 0.5 * np.pi
    jumped: NDArray[np.bool_] = (far_m > JUMP_M) | ((far_m > _STRIDE_M) & back)
    return jumped


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActorFrame(ParallelArrays):
    """State of all N actors at one instant, float32 so that live and recorded values are equal."""

    position_m: F32
    """Centre of each actor's box on the ground [m], world, shape (N, 3)."""
    heading_rad: F32
    """Direction the actor faces, anticlockwise from east [rad], shape (N,)."""
    pitch_rad: F32
    """Slope of the ground along the heading, nose up positive [rad], shape (N,)."""
    speed_mps: F32
    """Forward speed [m/s], shape (N,)."""
    travelled_m: F32
    """Distance covered since the drive began [m]; drives wheels and gait, shape (N,)."""
    steer_rad: F32
    """Angle of the front wheels, left positive [rad], shape (N,)."""
    lights: NDArray[np.uint8]
    """Bits of lit vehicle lights (`LIGHT_BRAKE` …), shape (N,)."""
    roll_rad: F32 = field(default_factory=lambda: np.zeros(0, np.float32))
    """Lean of the ground about the actor's long axis, left side up positive [rad], shape (N,); level when
    left out."""

    def __post_init__(self) -> None:
        if not len(self.roll_rad):
            object.__setattr__(self, "roll_rad", np.zeros_like(self.heading_rad))

    def __len__(self) -> int:
        return len(self.heading_rad)


def empty_frame() -> ActorFrame:
    """State without actors."""
    zero = np.zeros(0, np.float32)
    return ActorFrame(
        position_m=np.zeros((0, 3), np.float32),
        heading_rad=zero,
        pitch_rad=zero,
        speed_mps=zero,
        travelled_m=zero,
        steer_rad=zero,
        lights=np.zeros(0, np.uint8),
    )


def joined_catalogs(first: ActorCatalog, second: ActorCatalog) -> ActorCatalog:
    """Actors of one catalogue, then those of another."""
    arrays = {n: (getattr(first, n), getattr(second, n)) for n in ActorCatalog.__slots__ if n != "model"}
    return ActorCatalog(
        model=first.model + second.model, **{n: np.concatenate(pair) for n, pair in arrays.items()}
    )
