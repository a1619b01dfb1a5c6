"""Walkers tread on the ground, and their feet do not slide."""

import numpy as np
import open3d as o3d
import pytest
from shared_fixtures.worlds.meshes import model
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.actors.instances import place_actors
from carlaloc_env.assets.catalog import GAIT_PHASES, WALKERS
from carlaloc_env.assets.walkers.figure import skin_of
from carlaloc_env.assets.walkers.gait import THIGH, posture, standing
from carlaloc_env.assets.walkers.skeleton import shoe_sole
from carlaloc_env.assets.walkers.walker_models import BUILDS
from carlaloc_env.scene.mesh import ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag


@pytest.mark.parametrize("name", WALKERS)
def test_standing_foot_does_not_slide(name: str) -> None:
    """While a foot bears the body, its ankle moves back exactly as far as the walker moves on."""
    person = WALKERS[name]
    for side, offset in (("_l", 0.0), ("_r", 0.5)):
        shares = np.linspace(0.02, 0.48, 13)
        places = [
            posture(offset + p, person.stature_m, person.stride_m)["ankle" + side][0] + p * person.stride_m
            for p in shares
        ]
        assert np.ptp(places) < 0.01 * person.stride_m


@pytest.mark.parametrize("name", WALKERS)
def test_walkers_tread_on_the_ground(library: ModelLibrary, name: str) -> None:
    person = WALKERS[name]
    for phase in range(GAIT_PHASES):
        joints = posture(phase / GAIT_PHASES, person.stature_m, person.stride_m)
        soles = [
            point[2] for s in ("_l", "_r") for point in shoe_sole(joints["ankle" + s], joints["toe" + s])
        ]
        assert min(soles) == pytest.approx(0.0, abs=1e-9)
        mesh = model(library, f"{name}/{phase:02d}")
        assert abs(mesh.bounds_m[0, 2]) < 0.01
        assert abs(mesh.bounds_m[1, 2] - person.stature_m) < 0.06
        assert np.all(np.abs(mesh.bounds_m[:, :2]) < 0.5 * np.array(person.size_m[:2]) + 0.02)
        assert mesh.bounds_m[1, 2] < person.size_m[2] + 0.02
        assert set(np.unique(mesh.tag)) == {int(Tag.PEDESTRIAN)}
    still = model(library, f"{name}/stand")
    np.testing.assert_allclose(still.bounds_m[1, 2], person.stature_m, rtol=0.02)
    joints = standing(person.stature_m)
    assert joints["ankle_l"][0] == pytest.approx(joints["ankle_r"][0])


def test_gait_swings_arms_against_legs() -> None:
    """When the left heel strikes, the left hand is behind the right one."""
    joints = posture(0.0, 1.76, 1.46)
    assert joints["ankle_l"][0] > joints["ankle_r"][0] + 0.4
    assert joints["hand_l"][0] < joints["hand_r"][0] - 0.2


@pytest.mark.parametrize("name", WALKERS)
def test_drawn_feet_do_not_slide(library: ModelLibrary, name: str) -> None:
    """The sole that bears the body stays within 5 mm of one place, in steps far finer than the postures."""
    person = WALKERS[name]
    travelled = np.linspace(0.03, 0.45, 60) * person.stride_m
    catalog = Scenery.catalog((name,) * len(travelled), Tag.PEDESTRIAN)
    place = np.stack([travelled, 0 * travelled, 0 * travelled], axis=1)
    frame = Scenery.frame(place, speed_mps=person.speed_mps, travelled_m=travelled)
    placed = place_actors(catalog, frame, library)
    ankle = []
    for T, m in zip(placed.T_world_model, placed.model, strict=True):
        phase = int(library.names[m].split("/")[1]) / GAIT_PHASES
        ankle.append(T[0, 3] + posture(phase, person.stature_m, person.stride_m)["ankle_l"][0])
    assert np.ptp(ankle) < 0.005


@pytest.mark.parametrize("name", ["walker_woman_coat", "walker_elderly_woman"])
def test_no_leg_shows_through_a_coat(name: str) -> None:
    """Seen from all sides and in every phase of the gait, above half of the thigh."""
    build, stoop_deg = BUILDS[name]
    person, skin = WALKERS[name], skin_of(build, Tag.PEDESTRIAN, low=False)
    side_m = np.linspace(-0.3, 0.3, 61)
    for phase in np.arange(0.0, 1.0, 1 / 24):
        joints = posture(phase, person.stature_m, person.stride_m, stoop_deg=stoop_deg)
        mesh = skin.posed(joints)
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(mesh.vertices_m.astype(np.float32), mesh.triangles.astype(np.uint32))
        height_m = joints["pelvis"][2] - np.linspace(0.0, 0.5, 25) * THIGH * person.stature_m
        side, height = np.meshgrid(side_m, height_m)
        for angle in np.arange(0.0, 2 * np.pi, np.pi / 6):
            ahead = np.array([np.cos(angle), np.sin(angle), 0.0])
            begin = np.stack([-side * ahead[1], side * ahead[0], height], axis=2) - 3.0 * ahead
            rays = np.concatenate([begin, np.broadcast_to(ahead, begin.shape)], axis=2)
            hit = scene.cast_rays(rays.astype(np.float32))["primitive_ids"].numpy()
            first = mesh.triangles[hit[hit != scene.INVALID_ID]][:, 0]
            assert len(first) > 100
            assert not np.any(np.all(mesh.colour[first] == build.lower, axis=1))
