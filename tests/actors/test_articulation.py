"""What moves and shines on actors by their motion: pedals, reversing lamps, the ego's own lamps."""

from dataclasses import replace

import numpy as np
from shared_fixtures.worlds.meshes import model
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.actors.instances import place_actors, place_ego, place_lights
from carlaloc_env.assets.catalog import VEHICLES, WALKERS
from carlaloc_env.assets.vehicles.cycles import CRANK_TRAVEL_M, PEDAL_PHASES
from carlaloc_env.assets.walkers.gait import SHANK, THIGH
from carlaloc_env.assets.walkers.pedalling import FOOT_M, pedal_at, push_pedals
from carlaloc_env.assets.walkers.skeleton import Joints
from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.ego import Controls
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.actors import (
    LIGHT_BRAKE,
    LIGHT_REVERSE,
    ActorCatalog,
    ActorFrame,
)
from carlaloc_env.timeline.snapshot import ego_lights
from carlaloc_env.timeline.vehicle_track import CarTrack


def actors(*names: str) -> tuple[ActorCatalog, ActorFrame]:
    """Some actors who stand at the origin."""
    families = [VEHICLES.get(name) for name in names]
    tags = [Tag.PEDESTRIAN if f is None else f.tag for f in families]
    assert all(f is not None or name in WALKERS for f, name in zip(families, names, strict=True))
    return Scenery.catalog(names, tags), Scenery.frame(np.zeros((len(names), 3)))


def test_reversing_lamps_are_lit_backwards(library: ModelLibrary) -> None:
    """By the light's bit or by the speed; white, at the tail, and no more than that on all cars."""
    catalog, frame = actors("saloon", "bus", "walker_man")

    def lit(**changes: list[float]) -> list[str]:
        moved = replace(frame, **{k: np.array(v, getattr(frame, k).dtype) for k, v in changes.items()})
        return [library.names[m] for m in place_lights(catalog, moved, library, 0).model]

    assert lit(speed_mps=[3.0, 0.0, -1.0]) == []
    assert lit(speed_mps=[-1.0, 0.0, 0.0]) == ["saloon/reverse"]
    assert lit(lights=[0, LIGHT_REVERSE, LIGHT_REVERSE]) == ["bus/reverse"]
    for name, vehicle in VEHICLES.items():
        lamp = model(library, f"{name}/reverse")
        cycle = vehicle.tag in (Tag.BICYCLE, Tag.MOTORCYCLE)
        assert (len(lamp.triangles) == 0) == cycle
        if not cycle:
            assert lamp.vertices_m[:, 0].max() < -0.35 * vehicle.size_m[0]
            assert set(lamp.material.tolist()) == {Material.LAMP_WHITE}


def test_the_ego_shows_its_pedals_and_its_gear(library: ModelLibrary) -> None:
    car = CarTrack()
    assert ego_lights(car, 0) == 0
    for controls in (Controls(), Controls(brake=0.5), Controls(throttle=0.3, reverse=True)):
        car.append((0.0, 0.0, 0.0, 0.0), 0.0, controls)
    shown = [ego_lights(car, k * TICK_NS) for k in range(3)]
    assert shown == [0, LIGHT_BRAKE, LIGHT_REVERSE]
    placed = place_ego(np.eye(4), library, LIGHT_BRAKE | LIGHT_REVERSE)
    assert [library.names[m] for m in placed.model] == ["ego", "ego/brake", "ego/reverse"]
    assert set(placed.instance.tolist()) == {EGO_INSTANCE}
    assert model(library, "ego/reverse").vertices_m[:, 0].max() < -0.6


def test_cyclists_pedal_as_far_as_they_ride(library: ModelLibrary) -> None:
    """One turn of the cranks per 5 m; feet stay on the pedals, legs keep their length, hands their grips."""
    catalog, frame = actors("bicycle")
    names = []
    for way in np.arange(0.0, CRANK_TRAVEL_M, CRANK_TRAVEL_M / PEDAL_PHASES):
        moved = replace(frame, travelled_m=np.array([way + 10 * CRANK_TRAVEL_M], np.float32))
        placed = place_actors(catalog, moved, library, eye_m=np.zeros(3))
        names.append(library.names[placed.model[0]])
    assert names == ["bicycle/body", *(f"bicycle/body/{k:02d}" for k in range(1, PEDAL_PHASES))]
    legs = []
    for turn in np.linspace(0.0, 1.0, 37):
        joints: Joints = {"hip_l": np.array([-0.26, 0.09, 0.99]), "hip_r": np.array([-0.26, -0.09, 0.99])}
        push_pedals(joints, (-0.10, 0.0, 0.30), 1.72, float(turn))
        for side in ("_l", "_r"):
            foot = joints["ankle" + side] - pedal_at((-0.10, 0.0, 0.30), side, float(turn))
            np.testing.assert_allclose(np.abs(foot), np.abs(FOOT_M), atol=1e-12)
            thigh = joints["knee" + side] - joints["hip" + side]
            shank = joints["ankle" + side] - joints["knee" + side]
            legs.append([np.hypot(thigh[0], thigh[2]), np.hypot(shank[0], shank[2])])
            assert joints["knee" + side][0] > joints["hip" + side][0] + 0.1
    np.testing.assert_allclose(legs, np.broadcast_to([THIGH * 1.72, SHANK * 1.72], (len(legs), 2)), atol=1e-9)
