"""Meshes as graphics take them: packed vertices without doubles, made once and kept in the cache."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, U32
from carlaloc_env.core.files.array_cache import cached
from carlaloc_env.core.files.array_files import Arrays, arrays_hash
from carlaloc_env.core.files.shared_arrays import SHARED_FROM_BYTES, read_only
from carlaloc_env.core.freed_memory import give_back_mapped_pages
from carlaloc_env.render.geometry.distant_models import simplified
from carlaloc_env.render.geometry.material_tables import LOG_SCALE
from carlaloc_env.render.geometry.unique_vertices import without_doubles
from carlaloc_env.scene.materials import Material, material_values
from carlaloc_env.scene.mesh import VERTEX_FIELDS, Mesh, face_vectors

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
    packed_arrays = cached(
        name,
        "packed",
        module=module,
        make=make,
        to_arrays=lambda made: made,
        from_arrays=lambda arrays: arrays,
        content=content + mark,
        kept_files=kept_files,
    )
    return read_only(packed_arrays)


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
