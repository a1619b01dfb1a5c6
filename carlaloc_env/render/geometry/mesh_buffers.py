"""Meshes on the graphics side: triangles in one buffer, drawn in ranges, once or once per instance."""

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U32
from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.core.freed_memory import give_back_mapped_pages
from carlaloc_env.render.geometry.instance_buffer import InstanceBuffer
from carlaloc_env.render.geometry.packed_meshes import VERTEX
from carlaloc_env.render.geometry.triangle_culling import Body, TriangleCuller
from carlaloc_env.render.gl_context import is_software
from carlaloc_env.render.growing_buffer import GrowingBuffer

_FULL = ("3f4 4f2 2f4 3f1 1u1 1u4", "in_position", "in_normal", "in_uv", "in_colour", "in_material", "in_id")
"""Layout of `VERTEX` and its attributes."""
_BARE = ("3f4 24x", "in_position")
"""The same of the positions alone."""
_BARE_MATERIAL = ("3f4 19x 1u1 4x", "in_position", "in_material")
"""The same of positions and materials."""
_POSES = ("4f4 4f4 4f4 4f1 1u4/i", "in_row0", "in_row1", "in_row2", "in_tint", "in_instance")
"""Layout of `instance_buffer.INSTANCE` and its attributes."""
_BARE_POSES = ("4f4 4f4 4f4 8x/i", "in_row0", "in_row1", "in_row2")
"""The same of the poses alone."""


class MeshBuffers:
    """Triangles in one vertex and one index buffer, drawn in ranges by one indirect call."""

    def __init__(self, context: moderngl.Context, arrays: Arrays) -> None:
        """Upload what `packed_meshes.packed` has made."""
        self._context = context
        count, vertices, corners = arrays["count"], arrays["vertices"], arrays["triangles"]
        self.count = (3 * count).astype(np.uint32)
        """Number of indices of each range, shape (N,)."""
        self.first = (np.cumsum(3 * count) - 3 * count).astype(np.uint32)
        """First index of each range, shape (N,)."""
        # OpenGL refuses empty buffers; one unused vertex stands in for an empty scene.
        self.vertices = context.buffer(vertices if len(vertices) else np.zeros(1, VERTEX).view(np.uint8))
        self._commands = GrowingBuffer(context, 20 * (len(self.count) + 1))
        self._arrays: dict[tuple[int, int, int], moderngl.VertexArray] = {}
        # A graphics card is done with a triangle sooner than a CPU has found out that it does not show.
        self._body: Body | None = None
        if not is_software(context):
            self._indices = context.buffer(corners if len(corners) else np.zeros(3, np.uint32))
        else:
            self._body = Body(vertices_m=arrays["place_m"], triangles=corners, solid=arrays["solid"])
            self._picked = GrowingBuffer(context, 12)
        give_back_mapped_pages(vertices)

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
            bare: Hand over nothing but positions, and materials where the program heeds them.
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
        first = self.first[which] // 3
        rows = ranges(first, first + self.count[which] // 3)
        corners = np.take(self._body.triangles, rows, axis=0)
        if bare and instances is None:
            self._draw_once(program, corners, commands)
            return
        self._picked.write(corners)
        self._run(self._array(program, self._picked.buffer, bare, instances), commands)

    def _draw_once(self, program: moderngl.Program, corners: U32, commands: NDArray[np.uint32]) -> None:
        """Draw positions from a buffer that is not kept: a map of shadows serves for tens of metres."""
        indices = self._context.buffer(corners)
        array = self._context.vertex_array(program, [(self.vertices, *_bare(program))], indices)
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
            content = [(self.vertices, *(_bare(program) if bare else _FULL))]
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


def _bare(program: moderngl.Program) -> tuple[str, ...]:
    return _BARE if program.get("in_material", None) is None else _BARE_MATERIAL


def ranges(begin: NDArray[np.integer], end: NDArray[np.integer]) -> NDArray[np.int64]:
    """The numbers of some ranges (N,), one range after the other, shape (M,)."""
    number = end.astype(np.int64) - begin
    before = np.cumsum(number) - number
    return np.repeat(begin - before, number) + np.arange(number.sum())
