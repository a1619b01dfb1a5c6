"""What panes mirror of the sky, against Fresnel's formula for two sheets of glass."""

from dataclasses import replace

import numpy as np
from shared_fixtures.worlds.plain_albedo import plain_albedo
from shared_fixtures.worlds.render_scenes import FORWARD, need_opengl, scene, wall

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.lighting.sky_model import hemisphere, sky_light
from carlaloc_env.render.textures.build import build_textures
from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.presets import PRESETS

need_opengl()

CAMERA = Pinhole(width_px=64, height_px=64, fx_px=200.0, fy_px=200.0, cx_px=31.5, cy_px=31.5)
UP_RAD = np.radians(35.0)
OVERCAST = replace(PRESETS["ClearNoon"], cloudiness=100.0)
INDEX = 1.52
"""Refractive index of window glass."""


def seen_cd_m2(material: Material, roughness: float) -> float:
    """Luminance of the top of a black wall 20 m ahead, from below, under a closed sky."""
    albedo = plain_albedo()
    albedo[material] = (0.0, 0.0, 0.0, roughness)
    black = wall(20.0, (-40.0, 0.0), (40.0, 17.0), material=material, tag=Tag.BUILDING)
    pose = FORWARD.copy()
    c, s = np.cos(UP_RAD), np.sin(UP_RAD)
    pose[:3, :3] = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) @ pose[:3, :3]
    with scene(black, albedo=albedo) as renderer:
        light = renderer.radiance_cd_m2(renderer.draw(CAMERA, pose, Instances()), OVERCAST)
    return float(light[30:34, 30:34].mean())


def test_panes_mirror_as_much_of_the_sky_as_two_sheets_of_glass() -> None:
    """Four faces that throw back r each: 4 r / (1 + 3 r) in all, upright light counted with each other."""
    face = ((INDEX - 1.0) / (INDEX + 1.0)) ** 2
    expected = 4.0 * face / (1.0 + 3.0 * face)
    directions, _ = hemisphere()
    away = np.array([-np.cos(UP_RAD), 0.0, np.sin(UP_RAD)])
    near = np.sum(directions * away, axis=-1) > 0.995
    sky = float(sky_light(OVERCAST).sky_cd_m2[near].mean())
    textures = build_textures().albedo
    for material in (Material.GLASS, Material.CURTAIN_WALL, Material.WINDOW):
        panes = float(np.percentile(textures[material, ..., 3].astype(np.float32), 10))
        assert 0.9 * expected < seen_cd_m2(material, panes) / sky < 1.1 * expected


def test_walls_mirror_no_more_than_one_rough_face() -> None:
    directions, _ = hemisphere()
    sky = float(sky_light(OVERCAST).sky_cd_m2[directions[..., 2] > 0.3].mean())
    assert seen_cd_m2(Material.PLASTER, MATERIALS[Material.PLASTER].roughness) < 0.02 * sky
