"""Properties of materials as shaders read them, and the texture array."""

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.render.shader_programs import Programs
from carlaloc_env.render.textures.block_patterns import BLOCK_PATTERNS
from carlaloc_env.scene.materials import Material, material_values
from carlaloc_env.scene.mottle import mottle_table

_LIT_AT_NIGHT = (Material.LAMP_WHITE, Material.LAMP_TAIL)
"""Lamps that are off by day; signals and brake lights are lit whenever they are drawn."""
LOG_SCALE = 16.0
"""Light is stored as log2(1 + cd/m²) / 16, which spans 0…65535 cd/m² in one byte."""


def surface_table() -> NDArray[np.float32]:
    """Roughness, porosity, light by day and night, light at night of every material, (M, 4)."""
    emission = np.log2(1.0 + material_values("emission_cd_m2")) / LOG_SCALE
    by_night = np.zeros(len(Material), dtype=bool)
    by_night[list(_LIT_AT_NIGHT)] = True
    light = np.where(by_night, 0.0, emission), np.where(by_night, emission, 0.0)
    surface = [material_values("roughness"), material_values("porosity"), *light]
    return np.stack(surface, axis=-1).astype(np.float32)


def block_tables() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Blocks of every material as the shaders read them; those that are laid of none are one without tone.

    Returns:
        Columns and rows of a tile, offset of courses, frequency [1/m], (M, 4), and the range of the tones,
        whether the texture's blocks are shuffled, and the mottle, (M, 3).
    """
    blocks, variety = np.tile([1.0, 1.0, 0.0, 0.0], (len(Material), 1)), np.zeros((len(Material), 3))
    variety[:, 2] = mottle_table()[:, 0]
    for material, pattern in BLOCK_PATTERNS.items():
        blocks[material] = pattern.columns, pattern.rows, pattern.offset, pattern.cycles_per_m
        variety[material, :2] = pattern.tone_range, pattern.shuffled
    return blocks.astype(np.float32), variety.astype(np.float32)


def upload_textures(
    programs: Programs, albedo: NDArray[np.float16], *, trilinear: bool
) -> moderngl.TextureArray:
    """Texture array with one layer per material and mip-maps: square root of the albedo, and roughness.

    Bytes take half as long to fetch as half floats. Mip-maps are averaged in linear light first.

    Args:
        programs: Shader programs of the context that it is for.
        albedo: Linear albedo and roughness, shape (M, S, S, 4).
        trilinear: Blend between mip levels; on a CPU it costs as much as the fetch itself.
    """
    context = programs.context
    layers, height, width = albedo.shape[:3]
    array = context.texture_array((width, height, layers), 4)
    array.repeat_x = array.repeat_y = True
    array.build_mipmaps()
    program = programs.compute("roots.comp")
    # Material by material: a driver keeps what was last read from even when it has been released.
    linear = context.texture_array((width, height, 1), 4, dtype="f2")
    for layer in range(layers):
        linear.write(np.ascontiguousarray(albedo[layer], np.float16))
        linear.build_mipmaps()
        linear.filter = (moderngl.NEAREST_MIPMAP_NEAREST, moderngl.NEAREST)
        linear.use(0)
        program["u_layer"] = layer
        for level in range(max(width, height).bit_length()):
            array.bind_to_image(0, read=False, write=True, level=level)
            program["u_level"] = level
            program.run(-(-max(width >> level, 1) // 8), -(-max(height >> level, 1) // 8))
    context.memory_barrier()
    linear.release()
    between = moderngl.LINEAR_MIPMAP_LINEAR if trilinear else moderngl.LINEAR_MIPMAP_NEAREST
    array.filter = (between, moderngl.LINEAR)
    if trilinear:
        array.anisotropy = 8.0
    return array
