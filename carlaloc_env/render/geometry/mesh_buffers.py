"""Meshes on the graphics side: packed vertices, chunks in one buffer, instanced models."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, U32
from carlaloc_env.core.files.array_cache import Arrays, arrays_hash, cached
from carlaloc_env.core.files.shared_arrays import SHARED_FROM_BYTES
from carlaloc_env.core.geometry.transforms import cross
from carlaloc_env.render.geometry.culling.triangle_culling import Body, TriangleCuller, shared
from carlaloc_env.render.geometry.equal_vertices import without_doubles
from carlaloc_env.render.geometry.instance_buffer import InstanceBuffer
from carlaloc_env.render.geometry.material_table import LOG_SCALE
from carlaloc_env.render.gl.context import is_software
from carlaloc_env.render.gl.growing_buffer import GrowingBuffer
from carlaloc_env.scene import materials
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import VERTEX_FIELDS, Mesh

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

_FULL = ("3f4 4f2 2f4 3f1 1u1 1u4", "in_position", "in_normal", "in_uv", "in_colour", "in_material", "in_id")
"""Layout of `VERTEX` and its attributes."""
_BARE = ("3f4 24x", "in_position")
"""The same of the positions alone."""
_POSES = ("4f4 4f4 4f4 4f1 1u4/i", "in_row0", "in_row1", "in_row2", "in_tint", "in_instance")
"""Layout of `instance_buffer.INSTANCE` and its attributes."""
_BARE_POSES = ("4f4 4f4 4f4 8x/i", "in_row0", "in_row1", "in_row2")
"""The same of the poses alone."""

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
KEPT_FILES = 3
"""Cached files of packed models kept, of this version and earlier ones."""


def pack_vertices(mesh: Mesh, out: NDArray[np.void] | None = None) -> NDArray[np.void]:
    """Vertices of a mesh as `VERTEX` rows, shape (V,); in `out` where it is given."""
    if out is None:
        out = np.empty(len(mesh.vertices_m), dtype=VERTEX)
    out["position"] = mesh.vertices_m
    out["normal"][:, :3] = mesh.normals
    out["normal"][:, 3] = lit_windows(mesh)
    out["uv"] = mesh.uv_m / materials.table("tile_m")[mesh.material][:, None]
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
    count = np.array([len(one) for one in triangles[1:]], np.int64)
    return np.concatenate(vertices), np.concatenate(triangles), count


def _joined(meshes: Iterable[Mesh]) -> Arrays:
    """Packed vertices of all meshes without doubles, triangles between them, and each mesh's number."""
    packed, corners, count = _end_to_end(meshes)
    vertices, triangles = without_doubles(packed, corners)
    return {"vertices": vertices.view(np.uint8), "triangles": triangles, "count": count}


def _joined_models(meshes: Sequence[Mesh]) -> Arrays:
    """The same, from the cache if they are large: every renderer begins with the same movable models."""
    fields = ("triangles", *VERTEX_FIELDS)
    parts = {f"{k} {name}": getattr(mesh, name) for k, mesh in enumerate(meshes) for name in fields}
    if sum(part.nbytes for part in parts.values()) < SHARED_FROM_BYTES:
        return _joined(meshes)
    return cached(
        "models",
        "packed",
        module=__name__,
        make=lambda: _joined(meshes),
        to_arrays=lambda made: made,
        from_arrays=lambda found: {name: found[name] for name in ("vertices", "triangles", "count")},
        content=arrays_hash(parts),
        kept_files=KEPT_FILES,
    )


def lit_windows(mesh: Mesh) -> NDArray[np.float64]:
    """Light code (see `surfaces`) of window panes behind which a lamp burns at night, shape (V,).

    A hash of a pane's middle chooses, so that the same windows are lit in every picture and every
    weather. The middle of a triangle's longest edge is the middle of its rectangle, for both halves.
    """
    code = np.zeros(len(mesh.vertices_m))
    panes = mesh.triangles[
        np.isin(mesh.material[mesh.triangles[:, 2]], (Material.WINDOW, Material.WINDOW_WIDE))
    ]
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
    a, b, c = (np.take(vertices_m, triangles[:, k], axis=0) for k in range(3))
    across = cross(b - a, c - a).astype(np.float64)
    area = np.sum(np.sqrt(np.sum(across**2, axis=1)))
    return bool(np.sqrt(np.sum(np.sum(across, axis=0) ** 2)) < _OPEN_SHARE * area)


class MeshBuffers:
    """Triangles in one vertex and one index buffer, drawn in ranges by one indirect call."""

    def __init__(
        self,
        context: moderngl.Context,
        meshes: Iterable[Mesh],
        triangles: NDArray[np.int64] | None = None,
        *,
        models: bool = False,
    ) -> None:
        """Upload meshes.

        Args:
            context: Where they are drawn.
            meshes: All triangles; what an iterator alone holds is let go as soon as it is packed.
            triangles: Number of them in each range that can be drawn alone, shape (N,); a range for
                every mesh when left out.
            models: Whether these are movable models.
        """
        self._context = context
        joined = _joined_models(list(meshes)) if models else _joined(meshes)
        vertices, corners = joined["vertices"].view(VERTEX), joined["triangles"]
        counts = joined["count"] if triangles is None else triangles
        del joined
        self.count = (3 * counts).astype(np.uint32)
        """Number of indices of each range, shape (N,)."""
        self.first = (np.cumsum(3 * counts) - 3 * counts).astype(np.uint32)
        """First index of each range, shape (N,)."""
        # OpenGL refuses empty buffers; one unused vertex stands in for an empty scene.
        self.vertices = context.buffer((vertices if len(vertices) else np.zeros(1, VERTEX)).view(np.uint8))
        self._commands = GrowingBuffer(context, 20 * (len(self.count) + 1))
        self._arrays: dict[tuple[int, int, int], moderngl.VertexArray] = {}
        # A graphics card is done with a triangle sooner than a CPU has found out that it does not show.
        self._body: Body | None = None
        if not is_software(context):
            self._indices = context.buffer(corners if len(corners) else np.zeros(3, np.uint32))
        else:
            place_m = np.ascontiguousarray(vertices["position"])
            solid = seen_from_front(models=models)[vertices["material"][corners[:, 2]]]
            del vertices
            if models:
                ends = zip(np.cumsum(counts), counts, strict=True)
                closed = [_is_closed(place_m, corners[end - count : end]) for end, count in ends]
                solid &= np.repeat(np.array(closed, dtype=bool), counts)
            self._body = shared(Body(vertices_m=place_m, triangles=corners, solid=solid))
            self._picked = GrowingBuffer(context, 12)

    def draw(
        self,
        program: moderngl.Program,
        which: NDArray[np.intp],
        *,
        bare: bool = False,
        instances: InstanceBuffer | None = None,
        culler: TriangleCuller | None = None,
    ) -> None:
        """Draw some of the ranges in the given order, once or once per instance.

        Args:
            program: Shaders.
            which: Ranges.
            bare: Hand over nothing but positions.
            instances: Where the ranges stand; once where they are when left out.
            culler: Leaves triangles out that do not show, if the context draws on a CPU.
        """
        if len(which) == 0:
            return
        if culler is not None and self._body is not None:
            self._draw_culled(program, which, culler, self._body, instances)
            return
        commands = np.zeros((len(which), 5), dtype=np.uint32)
        commands[:, 0] = self.count[which]
        commands[:, 2] = self.first[which]
        commands[:, 1] = 1 if instances is None else instances.number[which]
        if instances is not None:
            commands[:, 4] = instances.begin[which]
        if self._body is None:
            self._run(self._array(program, self._indices, bare, instances), commands)
            return
        # On a CPU the body's file, which processes share, is all that holds the triangles.
        commands[:, 2] = np.cumsum(self.count[which]) - self.count[which]
        corners = _ranges(self._body.triangles, self.first[which], self.count[which])
        if bare and instances is None:
            self._draw_once(program, corners, commands)
            return
        self._picked.write(corners)
        self._run(self._array(program, self._picked.buffer, bare, instances), commands)

    def _draw_once(self, program: moderngl.Program, corners: U32, commands: NDArray[np.uint32]) -> None:
        """Draw positions from a buffer that is not kept: a map of shadows serves for tens of metres."""
        indices = self._context.buffer(corners)
        array = self._context.vertex_array(program, [(self.vertices, *_BARE)], indices)
        self._run(array, commands)
        array.release()
        indices.release()

    def _draw_culled(
        self,
        program: moderngl.Program,
        which: NDArray[np.intp],
        culler: TriangleCuller,
        body: Body,
        instances: InstanceBuffer | None,
    ) -> None:
        if instances is None:
            picked, kept = culler.keep(body, self.first[which], self.count[which])
        else:
            model = instances.model
            picked, kept = culler.keep(body, self.first[model], self.count[model], instances.rows)
        if not len(picked):
            return
        self._picked.write(picked)
        array = self._array(program, self._picked.buffer, False, instances)
        if instances is None:
            array.render(moderngl.TRIANGLES, vertices=len(picked))
            return
        commands = np.zeros((len(kept), 5), dtype=np.uint32)
        commands[:, 0] = kept
        commands[:, 1] = 1
        commands[:, 2] = np.cumsum(kept) - kept
        commands[:, 4] = np.arange(len(kept))
        self._run(array, commands[kept > 0])

    def _run(self, array: moderngl.VertexArray, commands: NDArray[np.uint32]) -> None:
        self._commands.write(commands.tobytes())
        array.render_indirect(self._commands.buffer, mode=moderngl.TRIANGLES, count=len(commands))

    def _array(
        self,
        program: moderngl.Program,
        indices: moderngl.Buffer,
        bare: bool,
        instances: InstanceBuffer | None,
    ) -> moderngl.VertexArray:
        key = (program.glo, indices.glo, 0 if instances is None else instances.buffer.glo)
        if key not in self._arrays:
            content = [(self.vertices, *(_BARE if bare else _FULL))]
            if instances is not None:
                content.append((instances.buffer, *(_BARE_POSES if bare else _POSES)))
            self._arrays[key] = self._context.vertex_array(program, content, indices)
        return self._arrays[key]

    def release(self) -> None:
        """Free the buffers."""
        for array in self._arrays.values():
            array.release()
        self.vertices.release()
        self._commands.release()
        if self._body is None:
            self._indices.release()
        else:
            self._picked.release()


def _ranges(triangles: U32, first: U32, count: U32) -> U32:
    """Triangles (T, 3) of ranges of indices (N,), one range after the other, shape (M, 3)."""
    number = count.astype(np.int64) // 3
    before = np.cumsum(number) - number
    rows = np.repeat(first.astype(np.int64) // 3 - before, number) + np.arange(number.sum())
    return np.take(triangles, rows, axis=0)


def seen_from_front(*, models: bool = False) -> NDArray[np.bool_]:
    """Whether the backs of a material's triangles need no drawing, on scenery or on models, shape (M,)."""
    solid = np.zeros(len(Material), dtype=bool)
    solid[list(_SOLID_MODELS if models else _SOLID_SCENERY)] = True
    return solid
