"""The renderer against geometry worked out by hand and against Embree."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import ConfigError, RenderError
from carlaloc_env.render.geometry.level_of_detail import coarse
from carlaloc_env.render.geometry.material_table import plain_albedo
from carlaloc_env.render.geometry.mesh_buffers import lit_windows
from carlaloc_env.render.geometry.projection import View
from carlaloc_env.render.gl.context import create_context
from carlaloc_env.render.lighting.light_sources import LAMP_CD, LAMP_COLOUR
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary, make_mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import PRESETS, WeatherParameters

try:
    create_context().release()
except RenderError as no_opengl:
    pytest.skip(str(no_opengl), allow_module_level=True)

CAMERA = Pinhole(width_px=320, height_px=180, fx_px=160.0, fy_px=160.0, cx_px=160.0, cy_px=90.0)
EYE_M = (0.0, 0.0, 1.6)
FORWARD = transforms.from_rotation(transforms.R_FLU_OPTICAL, EYE_M)
"""A camera 1.6 m above the origin that looks east."""
SUNLESS = WeatherParameters(cloudiness=100.0, fog_density=0.0, mie_scattering_scale=0.0)


def quad(
    corners_m: ArrayLike, material: Material = Material.PLASTER, tag: Tag = Tag.WALL, instance: int = 0
) -> Mesh:
    return make_mesh(corners_m, [[0, 1, 2], [0, 2, 3]], material=material, tag=tag, instance=instance)


def wall(x_m: float, low_m: tuple[float, float], high_m: tuple[float, float], **kind: object) -> Mesh:
    """A wall across the view, facing the camera: (y, z) from `low_m` to `high_m`."""
    (y0, z0), (y1, z1) = low_m, high_m
    return quad([[x_m, y1, z0], [x_m, y0, z0], [x_m, y0, z1], [x_m, y1, z1]], **kind)  # type: ignore[arg-type]


def ground(reach_m: float = 400.0, material: Material = Material.ASPHALT) -> Mesh:
    r = reach_m
    return quad([[-r, -r, 0], [r, -r, 0], [r, r, 0], [-r, r, 0]], material, Tag.ROAD)


def scene(*meshes: Mesh, library: ModelLibrary | None = None, **settings: object) -> SceneRenderer:
    settings = {"quality": "low", "albedo": plain_albedo(), **settings}
    return SceneRenderer(meshes, library or ModelLibrary({}), **settings)  # type: ignore[arg-type]


def rays_z1(camera: Pinhole) -> NDArray[np.float64]:
    """Directions through all pixel centres in the optical frame, z = 1, shape (H, W, 3)."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(np.float64)
    x, y = (u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1)


@pytest.fixture(scope="module")
def street() -> Iterator[SceneRenderer]:
    with scene(ground(), wall(20.0, (-3.0, 0.0), (5.0, 4.0), instance=77)) as renderer:
        yield renderer


@pytest.mark.parametrize("quality", ["low", "medium", "high"])
def test_quad_covers_the_pixels_that_the_pinhole_says(quality: str) -> None:
    """Every pixel whose centre lies inside the projected outline, and no other."""
    low, high = (-1.23, 0.71), (2.37, 2.93)
    camera = Pinhole(width_px=200, height_px=120, fx_px=150.0, fy_px=140.0, cx_px=96.3, cy_px=65.8)
    T = transforms.from_rotation(transforms.R_FLU_OPTICAL, (0.3, 0.1, 1.7))
    corners = np.array([[9.0, high[0], high[1]], [9.0, low[0], low[1]]])
    (u0, v0), (u1, v1) = camera.project(transforms.apply(transforms.invert(T), corners))
    with scene(wall(9.0, low, high), quality=quality) as renderer:
        tag, _ = renderer.draw(camera, T, Instances()).labels()
    v, u = np.mgrid[:120, :200]
    np.testing.assert_array_equal(tag == Tag.WALL, (u > u0) & (u < u1) & (v > v0) & (v < v1))


@pytest.mark.parametrize("quality", ["low", "high"])
def test_depth_of_a_plane_is_exact(quality: str) -> None:
    """Planar depth of the ground under a tilted camera, against the plane equation."""
    turn = transforms.quat_to_matrix(transforms.rpy_to_quat(0.1, 0.2, 0.7))
    T = transforms.from_rotation(turn @ transforms.R_FLU_OPTICAL, (12.0, -7.0, 1.6))
    with scene(ground(), quality=quality) as renderer:
        depth = renderer.draw(CAMERA, T, Instances()).depth_m()
    down = -(rays_z1(CAMERA) @ T[:3, :3].T)[..., 2]
    expected = 1.6 / np.where(down > 1e-9, down, np.nan)
    near = expected < 200.0
    assert near.mean() > 0.3
    assert np.all(np.abs(depth - expected)[near] < 0.01 + 0.001 * expected[near])


def test_sky_has_its_label_and_no_depth(street: SceneRenderer) -> None:
    gbuffer = street.draw(CAMERA, FORWARD, Instances())
    tag, instance = gbuffer.labels()
    assert np.all(tag[0] == Tag.SKY)
    assert np.all(gbuffer.depth_m()[0] == 0.0)
    assert np.all(instance[0] == 0)


def test_first_row_is_the_top(street: SceneRenderer) -> None:
    tag, _ = street.draw(CAMERA, FORWARD, Instances()).labels()
    assert np.all(tag[-1] == Tag.ROAD)


def test_labels_and_occlusion() -> None:
    """A near wall hides a far one; ids of 24 bits come through."""
    near = wall(8.0, (-1.0, 0.0), (1.0, 3.0), tag=Tag.POLE, instance=(1 << 23) - 1)
    far = wall(15.0, (-6.0, 0.0), (6.0, 6.0), tag=Tag.BUILDING, instance=5)
    for order in ((near, far), (far, near)):
        with scene(*order) as renderer:
            tag, instance = renderer.draw(CAMERA, FORWARD, Instances()).labels()
        assert (tag[90, 160], instance[90, 160]) == (Tag.POLE, (1 << 23) - 1)
        assert (tag[90, 190], instance[90, 190]) == (Tag.BUILDING, 5)


def test_instances_stand_where_their_pose_says() -> None:
    """A unit plate moved, turned and scaled by nothing lands on Pinhole.project of its corners."""
    plate = make_mesh(
        [[0, -1, -0.5], [0, 1, -0.5], [0, 1, 0.5], [0, -1, 0.5]],
        [[0, 1, 2], [0, 2, 3]],
        material=Material.CAR_PAINT,
        tag=Tag.CAR,
    )
    T = transforms.transform([10.0, 1.5, 2.0], transforms.rpy_to_quat(0.0, 0.0, 0.6))
    ids = np.array([(1 << 23) + 300, (1 << 23) + 1], np.uint32)
    away = transforms.transform([-20.0, 0.0, 2.0], [0, 0, 0, 1])
    instances = Instances(
        model=np.zeros(2, np.int32),
        T_world_model=np.stack([T, away]),
        instance=ids,
        tint=np.full((2, 3), 200, np.uint8),
    )
    with scene(library=ModelLibrary({"plate": plate})) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, instances)
        tag, instance = gbuffer.labels()
        depth = gbuffer.depth_m()
    corners = transforms.apply(transforms.invert(FORWARD) @ T, plate.vertices_m)
    uv = CAMERA.project(corners)
    rows, columns = np.nonzero(tag == Tag.CAR)
    assert np.all(instance[rows, columns] == ids[0])
    assert columns.min() == np.ceil(uv[:, 0].min())
    assert columns.max() == np.floor(uv[:, 0].max())
    normal = transforms.invert(FORWARD)[:3, :3] @ T[:3, 0]
    centre = transforms.apply(transforms.invert(FORWARD), T[:3, 3])
    expected = (normal @ centre) / (rays_z1(CAMERA)[rows, columns] @ normal)
    np.testing.assert_allclose(depth[rows, columns], expected, atol=0.002)


def test_depth_agrees_with_embree() -> None:
    """Random boxes: 99.9 % of the pixels away from edges within 1 cm + 0.1 %."""
    o3d = pytest.importorskip("open3d")
    random = np.random.default_rng(3)
    centres = random.uniform((4, -25, 0), (80, 25, 6), (200, 3))
    offsets = random.normal(0, 1.5, (200, 3, 3))
    corners = (centres[:, None] + offsets).reshape(-1, 3)
    shards = make_mesh(corners, np.arange(600).reshape(-1, 3), material=Material.LEAF, tag=Tag.STATIC)
    whole = merge([ground(), shards])
    with scene(ground(), shards) as renderer:
        depth = renderer.draw(CAMERA, FORWARD, Instances()).depth_m()
    embree = o3d.t.geometry.RaycastingScene()
    embree.add_triangles(o3d.core.Tensor(whole.vertices_m), o3d.core.Tensor(whole.triangles))
    directions = rays_z1(CAMERA) @ FORWARD[:3, :3].T
    origins = np.broadcast_to(EYE_M, directions.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    expected = embree.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    expected[~np.isfinite(expected)] = 0.0
    steady = (expected > 0) & (expected < 200)
    for shift in (-1, 1):
        for axis in (0, 1):
            other = np.roll(expected, shift, axis)
            steady &= np.abs(other - expected) < 0.05 * expected + 0.5
    assert steady.mean() > 0.4
    good = np.abs(depth - expected) < 0.01 + 0.001 * expected
    assert good[steady].mean() > 0.999


def test_stereo_disparity_is_focal_length_times_baseline_over_depth() -> None:
    """The left edge of a pole, found in both pictures to a pixel at several depths."""
    baseline_m = 0.4
    camera = Pinhole(width_px=640, height_px=40, fx_px=640.0, fy_px=640.0, cx_px=320.0, cy_px=20.0)
    right = FORWARD.copy()
    right[:3, 3] += FORWARD[:3, 0] * baseline_m
    for depth_m in (5.0, 10.0, 25.0):
        with scene(wall(depth_m, (-0.3, 0.0), (0.3, 3.0))) as renderer:
            tags = [renderer.draw(camera, T, Instances()).labels()[0] for T in (FORWARD, right)]
        edges = [float(np.nonzero(tag[20] == Tag.WALL)[0].min()) for tag in tags]
        assert edges[0] - edges[1] == pytest.approx(camera.fx_px * baseline_m / depth_m, abs=1.0)


def test_fog_follows_koschmieder() -> None:
    """Linear radiance of a wall: (L − L_air) falls as e^(−β d) along the ray."""
    fog = WeatherParameters(cloudiness=100.0, fog_density=80.0, fog_distance=0.0, fog_falloff=0.0)
    wide = {"low_m": (-500.0, -500.0), "high_m": (500.0, 500.0)}
    beta = fog.extinction_per_m
    radiance = {}
    for distance_m in (10.0, 30.0, 60.0, 2000.0):
        with scene(wall(min(distance_m, 1400.0), material=Material.METAL_PAINTED, **wide)) as renderer:  # type: ignore[arg-type]
            gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
            radiance[distance_m] = renderer.radiance_cd_m2(gbuffer, fog)
    air = radiance[2000.0][90, 160, 1]
    for pixel in ((90, 160), (20, 40)):
        slant = float(np.linalg.norm(rays_z1(CAMERA)[pixel]))
        contrast = [radiance[d][(*pixel, 1)] - air for d in (10.0, 30.0, 60.0)]
        assert contrast[1] / contrast[0] == pytest.approx(np.exp(-beta * 20.0 * slant), rel=0.03)
        assert contrast[2] / contrast[1] == pytest.approx(np.exp(-beta * 30.0 * slant), rel=0.03)


def test_fog_thins_with_height() -> None:
    """Optical depth of a level ray is β0 e^(−z/H) d at the camera's height."""
    fog = WeatherParameters(cloudiness=100.0, fog_density=80.0, fog_distance=0.0, fog_falloff=1.0)
    height_m = 12.0
    T = transforms.from_rotation(transforms.R_FLU_OPTICAL, (0.0, 0.0, height_m))
    seen = {}
    for distance_m in (40.0, 80.0, 1200.0):
        plain = wall(distance_m, (-900.0, -900.0), (900.0, 900.0), material=Material.METAL_PAINTED)
        with scene(plain) as renderer:
            radiance = renderer.radiance_cd_m2(renderer.draw(CAMERA, T, Instances()), fog)
            seen[distance_m] = radiance[90, 160, 1]
    level = fog.fog_extinction_per_m * np.exp(-height_m / fog.fog_scale_height_m)
    beta = level + fog.uniform_extinction_per_m
    share = (seen[80.0] - seen[1200.0]) / (seen[40.0] - seen[1200.0])
    assert share == pytest.approx(np.exp(-40.0 * beta), rel=0.03)


def test_level_ground_shows_albedo_times_illuminance() -> None:
    """Without sun and fog a matt surface has L = ρ E / π, E integrated over the sky map."""
    from carlaloc_env.render.lighting.sky_model import hemisphere, sky_light

    light = sky_light(SUNLESS)
    directions, solid_angle_sr = hemisphere()
    sky_lx = np.sum(light.sky_cd_m2 * (directions[..., 2] * solid_angle_sr)[..., None], axis=(0, 1))
    albedo = plain_albedo()
    albedo[:] = (0.4, 0.4, 0.4, 1.0)
    with scene(ground(), albedo=albedo) as renderer:
        down = transforms.from_rotation(np.diag([1.0, -1.0, -1.0]), (3.0, 4.0, 2.0))
        radiance = renderer.radiance_cd_m2(renderer.draw(CAMERA, down, Instances()), SUNLESS)
    mean = radiance.mean(axis=(0, 1))
    np.testing.assert_allclose(mean, 0.4 * sky_lx / np.pi, rtol=0.12)


def test_sun_throws_a_shadow_where_the_ray_to_it_is_blocked() -> None:
    """A plate above the ground darkens exactly the points whose ray to the sun meets it."""
    sunny = PRESETS["ClearNoon"]
    plate = quad([[8, -2, 3], [8, 2, 3], [6, 2, 3], [6, -2, 3]], Material.LEAF, Tag.STATIC)
    high = transforms.from_rotation(np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]), (2.0, 0.0, 30.0))
    camera = Pinhole(width_px=240, height_px=160, fx_px=400.0, fy_px=400.0, cx_px=120.0, cy_px=80.0)
    # Even ground: asphalt has stones and stains of its own.
    with scene(ground(material=Material.PLAIN), plate) as renderer:
        gbuffer = renderer.draw(camera, high, Instances())
        tag, _ = gbuffer.labels()
        lit = renderer.radiance_cd_m2(gbuffer, sunny)[..., 1]
    points = np.array(high[:3, 3]) + 30.0 * rays_z1(camera) @ high[:3, :3].T
    sun = sunny.sun_direction
    at_plate = points + 3.0 / sun[2] * sun
    inside = (np.abs(at_plate[..., 0] - 7) < 0.8) & (np.abs(at_plate[..., 1]) < 1.8)
    outside = (np.abs(at_plate[..., 0] - 7) > 1.2) | (np.abs(at_plate[..., 1]) > 2.2)
    road = tag == Tag.ROAD
    assert (inside & road).sum() > 500
    assert lit[inside & road].max() < 0.5 * lit[outside & road].min()


def test_same_call_gives_the_same_bytes(street: SceneRenderer) -> None:
    """Whatever was drawn and shaded in between."""
    weathers = [PRESETS[name] for name in ("ClearNoon", "FoggyNoon", "RainyNight")]
    first = [
        street.shade(street.draw(CAMERA, FORWARD, Instances()), w, stamp_ns=50, seed=3) for w in weathers
    ]
    elsewhere = FORWARD.copy()
    elsewhere[:3, 3] += (60.0, 200.0, 1.0)
    for weather in weathers:
        street.shade(street.draw(CAMERA, elsewhere, Instances()), weather)
    with scene(ground(), wall(20.0, (-3.0, 0.0), (5.0, 4.0), instance=77)) as fresh:
        for weather, picture in zip(weathers, first, strict=True):
            again = street.shade(street.draw(CAMERA, FORWARD, Instances()), weather, stamp_ns=50, seed=3)
            other = fresh.shade(fresh.draw(CAMERA, FORWARD, Instances()), weather, stamp_ns=50, seed=3)
            np.testing.assert_array_equal(again, picture)
            np.testing.assert_array_equal(other, picture)


def test_dither_is_keyed_by_stamp_and_stays_below_one_step(street: SceneRenderer) -> None:
    gbuffer = street.draw(CAMERA, FORWARD, Instances())
    a = street.shade(gbuffer, PRESETS["FoggyNoon"], stamp_ns=0, seed=3).astype(int)
    b = street.shade(gbuffer, PRESETS["FoggyNoon"], stamp_ns=50, seed=3).astype(int)
    assert np.abs(a - b).max() == 1


def test_gbuffers_stay_apart(street: SceneRenderer) -> None:
    """A G-buffer keeps its content while others are drawn."""
    gbuffer = street.draw(CAMERA, FORWARD, Instances())
    before = gbuffer.depth_m()
    elsewhere = FORWARD.copy()
    elsewhere[2, 3] = 9.0
    other = street.draw(CAMERA, elsewhere, Instances())
    np.testing.assert_array_equal(gbuffer.depth_m(), before)
    assert not np.array_equal(other.depth_m(), before)


def test_car_paint_takes_the_tint_of_its_instance() -> None:
    def plate(material: Material) -> Mesh:
        corners = [[0, 2, -2], [0, -2, -2], [0, -2, 2], [0, 2, 2]]
        return make_mesh(corners, [[0, 1, 2], [0, 2, 3]], material=material, tag=Tag.CAR)

    library = ModelLibrary({"paint": plate(Material.CAR_PAINT), "plastic": plate(Material.PLASTIC)})
    T = np.tile(transforms.transform([8.0, 0.0, 1.6], [0, 0, 0, 1]), (1, 1, 1))
    red = np.array([[220, 10, 10]], np.uint8)
    hues = {}
    with scene(library=library) as renderer:
        for model in range(2):
            one = Instances(
                model=np.array([model], np.int32), T_world_model=T, instance=np.ones(1, np.uint32), tint=red
            )
            pixel = renderer.shade(renderer.draw(CAMERA, FORWARD, one), PRESETS["CloudyNoon"])[90, 160]
            hues[model] = float(pixel[0]) - float(pixel[2])
    assert hues[0] > 60
    assert abs(hues[1]) < 20


def test_street_lamp_lights_the_ground_by_the_inverse_square() -> None:
    """Straight below L = ρ I / (π h²); outside the cut-off beam nothing."""
    night = WeatherParameters(sun_altitude_angle=-90.0, fog_density=0.0, mie_scattering_scale=0.0)
    albedo = plain_albedo()
    albedo[:] = (0.4, 0.4, 0.4, 1.0)
    down = transforms.from_rotation(np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]), (2.0, 0.0, 25.0))
    pictures = []
    for lamps_m in (np.zeros((0, 3)), np.array([[2.0, 0.0, 4.0]]), np.array([[2.0, 0.0, 8.0]])):
        # Nothing stains glass.
        with scene(ground(material=Material.GLASS), albedo=albedo, lamps_m=lamps_m) as renderer:
            pictures.append(renderer.radiance_cd_m2(renderer.draw(CAMERA, down, Instances()), night))
    dark, low, high = (picture[..., 1] for picture in pictures)
    for lit, height_m in ((low, 4.0), (high, 8.0)):
        expected = 0.4 * LAMP_CD * LAMP_COLOUR[1] / (np.pi * height_m**2)
        assert lit[90, 160] - dark[90, 160] == pytest.approx(expected, rel=0.1)
    # 24 m aside of a lamp at 4 m is 80.5° from its axis.
    assert low[90, 320 - 2] - dark[90, 320 - 2] == pytest.approx(0.0, abs=1e-3)


def test_no_visible_box_is_culled() -> None:
    """A box is kept whenever one of its random points projects into the picture."""
    random = np.random.default_rng(11)
    turn = transforms.quat_to_matrix(transforms.rpy_to_quat(0.05, -0.1, 2.0))
    view = View.of(CAMERA, transforms.from_rotation(turn @ transforms.R_FLU_OPTICAL, (5.0, 3.0, 1.6)))
    low = random.uniform(-150, 150, (400, 3))
    high = low + random.uniform(1, 30, (400, 3))
    points = low[:, None] + random.random((400, 60, 3)) * (high - low)[:, None]
    local = (points - view.position_m) @ view.R_camera_world.T
    uv = CAMERA.project(local.reshape(-1, 3)).reshape(400, 60, 2)
    shown = ((uv > -0.4) & (uv < np.array([319.4, 179.4]))).all(axis=2) & (local[..., 2] > 0.5)
    kept, distance_m = view.visible(low, high)
    assert set(np.flatnonzero(shown.any(axis=1))) <= set(kept)
    assert len(kept) < 200
    assert np.all(np.diff(distance_m) >= 0)


def test_leaves_keep_their_area_from_afar() -> None:
    random = np.random.default_rng(2)
    corners = random.normal(0, 3, (4000, 1, 3)) + random.normal(0, 0.1, (4000, 3, 3))
    crown = make_mesh(
        corners.reshape(-1, 3), np.arange(12000).reshape(-1, 3), material=Material.LEAF, tag=Tag.VEGETATION
    )

    def area_m2(mesh: Mesh) -> float:
        a, b, c = (mesh.vertices_m[mesh.triangles[:, i]] for i in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    far = coarse(crown)
    assert len(far.triangles) == 1000
    assert area_m2(far) == pytest.approx(area_m2(crown), rel=0.05)


def test_both_halves_of_a_pane_are_lit_alike() -> None:
    random = np.random.default_rng(5)
    panes = []
    for x, y, z in random.uniform(-50, 50, (300, 3)):
        corners = [[x, y, z], [x + 1.2, y, z], [x + 1.2, y, z + 1.6], [x, y, z + 1.6]]
        panes += [
            make_mesh([corners[i] for i in half], [[0, 1, 2]], material=Material.WINDOW, tag=Tag.BUILDING)
            for half in ((0, 1, 2), (0, 2, 3))
        ]
    code = lit_windows(merge(panes)).reshape(300, 6)
    assert np.all(code == code[:, :1])
    assert 0.08 < (code[:, 0] > 0).mean() < 0.3


@pytest.mark.parametrize(("weather", "beside_m"), [(PRESETS["ClearNoon"], 11.0), (SUNLESS, 12.0)])
def test_the_road_under_a_car_is_darker(weather: WeatherParameters, beside_m: float) -> None:
    """A floating slab darkens the road below it, in sunlight and under an even sky."""
    corners = [[-2, -1, 0], [2, -1, 0], [2, 1, 0], [-2, 1, 0]]
    slab = make_mesh(corners, [[0, 1, 2], [0, 2, 3]], material=Material.CAR_PAINT, tag=Tag.CAR)
    one = Instances(
        model=np.zeros(1, np.int32),
        T_world_model=transforms.transform([[12.0, 0.0, 1.3]], [[0.0, 0.0, 0.0, 1.0]]),
        instance=np.ones(1, np.uint32),
        tint=np.full((1, 3), 99, np.uint8),
    )
    with scene(ground(), library=ModelLibrary({"slab": slab})) as renderer:
        bare, under = (
            renderer.radiance_cd_m2(renderer.draw(CAMERA, FORWARD, i), weather)[..., 1]
            for i in (Instances(), one)
        )
    spot = transforms.apply(transforms.invert(FORWARD), [beside_m, 0.0, 0.0])
    u, v = CAMERA.project(spot[None])[0].round().astype(int)
    assert under[v, u] < 0.6 * bare[v, u]
    assert under[170, 160] == pytest.approx(bare[170, 160], rel=1e-3)


def test_missing_opengl_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_: object) -> None:
        raise Exception("libEGL.so.1 not loaded")

    monkeypatch.setattr("moderngl.create_context", refuse)
    with pytest.raises(RenderError, match="apt-get install libegl1 libgl1 libgl1-mesa-dri"):
        create_context()


def test_chunks_behind_a_wall_cost_nothing_and_change_nothing() -> None:
    """Far boxes peep over and past a wall: each pixel shows what one undivided mesh shows."""
    random = np.random.default_rng(8)
    blocks = [ground(), wall(30.0, (-25.0, 0.0), (12.0, 9.0), tag=Tag.WALL)]
    for number, (x, y) in enumerate(random.uniform((170, -150), (500, 150), (60, 2))):
        height = random.uniform(5, 90)
        blocks.append(
            wall(x, (y - 8, 0.0), (y + 8, height), material=Material.PLAIN, tag=Tag.BUILDING, instance=number)
        )
    with scene(*blocks) as divided, scene(merge(blocks)) as whole:
        a, b = (renderer.draw(CAMERA, FORWARD, Instances()) for renderer in (divided, whole))
        np.testing.assert_array_equal(a.labels()[1], b.labels()[1])
        np.testing.assert_array_equal(a.depth_m(), b.depth_m())
        assert len(np.unique(a.labels()[1])) > 5


def test_unknown_quality_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'medium'"):
        scene(ground(), quality="mediun")


def test_two_renderers_live_side_by_side() -> None:
    with scene(wall(10.0, (-1.0, 0.0), (1.0, 3.0))) as a, scene(wall(20.0, (-1.0, 0.0), (1.0, 3.0))) as b:
        pictures = [r.draw(CAMERA, FORWARD, Instances()) for r in (a, b, a)]
        assert [round(float(p.depth_m()[90, 160])) for p in pictures] == [10, 20, 10]
