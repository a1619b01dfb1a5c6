"""Shapes of actors for rays: the ones that cameras see, at the time of each ray."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.actors.articulation import STANDING_MPS, far_away, steer_step, tables_of, walker_models
from carlaloc_env.scene.mesh import ModelLibrary
from carlaloc_env.timeline.timeline import Snapshot


def ray_models(
    library: ModelLibrary, snapshot: Snapshot, eye_m: ArrayLike
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """Models that rays meet: the shapes that `place_actors` gives cameras.

    Args:
        library: Models of `assets.model_library.build_library`.
        snapshot: State of all actors.
        eye_m: Where the rays come from [m], shape (3,).

    Returns:
        Model of each actor, the step of its front wheels' angle (`articulation.steered_mesh`), and
        whether it walks, so that its posture changes while a sensor sweeps; each of shape (N,).
    """
    frame = snapshot.actors
    tables, family = tables_of(snapshot.catalog, library)
    low = far_away(tables, family, frame, eye_m)
    walks = tables.stride_m[family] > 0
    model = np.where(low, tables.low[family], tables.whole[family])
    step = np.where(low | walks, 0, steer_step(frame.steer_rad))
    moving = walks & (np.abs(frame.speed_mps) >= STANDING_MPS)
    model = np.where(walks & ~moving, np.where(low, tables.low_stand[family], tables.stand[family]), model)
    return model, step, moving


def ray_postures(
    library: ModelLibrary,
    snapshot: Snapshot,
    eye_m: ArrayLike,
    actor: NDArray[np.intp],
    since_s: NDArray[np.float64],
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Postures of walkers at other times than the snapshot's.

    Args:
        library: Models of `assets.model_library.build_library`.
        snapshot: State of all actors at one time.
        eye_m: Where the rays come from [m], shape (3,).
        actor: Walkers, shape (M,).
        since_s: Time since the snapshot of each [s], shape (M,).

    Returns:
        Model of each, shape (M,), and how far it stands behind the walker's place [m], shape (M,).
    """
    frame = snapshot.actors
    tables, family = tables_of(snapshot.catalog, library)
    low = far_away(tables, family, frame, eye_m)
    travelled = frame.travelled_m[actor].astype(np.float64) + frame.speed_mps[actor] * since_s
    return walker_models(tables, family[actor], travelled, np.ones(len(actor), bool), low[actor])
