"""Vehicles, walkers, props and their placing against sizes, geometry and an independent calculation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shared_fixtures.meshes import signed_volume_m3

from carlaloc_env.actors.instances import (
    ground_poses,
    place_actors,
    place_ego,
    place_lights,
    place_signals,
)
from carlaloc_env.assets.catalog import GAIT_PHASES, LOW_GAIT_PHASES, VEHICLES, WALKERS
from carlaloc_env.assets.model_library import build_library
from carlaloc_env.assets.modelling.primitives import Look, box, lathe, mirrored, tube
from carlaloc_env.assets.number_plates import PLATES, plate_of, plate_text, plate_uv
from carlaloc_env.assets.street.all_props import PROPS, prop
from carlaloc_env.assets.street.traffic_lights import traffic_light
from carlaloc_env.assets.street.traffic_signs import SIGNS, sign
from carlaloc_env.assets.texture_atlas import atlas_uv, street_name_uv
from carlaloc_env.assets.vegetation.shrubs import hedge
from carlaloc_env.assets.vegetation.tree_species import FORMS
from carlaloc_env.assets.vegetation.trees import tree
from carlaloc_env.assets.vehicles.body import loft_body
from carlaloc_env.assets.vehicles.car_models import CARS
from carlaloc_env.assets.vehicles.cycles import PEDAL_PHASES
from carlaloc_env.assets.vehicles.lit_lamps import LAMPS
from carlaloc_env.assets.walkers.gait import posture, standing
from carlaloc_env.assets.walkers.skeleton import shoe_sole
from carlaloc_env.core.ego_car import EGO_SIZE_M
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Mesh, ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.timeline.timeline import LIGHT_BRAKE, LIGHT_LEFT, ActorCatalog, ActorFrame

PLAIN = Look(Material.PLAIN, Tag.STATIC)


@pytest.fixture(scope="module")
def library() -> ModelLibrary:
    return build_library()


def model(library: ModelLibrary, name: str) -> Mesh:
    return library.meshes[library.index(name)]


def facing_away(mesh: Mesh, rays: int = 4000) -> float:
    """Share of rays from all round that first meet a triangle from behind; leaves are open and left out."""
    o3d = pytest.importorskip("open3d", reason="Open3D casts the rays")
    solid = mesh.triangles[mesh.material[mesh.triangles[:, 0]] != Material.LEAF]
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(mesh.vertices_m), o3d.core.Tensor(solid))
    rng = np.random.default_rng(1)
    low, high = mesh.bounds_m
    target = rng.uniform(low, high, (rays, 3))
    out = rng.normal(size=(rays, 3))
    out[:, 2] = np.abs(out[:, 2]) * 0.5
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    reach = 2.0 * float(np.linalg.norm(high - low))
    hits = scene.cast_rays(
        o3d.core.Tensor(np.concatenate([target + reach * out, -out], axis=1).astype(np.float32))
    )
    met = np.isfinite(hits["t_hit"].numpy())
    normal = hits["primitive_normals"].numpy()[met]
    assert met.sum() > rays / 20
    return float(np.mean(np.sum(normal * out[met], axis=1) < -1e-3))


@pytest.mark.parametrize("name", VEHICLES)
def test_vehicle_fills_its_box_and_stands_on_the_ground(library: ModelLibrary, name: str) -> None:
    mesh = model(library, name)
    low, high = mesh.bounds_m
    np.testing.assert_allclose(high - low, VEHICLES[name].size_m, rtol=0.02)
    np.testing.assert_allclose(0.5 * (low + high)[:2], 0.0, atol=0.012)
    assert abs(low[2]) < 1e-3
    assert signed_volume_m3(mesh) > 0
    assert 2000 < len(mesh.triangles) < 5000
    assert 300 < len(model(library, f"{name}/low").triangles) < 1100


@pytest.mark.parametrize(
    "name", [n for n, v in VEHICLES.items() if v.tag is Tag.CAR or n in ("van", "pickup")]
)
def test_four_wheels_touch_the_ground_at_the_axles(library: ModelLibrary, name: str) -> None:
    mesh = model(library, name)
    rubber = mesh.material == Material.RUBBER
    touching = mesh.vertices_m[rubber & (mesh.vertices_m[:, 2] < 1e-3)]
    axles = np.unique(np.round(touching[:, 0], 3))
    assert len(axles) == 2
    assert axles[1] - axles[0] == pytest.approx(VEHICLES[name].wheelbase_m, abs=0.01)
    for axle in axles:
        sides = touching[np.abs(touching[:, 0] - axle) < 1e-3, 1]
        assert sides.min() < -0.5 < 0.5 < sides.max()


@pytest.mark.parametrize("name", VEHICLES)
def test_car_shell_volume_is_a_large_part_of_its_box(library: ModelLibrary, name: str) -> None:
    if name not in CARS:
        pytest.skip("not a closed body")
    share = signed_volume_m3(loft_body(CARS[name].shape, Tag.CAR)) / np.prod(VEHICLES[name].size_m)
    assert 0.4 < share < 0.9


@pytest.mark.parametrize(
    "name", ["saloon", "pickup", "bus", "lorry", "motorcycle", "bicycle", "walker_woman/05", "ego"]
)
def test_models_show_their_outside(library: ModelLibrary, name: str) -> None:
    assert facing_away(model(library, name)) < 0.01


@pytest.mark.parametrize("name", PROPS)
def test_props_stand_at_the_origin_and_show_their_outside(name: str) -> None:
    mesh = prop(name)
    assert mesh.bounds_m[0, 2] > -0.07 or name == "banner"
    assert signed_volume_m3(mesh) > 0
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-4)
    if name != "hedge":
        assert facing_away(mesh, 1500) < 0.02


def test_library_holds_every_name(library: ModelLibrary) -> None:
    expected = {*VEHICLES, "ego", *(f"ego/{lamp}" for lamp in LAMPS)}
    expected |= {"signal_red", "signal_yellow", "signal_green"}
    for name in WALKERS:
        expected |= {f"{name}/{k:02d}" for k in range(GAIT_PHASES)} | {f"{name}/stand", f"{name}/low/stand"}
        expected |= {f"{name}/low/{k:02d}" for k in range(LOW_GAIT_PHASES)}
    for name in VEHICLES:
        expected |= {f"{name}{way}/{lamp}" for way in ("", "/low") for lamp in LAMPS}
        expected |= {f"{name}/body", f"{name}/low", f"{name}/wheel0"}
    for kind in ("", "/body", "/low"):
        expected |= {f"bicycle{kind}/{k:02d}" for k in range(1, PEDAL_PHASES)}
    for tag in {model.tag for model in VEHICLES.values()}:
        expected |= {f"plate/{tag.name}/{k:02d}" for k in range(PLATES)}
    assert set(library.names) == {*expected, "lorry/wheel1"}
    assert sum(v.weight for v in VEHICLES.values()) == pytest.approx(1.0)
    assert sum(w.weight for w in WALKERS.values()) == pytest.approx(1.0)
    for family in (*VEHICLES.values(), *WALKERS.values()):
        assert sum(share for _, share in family.tints) == pytest.approx(1.0)


def test_riders_sit_on_cycles(library: ModelLibrary) -> None:
    for name in ("motorcycle", "bicycle"):
        mesh = model(library, name)
        assert set(np.unique(mesh.tag)) == {int(VEHICLES[name].tag), int(Tag.RIDER)}
        assert mesh.vertices_m[mesh.tag == Tag.RIDER, 2].max() > 1.5


def test_ego_spans_its_place_about_the_rear_axle(library: ModelLibrary) -> None:
    low, high = model(library, "ego").bounds_m
    np.testing.assert_allclose([low[0], high[0]], [-0.95, 3.75], atol=0.03)
    np.testing.assert_allclose(high - low, EGO_SIZE_M, rtol=0.02)
    mesh = model(library, "ego")
    rubber = mesh.vertices_m[(mesh.material == Material.RUBBER) & (mesh.vertices_m[:, 2] < 1e-3)]
    np.testing.assert_allclose(np.unique(np.round(rubber[:, 0], 3)), [0.0, 2.875], atol=2e-3)


def test_shapes_have_the_volume_of_their_formula() -> None:
    assert signed_volume_m3(box(PLAIN, (2, 3, 4), (5, 6, 7))) == pytest.approx(24.0)
    prism = 0.5 * 8 * math.sin(2 * math.pi / 8) * 0.2**2
    assert signed_volume_m3(tube(PLAIN, [(0, 0, 0), (0, 0, 3)], 0.2, 8)) == pytest.approx(3 * prism, rel=1e-5)
    assert signed_volume_m3(tube(PLAIN, [(0, 0, 0), (3, 0, 0)], 0.2, 8)) == pytest.approx(3 * prism, rel=1e-5)
    cone = lathe(PLAIN, [(1.0, 0.0), (1e-6, 3.0)], 64)
    assert signed_volume_m3(cone) == pytest.approx(math.pi, rel=0.01)
    assert signed_volume_m3(mirrored(cone)) == pytest.approx(math.pi, rel=0.01)


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
        assert 900 < len(mesh.triangles) < 2200
    still = model(library, f"{name}/stand")
    np.testing.assert_allclose(still.bounds_m[1, 2], person.stature_m, rtol=0.02)
    joints = standing(person.stature_m)
    assert joints["ankle_l"][0] == pytest.approx(joints["ankle_r"][0])


def test_gait_swings_arms_against_legs() -> None:
    """When the left heel strikes, the left hand is behind the right one."""
    joints = posture(0.0, 1.76, 1.46)
    assert joints["ankle_l"][0] > joints["ankle_r"][0] + 0.4
    assert joints["hand_l"][0] < joints["hand_r"][0] - 0.2


def actors() -> tuple[ActorCatalog, ActorFrame]:
    rng = np.random.default_rng(4)
    names = ("saloon", "walker_man", "bus", "walker_child", "walker_woman", "bicycle")
    count = len(names)
    catalog = ActorCatalog(
        id=np.arange(count, dtype=np.uint32) + EGO_INSTANCE + 1,
        model=names,
        tag=np.array([14, 12, 16, 12, 12, 19], np.uint8),
        size_m=np.ones((count, 3), np.float32),
        tint=rng.integers(0, 255, (count, 3)).astype(np.uint8),
    )
    frame = ActorFrame(
        position_m=rng.normal(0, 50, (count, 3)).astype(np.float32),
        heading_rad=rng.uniform(-3, 3, count).astype(np.float32),
        pitch_rad=rng.uniform(-0.1, 0.1, count).astype(np.float32),
        roll_rad=np.linspace(-0.1, 0.1, count).astype(np.float32),
        speed_mps=np.array([9, 1.4, 0, 0, 1.2, 4], np.float32),
        travelled_m=np.array([100, 37.3, 5, 3, 12.9, 8], np.float32),
        steer_rad=np.zeros(count, np.float32),
        lights=np.array([LIGHT_BRAKE | LIGHT_LEFT, 0, LIGHT_LEFT, 0, 0, LIGHT_BRAKE], np.uint8),
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
    zero = np.zeros(many, np.float32)
    catalog = ActorCatalog(
        id=np.arange(many, dtype=np.uint32) + EGO_INSTANCE + 1,
        model=names,
        tag=np.array(tags, np.uint8),
        size_m=np.ones((many, 3), np.float32),
        tint=np.full((many, 3), 99, np.uint8),
    )
    frame = ActorFrame(
        position_m=np.stack([away, zero, zero], axis=1).astype(np.float32),
        heading_rad=np.linspace(-3, 3, many).astype(np.float32),
        pitch_rad=np.linspace(-0.1, 0.1, many).astype(np.float32),
        speed_mps=np.ones(many, np.float32),
        travelled_m=np.linspace(0, 40, many).astype(np.float32),
        steer_rad=np.linspace(-0.5, 0.5, many).astype(np.float32),
        lights=np.full(many, LIGHT_BRAKE, np.uint8),
    )
    return catalog, frame


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
    catalog, frame = near_far(1)
    k = catalog.model.index("saloon")
    one, still = catalog.take(np.array([k])), frame.take(np.array([k]))
    radius, dx, steer = 0.33, 0.002, 0.3

    def wheels(travelled_m: float, steer_rad: float) -> list[np.ndarray]:
        moved = replace(
            still,
            position_m=np.zeros((1, 3), np.float32),
            heading_rad=np.zeros(1, np.float32),
            pitch_rad=np.zeros(1, np.float32),
            travelled_m=np.array([travelled_m], np.float32),
            steer_rad=np.array([steer_rad], np.float32),
        )
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


def test_plates_read_differently_and_lie_apart() -> None:
    assert len({plate_text(k) for k in range(PLATES)}) == PLATES >= 64
    rects = np.array([plate_uv(k) for k in range(PLATES)])
    for k in range(PLATES):
        u0, v0, u1, v1 = rects[k]
        apart = (rects[:, 2] <= u0) | (rects[:, 0] >= u1) | (rects[:, 3] <= v0) | (rects[:, 1] >= v1)
        assert apart.sum() == PLATES - 1
    assert len(np.unique(plate_of(np.arange(300, dtype=np.uint32) + EGO_INSTANCE + 1))) > 55


@pytest.mark.parametrize("name", WALKERS)
def test_drawn_feet_do_not_slide(library: ModelLibrary, name: str) -> None:
    """The sole that bears the body stays within 5 mm of one place, in steps far finer than the postures."""
    person = WALKERS[name]
    travelled = np.linspace(0.03, 0.45, 60) * person.stride_m
    count = len(travelled)
    catalog = ActorCatalog(
        id=np.arange(count, dtype=np.uint32) + EGO_INSTANCE + 1,
        model=(name,) * count,
        tag=np.full(count, Tag.PEDESTRIAN, np.uint8),
        size_m=np.ones((count, 3), np.float32),
        tint=np.zeros((count, 3), np.uint8),
    )
    zero = np.zeros(count, np.float32)
    frame = ActorFrame(
        position_m=np.stack([travelled, zero, zero], axis=1).astype(np.float32),
        heading_rad=zero,
        pitch_rad=zero,
        speed_mps=zero + np.float32(person.speed_mps),
        travelled_m=travelled.astype(np.float32),
        steer_rad=zero,
        lights=np.zeros(count, np.uint8),
    )
    placed = place_actors(catalog, frame, library)
    ankle = []
    for T, m in zip(placed.T_world_model, placed.model, strict=True):
        phase = int(library.names[m].split("/")[1]) / GAIT_PHASES
        ankle.append(T[0, 3] + posture(phase, person.stature_m, person.stride_m)["ankle_l"][0])
    assert np.ptp(ankle) < 0.005


def test_placing_an_empty_world_gives_nothing(library: ModelLibrary) -> None:
    catalog, frame = actors()
    none = np.zeros(0, np.intp)
    assert len(place_actors(catalog.take(none), frame.take(none), library)) == 0
    assert len(place_lights(catalog.take(none), frame.take(none), library, 0)) == 0
    assert len(place_signals(SignalLenses(), np.zeros(0, np.uint8), library)) == 0


def test_placing_names_the_nearest_model(library: ModelLibrary) -> None:
    catalog, frame = actors()
    bad = ActorCatalog(
        id=catalog.id[:1],
        model=("salon",),
        tag=catalog.tag[:1],
        size_m=catalog.size_m[:1],
        tint=catalog.tint[:1],
    )
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


@pytest.mark.parametrize(("heads", "arm_m"), [(1, 0.0), (2, 0.0), (2, 7.0), (3, 9.0)])
def test_traffic_light_lenses_sit_on_their_heads(heads: int, arm_m: float) -> None:
    mesh, lenses = traffic_light(heads, arm_m)
    assert lenses.shape == (heads, 3, 4, 4)
    assert np.all(np.diff(lenses[:, :, 2, 3], axis=1) < 0), "red above yellow above green"
    np.testing.assert_allclose(lenses[..., :3, 0], np.broadcast_to([1.0, 0, 0], (heads, 3, 3)), atol=1e-12)
    tagged = mesh.vertices_m[mesh.tag == Tag.TRAFFIC_LIGHT]
    for centre in lenses[..., :3, 3].reshape(-1, 3):
        near = tagged[np.linalg.norm(tagged - centre, axis=1) < 0.02]
        assert len(near) > 0
    if arm_m:
        assert lenses[0, 2, 2, 3] > 5.2
        assert lenses[..., 1, 3].min() < -0.8 * arm_m


@pytest.mark.parametrize("kind", SIGNS)
def test_sign_faces_show_their_cell(kind: str) -> None:
    mesh = sign(kind)
    face = (mesh.material == Material.SIGN) & (mesh.normals[:, 0] > 0.9)
    u0, v0, u1, v1 = atlas_uv(Material.SIGN, SIGNS[kind][0])
    uv = mesh.uv_m[face]
    assert face.sum() >= 3
    assert uv[:, 0].min() >= u0 - 1e-6
    assert uv[:, 0].max() <= u1 + 1e-6
    assert uv[:, 1].min() >= v0 - 1e-6
    assert uv[:, 1].max() <= v1 + 1e-6
    # Read from +x, right is +y and up is +z.
    centred = mesh.vertices_m[face] - mesh.vertices_m[face].mean(axis=0)
    assert np.sum(centred[:, 1] * (uv[:, 0] - uv[:, 0].mean())) > 0
    assert np.sum(centred[:, 2] * (uv[:, 1] - uv[:, 1].mean())) > 0


def test_signs_choose_by_text_and_name_the_nearest() -> None:
    assert np.array_equal(sign("speed", "48").uv_m, sign("speed_50").uv_m)
    used = sign("street_name", "OAK AVE").uv_m
    u0, v0, u1, v1 = street_name_uv(1)
    assert np.any(
        (used[:, 0] > u0) & (used[:, 0] <= u1 + 1e-6) & (used[:, 1] >= v0 - 1e-6) & (used[:, 1] <= v1 + 1e-6)
    )
    with pytest.raises(ConfigError, match="did you mean 'stop'"):
        sign("stopp")


@pytest.mark.parametrize("kind", FORMS)
def test_trees_keep_their_leaf_area_at_low_detail(kind: str) -> None:
    def leaf_area(mesh: Mesh) -> float:
        a, b, c = (mesh.vertices_m[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
        leaf = mesh.material[mesh.triangles[:, 0]] == Material.LEAF
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)[leaf].sum())

    high, low = tree(kind, 5), tree(kind, 5, "low")
    assert leaf_area(low) == pytest.approx(leaf_area(high), rel=0.12)
    assert len(low.triangles) < 0.25 * len(high.triangles)
    assert 600 < len(high.triangles) < 4200
    form, height = FORMS[kind], high.bounds_m[1, 2]
    assert 0.75 * form.height_m[0] < height < 1.12 * form.height_m[1]
    assert set(np.unique(high.tag)) == {int(Tag.VEGETATION)}


def test_trees_are_the_same_for_the_same_seed_only() -> None:
    a, b, c = tree("plane", 7), tree("plane", 7), tree("plane", 8)
    assert a.vertices_m.tobytes() == b.vertices_m.tobytes()
    assert len(a.vertices_m) != len(c.vertices_m) or a.vertices_m.tobytes() != c.vertices_m.tobytes()
    with pytest.raises(ConfigError, match="did you mean 'conifer'"):
        tree("conifir")
    assert hedge(4.0, 1.2, 0.6).bounds_m[1, 0] == pytest.approx(4.0, abs=0.15)
