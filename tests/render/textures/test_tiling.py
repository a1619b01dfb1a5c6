"""Textures that cover hundreds of tiles show no grid from afar."""

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import need_opengl, scene

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.textures.build import WIDE, build_textures
from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scene.mesh import Instances, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import WeatherParameters

need_opengl()

OVERCAST = WeatherParameters(cloudiness=100.0, fog_density=0.0, mie_scattering_scale=0.0)
PER_TILE = 16
"""Pixels per tile."""
STRIP_M = (100.0, 50.0)
"""Ground in the picture [m]."""
CONTRAST = 0.035
"""Largest contrast of what repeats with the tile."""


def seen_from_above(material: Material) -> NDArray[np.float64]:
    """Linear luminance of a strip of level ground, drawn with the material's texture."""
    px_m = MATERIALS[material].tile_m / PER_TILE
    width, height, eye_m, reach = int(STRIP_M[0] / px_m), int(STRIP_M[1] / px_m), 60.0, 80.0
    square = [[-reach, -reach, 0], [reach, -reach, 0], [reach, reach, 0], [-reach, reach, 0]]
    mesh = make_mesh(square, [[0, 1, 2], [0, 2, 3]], material=material, tag=Tag.TERRAIN)
    focal = eye_m / px_m
    camera = Pinhole(
        width_px=width, height_px=height, fx_px=focal, fy_px=focal, cx_px=width / 2, cy_px=height / 2
    )
    down = transforms.from_rotation(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, eye_m])
    with scene(mesh, quality="medium", albedo=build_textures().albedo) as renderer:
        rgb = renderer.shade(renderer.draw(camera, down, Instances()), OVERCAST).astype(np.float64)
    linear: NDArray[np.float64] = np.sum((rgb / 255.0) ** 2.2 * np.array([0.2126, 0.7152, 0.0722]), axis=-1)
    return linear


def repeating_contrast(luminance: NDArray[np.float64], lag: int) -> float:
    """Deviation of the part of log luminance that repeats after `lag` columns.

    The autocorrelation at the lag, less its mean at three and five quarters of it, is the share of the
    variance that repeats: slow shading is as much alike there, and drops out.
    """
    log = np.log(luminance + 1e-3)
    log -= log.mean()
    alike = [float((log[:, :-k] * log[:, k:]).mean()) for k in (lag, round(0.75 * lag), round(1.25 * lag))]
    return float(np.sqrt(max(alike[0] - 0.5 * (alike[1] + alike[2]), 0.0)))


@pytest.mark.parametrize("material", sorted(WIDE), ids=lambda material: material.name)
def test_no_grid_of_tiles_shows(material: Material) -> None:
    luminance = seen_from_above(material)
    assert np.log(luminance + 1e-3).std() > 0.03
    assert repeating_contrast(luminance, PER_TILE) < CONTRAST
    assert repeating_contrast(luminance.T, PER_TILE) < CONTRAST


def test_contrast_of_a_known_grid_is_measured() -> None:
    """exp(0.1 · √2 · cos) repeats with deviation 0.1; noise that does not repeat adds nothing."""
    x = np.arange(800)
    noise = np.random.default_rng(1).normal(0.0, 0.05, (400, 800))
    wave = np.exp(0.1 * np.sqrt(2.0) * np.cos(2 * np.pi * x / PER_TILE)[None] + noise)
    assert repeating_contrast(wave, PER_TILE) == pytest.approx(0.1, rel=0.05)
    assert repeating_contrast(np.exp(noise), PER_TILE) < 0.01
