"""Where models stand, which ones and with what lamps, against an independent calculation."""

import math

import numpy as np
import pytest
from shared_fixtures.worlds.meshes import model
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.actors.instances import ground_poses, place_actors, place_ego, place_lights, place_signals
from carlaloc_env.assets.catalog import GAIT_PHASES, VEHICLES, WALKERS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.scene.mesh import EGO_INSTANCE, ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.timeline.actors import (
    LIGHT_BRAKE,
    LIGHT_LEFT,
    ActorCatalog,
    ActorFrame,
)


def actors() -> tuple[ActorCatalog, ActorFrame]:
    rng = np.random.default_rng(4)
    names = ("saloon", "walker_man", "bus", "walker_child", "walker_woman", "bicycle")
    count = len(names)
    catalog = Scenery.catalog(names, [14, 12, 16, 12, 12, 19], tint=rng.integers(0, 255, (count, 3)))
    frame = Scenery.frame(
        rng.normal(0, 50, (count, 3)),
        heading_rad=rng.uniform(-3, 3, count),
        pitch_rad=rng.uniform(-0.1, 0.1, count),
        roll_rad=np.linspace(-0.1, 0.1, count),
        speed_mps=[9, 1.4, 0, 0, 1.2, 4],
        travelled_m=[100, 37.3, 5, 3, 12.9, 8],
        lights=[LIGHT_BRAKE | LIGHT_LEFT, 0, LIGHT_LEFT, 0, 0, LIGHT_BRAKE],
    )
    return catalog, frame


def test_placing_equals_a_calculation_by_hand(library: ModelLibrary) -> None:
    catalog, frame = actors()
    placed = place_actors(catalog, frame, library)
    for k, name in enumerate(catalog.model):
        walker = name in WALKERS
        yaw, pitch = float(frame.heading_rad[k]), 0.0 if walker else float(frame.pitch_rad[k])
        nose = (math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch))
        roll = 0.0 if walker else float(frame.roll_rad[k])
        level, up = np.array([-math.sin(yaw), math.cos(yaw), 0.0]), np.array([0.0, 0.0, 1.0])
        # Left of the nose and as high as the roll says.
        left = math.cos(roll) * level + math.sin(roll) * np.cross(nose, level)
        assert walker or left @ up == pytest.approx(math.sin(roll) * math.cos(pitch))
        T = placed.T_world_model[k]
        np.testing.assert_allclose(T[:3, 0], nose, atol=1e-12)
        np.testing.assert_allclose(T[:3, 1], left, atol=1e-12)
        np.testing.assert_allclose(T[:3, 2], np.cross(nose, left), atol=1e-12)
        behind = 0.0
        if walker and frame.speed_mps[k] > 0:
            step = WALKERS[name].stride_m / GAIT_PHASES
            behind = math.remainder(float(frame.travelled_m[k]), step)
        place = frame.position_m[k] - behind * np.array([math.cos(yaw), math.sin(yaw), 0.0])
        np.testing.assert_allclose(T[:3, 3], place, atol=1e-5)
        if name == "bicycle":
            # 8 m are 1.6 turns of cranks that turn once in 5 m: 14.4 of 24 phases.
            wanted = "bicycle/14"
        elif not walker:
            wanted = name
        elif frame.speed_mps[k] == 0:
            wanted = f"{name}/stand"
        else:
            turns = float(frame.travelled_m[k]) / WALKERS[name].stride_m
            wanted = f"{name}/{round(turns * GAIT_PHASES) % GAIT_PHASES:02d}"
        assert library.names[placed.model[k]] == wanted
    assert np.array_equal(placed.instance, catalog.id)
    assert np.array_equal(placed.tint, catalog.tint)


def near_far(count: int) -> tuple[ActorCatalog, ActorFrame]:
    """One of each vehicle and walker in a row, the first half near the origin, the others far off."""
    names = tuple(n for n in (*VEHICLES, *WALKERS) for _ in range(count))
    tags = [int(VEHICLES[n].tag) if n in VEHICLES else int(Tag.PEDESTRIAN) for n in names]
    many = len(names)
    away = np.where(np.arange(many) % 2 == 0, 5.0, 80.0)
    frame = Scenery.frame(
        np.stack([away, 0 * away, 0 * away], axis=1),
        heading_rad=np.linspace(-3, 3, many),
        pitch_rad=np.linspace(-0.1, 0.1, many),
        speed_mps=1.0,
        travelled_m=np.linspace(0, 40, many),
        steer_rad=np.linspace(-0.5, 0.5, many),
        lights=LIGHT_BRAKE,
    )
    return Scenery.catalog(names, tags), frame


def test_detail_and_parts_go_by_distance(library: ModelLibrary) -> None:
    """Near vehicles come with wheels and plates, far ones as one coarse model; every actor comes once."""
    catalog, frame = near_far(2)
    placed = place_actors(catalog, frame, library, eye_m=(0.0, 0.0, 0.0))
    names = [library.names[m] for m in placed.model]
    count = len(catalog)
    for k, (name, drawn) in enumerate(zip(catalog.model, names[:count], strict=True)):
        far = frame.position_m[k, 0] > 50.0
        assert drawn.startswith(f"{name}/low" if far else f"{name}/")
        assert ("/low" in drawn) == far
        own = [n for n, i in zip(names[count:], placed.instance[count:], strict=True) if i == catalog.id[k]]
        wheels = sum("wheel" in n for n in own)
        assert wheels == (0 if far or name in WALKERS else 2 if "cycle" in name else 4)
        assert sum(n.startswith("plate/") for n in own) == (0 if far else PLATES_OF.get(name, 0))
    lit = place_lights(catalog, frame, library, 0, eye_m=(0.0, 0.0, 0.0))
    assert sum("/low/" in library.names[m] for m in lit.model) == len(VEHICLES)


PLATES_OF = {name: 0 if name == "bicycle" else 1 if name == "motorcycle" else 2 for name in VEHICLES}


def test_wheels_roll_without_slipping_and_steer(library: ModelLibrary) -> None:
    """The tyre's point on the ground stands still: it moves back by dx in the car's frame."""
    catalog, _ = near_far(1)
    k = catalog.model.index("saloon")
    one = catalog.take(np.array([k]))
    radius, dx, steer = 0.33, 0.002, 0.3

    def wheels(travelled_m: float, steer_rad: float) -> list[np.ndarray]:
        moved = Scenery.frame(np.zeros((1, 3)), speed_mps=1.0, travelled_m=travelled_m, steer_rad=steer_rad)
        placed = place_actors(one, moved, library, eye_m=np.zeros(3))
        return [
            T for T, m in zip(placed.T_world_model, placed.model, strict=True) if "wheel" in library.names[m]
        ]

    for before, after in zip(wheels(0.0, 0.0), wheels(dx, 0.0), strict=True):
        np.testing.assert_allclose(before[2, 3], radius, atol=1e-6)
        # The point that touched the ground, carried along by the wheel.
        foot = np.linalg.inv(before) @ (*before[:2, 3], 0.0, 1.0)
        np.testing.assert_allclose((after @ foot)[:3] - (*before[:2, 3], 0.0), [-dx, 0, 0], atol=1e-5)
    axle = [T[:3, 1] * np.sign(T[1, 1]) for T in wheels(1.7, steer)]
    for T, y in zip(wheels(1.7, steer), axle, strict=True):
        turned = steer if T[0, 3] > 0 else 0.0
        np.testing.assert_allclose(y, [-math.sin(turned), math.cos(turned), 0.0], atol=1e-6)


def test_placing_an_empty_world_gives_nothing(library: ModelLibrary) -> None:
    catalog, frame = actors()
    none = np.zeros(0, np.intp)
    assert len(place_actors(catalog.take(none), frame.take(none), library)) == 0
    assert len(place_lights(catalog.take(none), frame.take(none), library, 0)) == 0
    assert len(place_signals(SignalLenses(), np.zeros(0, np.uint8), library)) == 0


def test_placing_names_the_nearest_model(library: ModelLibrary) -> None:
    _, frame = actors()
    bad = Scenery.catalog(["salon"])
    with pytest.raises(ConfigError, match="did you mean 'saloon'"):
        place_actors(bad, frame.take(np.arange(1)), library)


def test_nose_up_is_nose_up() -> None:
    T = ground_poses(np.zeros((1, 3)), np.array([0.5]), np.array([0.1]))[0]
    assert T[2, 0] > 0
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_lit_lamps_follow_brake_and_blinker(library: ModelLibrary) -> None:
    catalog, frame = actors()
    first = place_lights(catalog, frame, library, 0)
    assert sorted(library.names[m] for m in first.model) == [
        "bicycle/brake",
        "bus/left",
        "saloon/brake",
        "saloon/left",
    ]
    dark = place_lights(catalog, frame, library, 400_000_000)
    assert sorted(library.names[m] for m in dark.model) == ["bicycle/brake", "saloon/brake"]
    left = model(library, "saloon/left")
    assert left.vertices_m[:, 1].min() > 0
    assert model(library, "saloon/brake").vertices_m[:, 0].max() < -1.0


def test_signals_light_the_lens_of_their_state(library: ModelLibrary) -> None:
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.arange(6)
    lenses = SignalLenses(
        signal=np.array([0, 0, 0, 1, 1, 1], np.int32),
        state=np.array([1, 2, 3, 1, 2, 3], np.uint8),
        T_world_lens=poses,
    )
    lit = place_signals(lenses, np.array([3, 1], np.uint8), library)
    assert [library.names[m] for m in lit.model] == ["signal_green", "signal_red"]
    assert lit.T_world_model[:, 0, 3].tolist() == [2.0, 3.0]
    assert len(place_signals(lenses, np.array([0, 0], np.uint8), library)) == 0
    assert model(library, "signal_red").normals[:, 0].min() > 0.99


def test_ego_is_placed_with_its_own_id(library: ModelLibrary) -> None:
    T = np.eye(4)
    T[:3, 3] = 1, 2, 3
    placed = place_ego(T, library)
    assert placed.instance.tolist() == [EGO_INSTANCE]
    assert library.names[placed.model[0]] == "ego"
    assert np.array_equal(placed.T_world_model[0], T)
