"""Fronts of masonry, panels, boards and glass differ from one tile of the texture to the next."""

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import need_opengl, scene

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.textures.build import build_textures
from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scene.mesh import Instances, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import WeatherParameters

need_opengl()

OVERCAST = WeatherParameters(cloudiness=100.0, fog_density=0.0, mie_scattering_scale=0.0)
TILES, PER_TILE = 6, 136
"""Tiles along the picture's edge, and pixels of a tile."""


def front(material: Material) -> NDArray[np.float64]:
    """Logarithm of the luminance of a wall, seen square on."""
    edge_m = TILES * MATERIALS[material].tile_m
    reach = 0.7 * edge_m
    wall = [[10, reach, -reach], [10, -reach, -reach], [10, -reach, reach], [10, reach, reach]]
    along_and_up = np.array(wall, np.float64)[:, 1:] * [-1.0, 1.0]
    mesh = make_mesh(wall, [[0, 1, 2], [0, 2, 3]], uv_m=along_and_up, material=material, tag=Tag.BUILDING)
    edge_px = TILES * PER_TILE
    focal = 10.0 * edge_px / edge_m
    middle = edge_px / 2
    camera = Pinhole(
        width_px=edge_px, height_px=edge_px, fx_px=focal, fy_px=focal, cx_px=middle, cy_px=middle
    )
    ahead = transforms.from_rotation(transforms.R_FLU_OPTICAL, [0.0, 0.0, 0.0])
    with scene(mesh, quality="medium", albedo=build_textures().albedo) as renderer:
        rgb = renderer.shade(renderer.draw(camera, ahead, Instances()), OVERCAST).astype(np.float64)
    log: NDArray[np.float64] = np.log((rgb / 255.0) ** 2.2 @ np.array([0.2126, 0.7152, 0.0722]) + 1e-3)
    return log


@pytest.mark.parametrize(
    ("material", "share"),
    [
        (Material.BRICK_RED, 0.30),
        (Material.ASHLAR, 0.24),
        (Material.CURTAIN_WALL, 0.14),
        (Material.CONCRETE_PANEL, 0.44),
        (Material.SIDING, 0.30),
        (Material.RUBBLE, 0.40),
    ],
)
def test_a_tile_is_not_the_next_one(material: Material, share: float) -> None:
    """A tile of the texture differs from the others by a share of the picture's variance.

    With the shader's tones, places and waves of field stones taken out, all tiles are one picture but for
    shade and filtering: 0.10, 0.15, 0.09, 0.29, 0.03 and 0.18, and without the places alone 0.39 of the
    panels and 0.16 of the boards. With them 0.40, 0.34, 0.18, 0.56, 0.58 and 0.81.
    """
    picture = front(material)
    tiles = picture.reshape(TILES, PER_TILE, TILES, PER_TILE).transpose(0, 2, 1, 3)
    differ = (tiles - tiles.mean((2, 3), keepdims=True)).var((0, 1)).mean()
    assert differ / picture.var() > share


def test_field_stones_differ_from_their_neighbours() -> None:
    """They show near and far, as other masonry does; 0.09 and 0.07 with the texture alone."""
    picture = front(Material.RUBBLE)
    stones = picture.reshape(len(picture) // 8, 8, len(picture) // 8, 8).mean(axis=(1, 3))
    assert 0.12 < picture.std() < 0.50
    assert stones.std() > 0.09
