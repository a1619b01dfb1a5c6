"""Lamps of the night: which reach a tile, and how bright they light what they reach."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from shared_fixtures.worlds.plain_albedo import plain_albedo
from shared_fixtures.worlds.render_scenes import (
    CAMERA,
    FORWARD,
    ego_plate,
    ground,
    need_opengl,
    rays_z1,
    scene,
    standing,
    wall,
)

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.lighting.light_grid import LOOPS, Fog, light_grid
from carlaloc_env.render.lighting.light_sources import nearest, street_lamps
from carlaloc_env.render.lighting.light_tiles import TILE_PX, DepthRange
from carlaloc_env.render.lighting.model_lamps import (
    BEAM_RANGE_M,
    HEADLAMP_COLOUR,
    HEADLAMP_LIGHT,
    Emitters,
)
from carlaloc_env.render.views import CameraView
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Instances, Mesh, ModelLibrary, make_mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.presets import PRESETS

need_opengl()

NIGHT = WeatherParameters(sun_altitude_angle=-90.0, fog_density=0.0, mie_scattering_scale=0.0)


def patch(
    x_m: float, y_m: float, z_m: float, half_m: float, material: Material, *, faces_ahead: bool = True
) -> Mesh:
    """A square across x."""
    h = half_m
    corners = [
        [x_m, y_m - h, z_m - h],
        [x_m, y_m + h, z_m - h],
        [x_m, y_m + h, z_m + h],
        [x_m, y_m - h, z_m + h],
    ]
    triangles = [[0, 1, 2], [0, 2, 3]] if faces_ahead else [[2, 1, 0], [3, 2, 0]]
    return make_mesh(corners, triangles, material=material, tag=Tag.CAR)


def test_every_lamp_that_reaches_a_pixel_is_in_its_tile() -> None:
    """Random lamps over a random relief, against the distance of every pixel's point to every lamp."""
    random = np.random.default_rng(4)
    turn = transforms.quat_to_matrix(transforms.rpy_to_quat(0.05, -0.1, 2.0))
    view = CameraView.of(CAMERA, transforms.from_rotation(turn @ transforms.R_FLU_OPTICAL, (5.0, 3.0, 1.6)))
    coarse = random.uniform(3.0, 90.0, (12, 20))
    depth = np.kron(coarse, np.ones((15, 16))).astype(np.float32)
    depth[:40] = 0.0
    ahead = view.position_m + 45.0 * view.R_camera_world[2]
    lamps = street_lamps(random.uniform(-60, 60, (300, 3)) + ahead)
    lights = nearest(lamps, view.position_m)
    grid = light_grid(view, lights, DepthRange.of(depth))
    points = view.position_m + (rays_z1(CAMERA) * depth[..., None]) @ view.R_camera_world
    gap = np.sqrt(np.sum((points[..., None, :] - lights.position_m) ** 2, axis=-1))
    reached = (gap < lights.range_m) & (depth[..., None] > 0)
    visited, needed = 0, 0
    for tile in grid.groups.tiles:
        column, row = tile["cell"]
        box = np.s_[row * TILE_PX : (row + 1) * TILE_PX, column * TILE_PX : (column + 1) * TILE_PX]
        listed = set(grid.entries[tile["lamps"][0] : tile["lamps"][1]])
        assert set(np.flatnonzero(reached[box].any(axis=(0, 1)))) <= listed
        visited += len(listed)
        needed += np.count_nonzero(reached[box].any(axis=(0, 1)))
    assert needed > 500
    # A street has few lamps per tile; here the reliefs of 90 m make the tiles deep.
    assert visited < 0.25 * len(grid.groups.tiles) * len(lights)


def test_depth_ranges_of_tiles_leave_the_sky_out() -> None:
    """Against the least and the largest of every square; the last row of tiles is cut off."""
    random = np.random.default_rng(3)
    depth = random.uniform(1.0, 300.0, (TILE_PX * 2 + 5, TILE_PX * 3)).astype(np.float32)
    depth[random.random(depth.shape) < 0.3] = 0.0
    depth[:TILE_PX, :TILE_PX] = 0.0
    found = DepthRange.of(depth)
    for row in range(3):
        for column in range(3):
            square = depth[row * TILE_PX :, column * TILE_PX :][:TILE_PX, :TILE_PX]
            solid = square[square > 0.0]
            assert found.near_m[row, column] == solid.min(initial=np.inf)
            assert found.far_m[row, column] == solid.max(initial=0.0)
            assert found.sky[row, column] == (square == 0.0).any()
            assert found.shown[row, column] == (0 if (square > 0.0).all() else 2 if not len(solid) else 1)


def test_tiles_run_the_loops_of_all_their_lists() -> None:
    """Lamps and low beams over a wall: no list goes unread, and lists of few kinds run on their own."""
    random = np.random.default_rng(5)
    view = CameraView.of(CAMERA, FORWARD)
    count = 40
    lamps = street_lamps(random.uniform([5, -60, 0], [50, 60, 9], (count, 3)))
    lights = replace(lamps, beam=np.arange(count) % 3 == 0, range_m=np.full(count, 9.0))
    depth = np.full((180, 320), 50.0, np.float32)
    fog = Fog(extinction_per_m=0.02, start_m=0.0)
    grid = light_grid(view, lights, DepthRange.of(depth), exposure=0.02, fog=fog)
    names = {"LAMPS": "lamps", "BEAMS": "beams", "GLOWS": "glows"}
    seen = 0
    for loops in LOOPS:
        first, many = grid.groups.groups[loops]
        seen += many
        for tile in grid.groups.tiles[first : first + many]:
            needed = {name for name, key in names.items() if tile[key][1] > tile[key][0]}
            assert needed <= set(loops)
    assert seen == len(grid.groups.tiles)
    assert sum(many > 0 for _, many in grid.groups.groups.values()) > 2


def test_lamps_are_found_on_models_by_their_materials() -> None:
    """Headlamps become one low beam, brake lights two lamps that face back, where the model stands."""
    body = merge(
        [
            patch(3.6, 0.6, 0.7, 0.1, Material.LAMP_WHITE),
            patch(3.6, -0.6, 0.7, 0.1, Material.LAMP_WHITE),
            patch(-0.9, 0.6, 0.8, 0.1, Material.LAMP_RED, faces_ahead=False),
            patch(-0.9, -0.6, 0.8, 0.1, Material.LAMP_RED, faces_ahead=False),
        ]
    )
    emitters = Emitters(ModelLibrary({"car": body}))
    T = transforms.transform([20.0, 5.0, 0.3], transforms.rpy_to_quat(0.0, 0.0, np.pi / 2))
    one = standing(T, instance=7)
    lights = emitters.lights(one)
    assert lights.beam.tolist() == [True, False, False]
    np.testing.assert_allclose(lights.position_m[0], [20.0, 8.6, 1.0], atol=1e-5)
    np.testing.assert_allclose(lights.position_m[1:], [[19.4, 4.1, 1.1], [20.6, 4.1, 1.1]], atol=1e-5)
    np.testing.assert_allclose(lights.axis, [[0, 1, 0], [0, -1, 0], [0, -1, 0]], atol=1e-9)


def test_low_beam_lights_the_road_and_spares_the_eyes() -> None:
    """Illuminance of a wall 25 m before the lamps, against the class-B demands of UN regulation 112.

    At least 12 lx at 75R and at most 0.6 lx where oncoming drivers' eyes are (B50L), for one lamp; ours
    are one pair, dimmed by a known factor.
    """
    lamp_m = np.array([3.65, 0.0, 0.65])
    distance_m = 25.0
    x = lamp_m[0] + distance_m
    screen = wall(x, (-30.0, -30.0), (30.0, 30.0))
    ego = standing(np.eye(4), instance=EGO_INSTANCE)
    albedo = plain_albedo()
    albedo[:] = (0.5, 0.5, 0.5, 1.0)
    camera = Pinhole(width_px=400, height_px=200, fx_px=2000.0, fy_px=2000.0, cx_px=200.0, cy_px=100.0)
    eye = transforms.from_rotation(transforms.R_FLU_OPTICAL, (3.67, 0.0, 0.65))
    with scene(screen, library=ego_plate(), albedo=albedo) as renderer:
        lit = renderer.radiance_cd_m2(renderer.draw(camera, eye, ego), NIGHT)[..., 1]
        dark = renderer.radiance_cd_m2(renderer.draw(camera, eye, Instances()), NIGHT)[..., 1]

    def lux(right_deg: float, up_deg: float) -> float:
        u = round(200 + 2000 * np.tan(np.radians(right_deg)))
        v = round(100 - 2000 * np.tan(np.radians(up_deg)))
        return float((lit - dark)[v, u] * np.pi / 0.5 / HEADLAMP_LIGHT[1])

    fade = (1.0 - (distance_m / 40.0) ** 4) ** 2
    assert lux(1.15, -0.57) > 12.0 * fade
    assert lux(-3.43, 0.57) < 0.6
    assert lux(0.0, -0.86) > 6.0 * fade


def test_headlamps_light_the_road_ahead_up_to_their_cut_off() -> None:
    """Dry asphalt: about 1 cd/m² and more up to 20 m, and as much per lx as EN 1436 measures at 30 m.

    Roads throw back 5 to 20 mcd/m² per lx across the beam at the standard's 1.24° and 2.29°; a matt
    surface that spreads light evenly would give 0.7.
    """
    ego = standing(np.eye(4), instance=EGO_INSTANCE)
    eye = transforms.from_rotation(transforms.R_FLU_OPTICAL, (1.4, 0.0, 1.6))
    camera = Pinhole(width_px=320, height_px=360, fx_px=640.0, fy_px=640.0, cx_px=160.0, cy_px=20.0)
    with scene(ground(), library=ego_plate()) as renderer:
        seen = renderer.radiance_cd_m2(renderer.draw(camera, eye, ego), NIGHT)[..., 1]

    def luminance(ahead_of_lamps_m: float) -> float:
        return float(seen[round(20 + 640 * 1.6 / (ahead_of_lamps_m + 3.65 - 1.4)), 155:165].mean())

    assert 0.7 < luminance(20.0) < luminance(10.0) < 6.0
    assert 0.2 < luminance(30.0) < luminance(20.0)
    assert luminance(58.0) < 0.1 * luminance(20.0)
    # Intensity of the pair towards the road straight ahead at 30 m, 1.24° down, by the beam's formula.
    intensity_cd = (
        2.0
        * HEADLAMP_COLOUR[1]
        * (
            26000 * (1.0 - ((-1.5 / 2.3) ** 2 + (0.24 / 0.9) ** 2) / 32.0) ** 16
            + 8000 * (1.0 - (0.56 / 1.8) ** 2 / 32.0) ** 16
            + 4200 * (1.0 - (3.26 / 3.5) ** 2 / 32.0) ** 16
        )
    )
    across_lx = intensity_cd / 30.0**2 * (1.0 - (30.0 / BEAM_RANGE_M) ** 4) ** 2
    assert 0.005 < luminance(30.0) / across_lx < 0.020


def test_a_glow_is_whole_where_its_lamp_comes_abreast() -> None:
    """A lamp beside the eye: its glow goes over from rays that lead away to rays that lead past it."""
    ends = make_mesh(
        [[900, 0, 0], [900, 1, 0], [900, 0, 1]], [[0, 1, 2]], material=Material.PLASTIC, tag=Tag.WALL
    )
    camera = Pinhole(width_px=320, height_px=180, fx_px=160.0, fy_px=160.0, cx_px=159.5, cy_px=179.0)

    def sky(*lamps_m: tuple[float, float, float]) -> NDArray[np.float32]:
        lamps = np.array(lamps_m).reshape(-1, 3)
        with scene(ends, quality="medium", lamps_m=lamps) as renderer:
            gbuffer = renderer.draw(camera, FORWARD, Instances())
            return renderer.radiance_cd_m2(gbuffer, PRESETS["RainyNight"])[40:60, :, 1]

    glow = (sky((0.0, 2.5, 3.2)) - sky()).mean(axis=0)
    # Rays at right angles to the lamp's direction lie near column 240 of these rows.
    assert (glow > 0.0).all()
    assert glow[:40].mean() > 1.5 * glow[-40:].mean()
    assert np.abs(np.diff(glow)).max() < 0.03 * glow.mean()
