"""Meshes as graphics take them: packed vertices without doubles, made once and kept in the cache.

Vertices that are equal in every attribute, made one: levels of detail share what they have in common.

Material properties as the shaders want them, and the texture array.
"""

from collections.abc import Callable, Iterable, Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, U32
from carlaloc_env.core.files.array_cache import cached
from carlaloc_env.core.files.array_files import Arrays, arrays_hash
from carlaloc_env.core.files.shared_arrays import SHARED_FROM_BYTES, read_only
from carlaloc_env.core.freed_memory import give_back_mapped_pages
from carlaloc_env.core.jit import compiled
from carlaloc_env.render.geometry.level_of_detail import simplified
from carlaloc_env.render.gl_context import Programs
from carlaloc_env.render.textures.ground import BLOCK_PATTERNS
from carlaloc_env.scene.materials import Material, material_values
from carlaloc_env.scene.mesh import VERTEX_FIELDS, Mesh, face_vectors
from carlaloc_env.scene.mottle import mottle_table

_FACTOR = 0x9E3779B97F4A7C15
"""Odd number near 2⁶⁴ divided by the golden ratio, by which hashes are mixed (Knuth, TAOCP 3, 6.4)."""


def without_doubles(vertices: NDArray[np.void], triangles: U32) -> tuple[NDArray[np.void], U32]:
    """The first of all equal vertices, in their order, and the triangles between these.

    Args:
        vertices: Packed vertices of a whole number of 32-bit words, shape (V,).
        triangles: Corner indices, shape (T, 3).

    Returns:
        Vertices of which no two have the same bytes, shape (U,), and triangles, shape (T, 3).
    """
    words = vertices.view(np.uint32).reshape(len(vertices), vertices.itemsize // 4)
    number, kept = np.empty(len(vertices), np.uint32), np.empty(len(vertices), np.uint32)
    # Half of a hash table stays empty, so that most searches end at once. It is freed right after.
    count = _number(words, np.zeros(1 << (2 * len(vertices)).bit_length(), np.uint32), number, kept)
    return vertices[kept[:count]], np.take(number, triangles)


@compiled
def _number(words: U32, slots: U32, number: U32, kept: U32) -> int:
    """Number different rows by their first appearance, and count them.

    Args:
        words: Rows, shape (V, W).
        slots: Zeros, more than V, a power of two; becomes a hash table of numbers plus one.
        number: Receives the number of each row, shape (V,).
        kept: Receives the first row of each number, shape (V,).
    """
    count, last = 0, np.uint64(len(slots) - 1)
    for v in range(len(words)):
        key = np.uint64(0)
        for w in range(words.shape[1]):
            key = (key ^ np.uint64(words[v, w])) * np.uint64(_FACTOR)
            key ^= key >> np.uint64(29)
        at = key & last
        while True:
            other = slots[at]
            if other == 0:
                kept[count], number[v] = v, count
                count += 1
                slots[at] = count
                break
            equal = True
            for w in range(words.shape[1]):
                equal = equal and words[kept[other - 1], w] == words[v, w]
            if equal:
                number[v] = other - 1
                break
            at = (at + np.uint64(1)) & last
    return count


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


VERTEX = np.dtype(
    [
        ("position", "<f4", 3),
        ("normal", "<f2", 4),
        ("uv", "<f4", 2),
        ("colour", "u1", 3),
        ("material", "u1"),
        ("id", "<u4"),
    ]
)
"""One packed vertex, 36 bytes; `uv` counts texture repeats, `id` is tag << 24 | instance."""

PACKED = ("vertices", "place_m", "triangles", "count", "solid")
"""Arrays of packed meshes: see `packed`."""
_SOLID_SCENERY = (
    Material.ASPHALT, Material.ASPHALT_OLD, Material.ASPHALT_MOTORWAY,
    Material.ROAD_PAINT_WHITE, Material.ROAD_PAINT_YELLOW,
    Material.PAVEMENT, Material.KERB, Material.SOIL, Material.GRAVEL, Material.BRICK_RED,
    Material.BRICK_BROWN, Material.PLASTER, Material.ASHLAR, Material.CONCRETE_PANEL, Material.SIDING,
    Material.CURTAIN_WALL, Material.WINDOW, Material.WINDOW_WIDE, Material.SHOP_FRONT,
    Material.SHOP_FRONT_B, Material.SHOP_SIGN, Material.DOOR, Material.ROOF_TILE,
    Material.ROOF_FLAT, Material.METAL_PAINTED, Material.METAL_GALVANISED, Material.WOOD, Material.BARK,
)  # fmt: skip
"""Materials of closed bodies and of roads: their backs are never seen and need not be drawn."""
_SOLID_MODELS = (
    Material.CAR_PAINT, Material.METAL_PAINTED, Material.METAL_GALVANISED, Material.CLOTH, Material.SKIN,
)  # fmt: skip
"""The same of closed movable models; their plastic, rubber and glass are sheets too."""
_OPEN_SHARE = 0.1
"""Share of a body's area that may be missing."""


def pack_vertices(mesh: Mesh) -> NDArray[np.void]:
    """Vertices of a mesh as `VERTEX` rows, shape (V,)."""
    out = np.empty(len(mesh.vertices_m), dtype=VERTEX)
    out["position"] = mesh.vertices_m
    out["normal"][:, :3] = mesh.normals
    out["normal"][:, 3] = lit_windows(mesh)
    out["uv"] = mesh.uv_m / material_values("tile_m")[mesh.material][:, None]
    out["colour"] = mesh.colour
    out["material"] = mesh.material
    out["id"] = (mesh.tag.astype(np.uint32) << np.uint32(24)) | (mesh.instance & np.uint32(0xFFFFFF))
    return out


def _end_to_end(meshes: Iterable[Mesh]) -> tuple[NDArray[np.void], U32, NDArray[np.int64]]:
    """Packed vertices of all meshes, (V,), triangles between them, (T, 3), and each mesh's number of them."""
    begin = 0
    vertices, triangles = [np.zeros(0, VERTEX)], [np.zeros((0, 3), np.uint32)]
    for mesh in meshes:
        vertices.append(pack_vertices(mesh))
        triangles.append(mesh.triangles + np.uint32(begin))
        begin += len(mesh.vertices_m)
    count = np.array([len(part) for part in triangles[1:]], np.int64)
    return np.concatenate(vertices), np.concatenate(triangles), count


def packed(
    meshes: Iterable[Mesh], triangles: NDArray[np.int64] | None = None, *, models: bool = False
) -> Arrays:
    """Meshes packed into one buffer.

    Args:
        meshes: All triangles; what an iterator alone holds is let go as soon as it is packed.
        triangles: Number of them in each range that can be drawn alone, shape (N,); a range for
            every mesh when left out.
        models: Whether these are movable models.

    Returns:
        Bytes of the different vertices (`VERTEX`) as ``vertices``, their places [m] (V, 3) as ``place_m``,
        ``triangles`` between them (T, 3), ``count`` of each range (N,), and as ``solid`` whether the back of
        a triangle is never seen (T,).
    """
    doubled, corners, per_mesh = _end_to_end(meshes)
    vertices, corners = without_doubles(doubled, corners)
    del doubled
    count = per_mesh if triangles is None else triangles
    place_m = np.ascontiguousarray(vertices["position"])
    solid = seen_from_front(models=models)[vertices["material"][corners[:, 2]]]
    if models:
        ends = zip(np.cumsum(count), count, strict=True)
        closed = [_is_closed(place_m, corners[end - number : end]) for end, number in ends]
        solid &= np.repeat(np.array(closed, dtype=bool), count)
    return dict(zip(PACKED, (vertices.view(np.uint8), place_m, corners, count, solid), strict=True))


def kept(
    name: str,
    meshes: Sequence[Mesh],
    make: Callable[[], Arrays],
    *,
    module: str,
    content: str,
    kept_files: int,
) -> Arrays:
    """Read-only arrays that are made of large meshes, from the cache, where processes share them.

    Args:
        name: Beginning of the file's name.
        meshes: Meshes that they are made of.
        make: Makes them.
        module: Module that makes them.
        content: Text of the other things that they depend on.
        kept_files: Files of this name that are kept.
    """
    fields = ("triangles", *VERTEX_FIELDS)
    parts = {f"{k} {field}": getattr(mesh, field) for k, mesh in enumerate(meshes) for field in fields}
    if sum(part.nbytes for part in parts.values()) < SHARED_FROM_BYTES:
        return read_only(make())
    mark = arrays_hash(parts)
    for part in parts.values():
        give_back_mapped_pages(part)
    found = cached(
        name,
        "packed",
        module=module,
        make=make,
        to_arrays=lambda made: made,
        from_arrays=lambda arrays: arrays,
        content=content + mark,
        kept_files=kept_files,
    )
    return read_only(found)


def packed_models(meshes: Sequence[Mesh], simpler: Sequence[tuple[int, int]] = ()) -> Arrays:
    """The same of movable models, and simpler ones of some of them (`Distant.simplified`), from the cache."""
    return kept(
        "models",
        meshes,
        lambda: packed([*meshes, *(simplified(meshes[k], cells) for k, cells in simpler)], models=True),
        module=__name__,
        content=repr(simpler),
        kept_files=6,
    )


def lit_windows(mesh: Mesh) -> NDArray[np.float64]:
    """Light code (see `surfaces`) of window panes behind which a lamp burns at night, shape (V,).

    A hash of a pane's middle chooses, so that the same windows are lit in every picture and every
    weather. The middle of a triangle's longest edge is the middle of its rectangle, for both halves.
    """
    code = np.zeros(len(mesh.vertices_m))
    material = mesh.material[mesh.triangles[:, 2]]
    panes = mesh.triangles[np.isin(material, (Material.WINDOW, Material.WINDOW_WIDE))]
    a, b = mesh.vertices_m[panes], mesh.vertices_m[np.roll(panes, -1, axis=1)]
    longest = np.argmax(np.sum((a - b) ** 2, axis=2), axis=1)
    rows = np.arange(len(panes))
    middle = np.rint((a + b)[rows, longest] * 4.0).astype(np.int64)
    key = np.zeros(len(panes), dtype=np.uint64)
    for axis in range(3):
        key = (key ^ middle[:, axis].astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    lot = (key >> np.uint64(11)) / float(1 << 53)
    # 18 % of the panes shine, with 1.5 to 8 cd/m² (curtains drawn).
    glow = np.where(lot < 0.18, 1.5 + 36.0 * lot, 0.0)
    code[panes] = (np.log2(1.0 + glow) / LOG_SCALE)[:, None]
    return code


def _is_closed(vertices_m: F32, triangles: U32) -> bool:
    """Whether a body is closed: then the areas of its triangles (T, 3) add up to nothing."""
    across = face_vectors(vertices_m, triangles).astype(np.float64)
    area = np.sum(np.sqrt(np.sum(across**2, axis=1)))
    return bool(np.sqrt(np.sum(np.sum(across, axis=0) ** 2)) < _OPEN_SHARE * area)


def seen_from_front(*, models: bool = False) -> NDArray[np.bool_]:
    """Whether the backs of a material's triangles need no drawing, on scenery or on models, shape (M,)."""
    solid = np.zeros(len(Material), dtype=bool)
    solid[list(_SOLID_MODELS if models else _SOLID_SCENERY)] = True
    return solid
