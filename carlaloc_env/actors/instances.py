"""Placing of movable models: from the state of actors, signals and ego to `Instances`.

Shapes of actors for rays: the ones that cameras see, at the time of each ray.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.actors.articulation import (
    STANDING_MPS,
    Families,
    far_away,
    pedalling,
    steer_step,
    tables_of,
    walker_models,
)
from carlaloc_env.assets.catalog import EGO_TINT
from carlaloc_env.assets.number_plates import plate_of
from carlaloc_env.assets.vehicles.wheels import wheel_pose
from carlaloc_env.core import elementary
from carlaloc_env.scene.mesh import EGO_INSTANCE, Instances, ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.timeline.actors import (
    LIGHT_BRAKE,
    LIGHT_LEFT,
    LIGHT_REVERSE,
    LIGHT_RIGHT,
    ActorCatalog,
    ActorFrame,
)
from carlaloc_env.timeline.snapshot import Snapshot, is_blink

UNLIT_EGO_INSTANCE = (1 << 24) - 1
"""Instance id of an ego with its headlamps off: the renderer gives low beams to the ego's own id."""
_EGO_LAMPS = {"brake": LIGHT_BRAKE, "left": LIGHT_LEFT, "right": LIGHT_RIGHT, "reverse": LIGHT_REVERSE}
_LIT = ("signal_red", "signal_yellow", "signal_green")
"""Model of a lit lens for the signal states 1, 2, 3."""


def instances_at(library: ModelLibrary, lenses: SignalLenses, snapshot: Snapshot) -> Instances:
    """Everything that moves or shines at one instant: ego, actors, their lit lamps, lit signal lenses.

    Args:
        library: Models of `assets.model_library.build_library`.
        lenses: Lenses of the town.
        snapshot: The instant.

    Raises:
        ConfigError: the catalogue names a model that does not exist.
    """
    catalog, actors = snapshot.catalog, snapshot.actors
    ego = place_ego(snapshot.T_world_base, library, snapshot.ego_lights)
    if not snapshot.ego_headlamps:
        ego = replace(ego, instance=np.full(len(ego), UNLIT_EGO_INSTANCE, np.uint32))
    # The ego's place decides the detail, so that both eyes see the same shapes.
    eye_m = snapshot.T_world_base[:3, 3]
    return Instances.joined(
        [
            ego,
            place_actors(catalog, actors, library, eye_m=eye_m),
            place_lights(catalog, actors, library, snapshot.stamp_ns, eye_m=eye_m),
            place_signals(lenses, snapshot.signals, library),
        ]
    )


def place_actors(
    catalog: ActorCatalog, frame: ActorFrame, library: ModelLibrary, *, eye_m: ArrayLike | None = None
) -> Instances:
    """Actors as models, in the catalogue's order, then wheels and number plates of the near ones.

    Vehicles follow heading, pitch and roll; their wheels steer, and the distance covered turns wheels and
    cranks. Walkers stay upright, and the distance they walked chooses the phase of
    their gait; they stand up to half a phase behind their place, so that the foot on the ground
    does not slide.

    Args:
        catalog: The actors of the drive.
        frame: Their state.
        library: Models of `assets.model_library.build_library`.
        eye_m: Where one looks from [m], shape (3,): actors far from it are drawn in few triangles.
            Without it every actor is one whole model with its wheels straight.

    Raises:
        ConfigError: the catalogue names a model that does not exist.
    """
    if not len(catalog):
        return Instances()
    tables, family = tables_of(catalog, library)
    low = far_away(tables, family, frame, eye_m)
    walks = tables.stride_m[family] > 0
    vehicle = tables.whole if eye_m is None else tables.body
    model = np.where(low, tables.low[family], vehicle[family])
    model += pedalling(tables, family, frame.travelled_m)
    position = frame.position_m.astype(np.float64)
    who = np.flatnonzero(walks)
    if len(who):
        model[who], behind = walker_models(
            tables,
            family[who],
            frame.travelled_m[who].astype(np.float64),
            np.abs(frame.speed_mps[who]) >= STANDING_MPS,
            low[who],
        )
        heading = frame.heading_rad[who].astype(np.float64)
        position[who, 0] -= behind * elementary.cos(heading)
        position[who, 1] -= behind * elementary.sin(heading)
    placed = Instances(
        model=model.astype(np.int32),
        T_world_model=ground_poses(
            position,
            frame.heading_rad,
            np.where(walks, 0.0, frame.pitch_rad),
            np.where(walks, 0.0, frame.roll_rad),
        ),
        instance=catalog.id,
        tint=catalog.tint,
    )
    if eye_m is None:
        return placed
    near = np.flatnonzero(~low & tables.parted[family])
    parts = [_wheels(tables, family, frame, placed, near), _plates(tables, family, placed, near)]
    return Instances.joined([placed, *parts])


def place_lights(
    catalog: ActorCatalog,
    frame: ActorFrame,
    library: ModelLibrary,
    stamp_ns: int,
    *,
    eye_m: ArrayLike | None = None,
) -> Instances:
    """Lit brake lamps, indicators and, backwards, reversing lamps, to be drawn over vehicles by cameras.

    Args:
        catalog: The actors of the drive.
        frame: Their state.
        library: Models of `assets.model_library.build_library`.
        stamp_ns: Time [ns]; indicators blink with it.
        eye_m: As for `place_actors`.
    """
    blink = is_blink(stamp_ns)
    bits = {"brake": LIGHT_BRAKE, "left": LIGHT_LEFT if blink else 0, "right": LIGHT_RIGHT if blink else 0,
            "reverse": LIGHT_REVERSE}  # fmt: skip
    shown = frame.lights | np.where(frame.speed_mps < -STANDING_MPS, LIGHT_REVERSE, 0).astype(np.uint8)
    actor, model = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)]
    if not len(catalog):
        return Instances()
    tables, family = tables_of(catalog, library)
    low = far_away(tables, family, frame, eye_m)
    for lamp, bit in bits.items():
        who = np.flatnonzero(((shown & bit) > 0) & (catalog.tag != Tag.PEDESTRIAN))
        if not len(who):
            continue
        near, far = tables.lamps[lamp]
        actor.append(who)
        model.append(np.where(low[who], far[family[who]], near[family[who]]))
    who = np.concatenate(actor)
    return Instances(
        model=np.concatenate(model).astype(np.int32),
        T_world_model=ground_poses(
            frame.position_m[who], frame.heading_rad[who], frame.pitch_rad[who], frame.roll_rad[who]
        ),
        instance=catalog.id[who],
        tint=np.full((len(who), 3), 255, np.uint8),
    )


def place_signals(lenses: SignalLenses, states: NDArray[np.uint8], library: ModelLibrary) -> Instances:
    """Lit lenses of all traffic lights.

    Args:
        lenses: Lenses of the town.
        states: State of every signal (0 off, 1 red, 2 yellow, 3 green), shape (S,).
        library: Models of `assets.model_library.build_library`.
    """
    lit = np.flatnonzero((states[lenses.signal] == lenses.state) & (lenses.state > 0))
    models = np.array([library.index(name) for name in _LIT], dtype=np.int32)
    return Instances(
        model=models[lenses.state[lit].astype(np.int64) - 1],
        T_world_model=lenses.T_world_lens[lit],
        instance=np.zeros(len(lit), np.uint32) if lenses.instance is None else lenses.instance[lit],
        tint=np.full((len(lit), 3), 255, np.uint8),
    )


def place_ego(T_world_base: ArrayLike, library: ModelLibrary, lights: int = 0) -> Instances:
    """The ego's own body at its `base_link` pose (4, 4), with its lit lamps; nothing of a library without it.

    Args:
        T_world_base: Pose of the ego.
        library: Models of `assets.model_library.build_library`.
        lights: Bits of lit lights (`LIGHT_BRAKE` …), as `Snapshot.ego_lights` holds them.
    """
    names = ["ego", *(f"ego/{lamp}" for lamp, bit in _EGO_LAMPS.items() if lights & bit)]
    if "ego" not in library.names:
        names = []
    T = np.asarray(T_world_base, dtype=np.float64).reshape(1, 4, 4)
    return Instances(
        model=np.array([library.index(name) for name in names], dtype=np.int32),
        T_world_model=np.repeat(T, len(names), axis=0),
        instance=np.full(len(names), EGO_INSTANCE, dtype=np.uint32),
        tint=np.array([EGO_TINT] * len(names), dtype=np.uint8).reshape(-1, 3),
    )


def ground_poses(
    position_m: ArrayLike, heading_rad: ArrayLike, pitch_rad: ArrayLike, roll_rad: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """Transforms (N, 4, 4) of things at a position [m]: Rz(heading)·Ry(−pitch)·Rx(roll).

    Nose up and left side up are positive [rad].
    """
    p = np.asarray(position_m, dtype=np.float64)
    heading, pitch, roll = (np.asarray(a, dtype=np.float64) for a in (heading_rad, pitch_rad, roll_rad))
    c, s, cp, sp, cr, sr = (
        f(angle) for angle in (heading, pitch, roll) for f in (elementary.cos, elementary.sin)
    )
    T = np.zeros((len(p), 4, 4))
    T[:, 0, 0], T[:, 0, 1], T[:, 0, 2] = c * cp, -s * cr - c * sp * sr, s * sr - c * sp * cr
    T[:, 1, 0], T[:, 1, 1], T[:, 1, 2] = s * cp, c * cr - s * sp * sr, -c * sr - s * sp * cr
    T[:, 2, 0], T[:, 2, 1], T[:, 2, 2] = sp, cp * sr, cp * cr
    T[:, :3, 3] = p
    T[:, 3, 3] = 1.0
    return T


def _rows(
    begin: NDArray[np.intp], family: NDArray[np.intp], who: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Actor and table row of every part of some actors, grouped by actor."""
    first, count = begin[family[who]], begin[family[who] + 1] - begin[family[who]]
    actor = np.repeat(who, count)
    start = np.cumsum(count) - count
    return actor, np.repeat(first - start, count) + np.arange(len(actor))


def _wheels(
    tables: Families, family: NDArray[np.intp], frame: ActorFrame, placed: Instances, who: NDArray[np.intp]
) -> Instances:
    """Wheels of some vehicles, rolled and steered."""
    actor, row = _rows(tables.wheel_begin, family, who)
    turn = frame.travelled_m[actor].astype(np.float64) / tables.wheel_radius_m[row]
    steer = frame.steer_rad[actor].astype(np.float64) * tables.wheel_steered[row]
    local = wheel_pose(tables.wheel_centre_m[row], tables.wheel_right[row], steer, turn)
    return _parts(placed, actor, tables.wheel_model[row], local)


def _plates(
    tables: Families, family: NDArray[np.intp], placed: Instances, who: NDArray[np.intp]
) -> Instances:
    """Number plates of some vehicles; the actor's id chooses what they read."""
    actor, row = _rows(tables.plate_begin, family, who)
    local = np.zeros((len(row), 4, 4))
    facing, scale = tables.plate_facing[row], tables.plate_scale[row]
    local[:, 0, 0] = local[:, 1, 1] = facing * scale
    local[:, 2, 2], local[:, 3, 3] = scale, 1.0
    local[:, :3, 3] = tables.plate_position_m[row]
    return _parts(placed, actor, tables.plate_model[row] + plate_of(placed.instance[actor]), local)


def _parts(
    placed: Instances, actor: NDArray[np.intp], model: NDArray[np.intp], local: NDArray[np.float64]
) -> Instances:
    """Parts of placed actors by their poses in the actors' frames, shape (M, 4, 4)."""
    T = placed.T_world_model[actor]
    return Instances(
        model=model.astype(np.int32),
        # Written out without BLAS, so that the poses have the same bits on every machine.
        T_world_model=np.sum(T[:, :, :, None] * local[:, None, :, :], axis=2),
        instance=placed.instance[actor],
        tint=placed.tint[actor],
    )


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
