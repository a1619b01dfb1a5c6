"""Scenes of a few quads before one camera, for tests of the renderer."""

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from shared_fixtures.worlds.plain_albedo import plain_albedo

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import RenderError
from carlaloc_env.render.gl_context import create_context
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import WeatherParameters

CAMERA = Pinhole(width_px=320, height_px=180, fx_px=160.0, fy_px=160.0, cx_px=160.0, cy_px=90.0)
EYE_M = (0.0, 0.0, 1.6)
FORWARD = transforms.from_rotation(transforms.R_FLU_OPTICAL, EYE_M)
"""A camera 1.6 m above the origin that looks east."""
SUNLESS = WeatherParameters(cloudiness=100.0, fog_density=0.0, mie_scattering_scale=0.0)


def need_opengl() -> None:
    """Skip the whole module, with the reason, where there is no OpenGL."""
    try:
        create_context().release()
    except RenderError as no_opengl:
        pytest.skip(str(no_opengl), allow_module_level=True)


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


def standing(*T: ArrayLike, model: int = 0, instance: int = 1, tint: ArrayLike = 99) -> Instances:
    """Instances of one model at poses (4, 4), with ids from `instance` on."""
    count = len(T)
    return Instances(
        model=np.full(count, model, np.int32),
        T_world_model=np.array(T, np.float64).reshape(count, 4, 4),
        instance=np.arange(instance, instance + count, dtype=np.uint32),
        tint=np.full((count, 3), tint, np.uint8),
    )


def ego_plate() -> ModelLibrary:
    """A model so small that of the ego only its headlamps show."""
    plate = [[0, -1, 0], [0, 1, 0], [0, 1, 0.01]]
    return ModelLibrary({"ego": make_mesh(plate, [[0, 1, 2]], material=Material.PLASTIC, tag=Tag.CAR)})


def rays_z1(camera: Pinhole) -> NDArray[np.float64]:
    """Directions through all pixel centres in the optical frame, z = 1, shape (H, W, 3)."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(np.float64)
    x, y = (u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1)
