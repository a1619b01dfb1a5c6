"""The OpenGL context: headless by EGL, and one clear line when there is none.

Contexts and their compiled programs, handed on from a closed renderer to the next one.

Mesa 22.3 keeps about 40 kB of every context that is released, and 18 kB of every program; and compiling them
again is most of what a second renderer takes.

A buffer of OpenGL that is rewritten for every drawing and grows with what it holds.

Uniforms of fragment shaders as flat varyings, for drivers that fetch uniforms pixel by pixel.

llvmpipe (Mesa 22) loads every word of a uniform eight times for eight pixels, with a bounds check each,
some 25 instructions; a flat varying is one broadcast. The vertex shader hands the values over.
"""

import os
import re
from collections import defaultdict
from contextlib import suppress
from importlib import import_module, resources
from typing import Any

import moderngl
import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core.errors import RenderError

_UNIFORM = re.compile(r"^uniform ((?:u?int|float|u?vec[234]|mat[234]) (\w+)(?:\[\w+\])?;)", re.MULTILINE)
"""A uniform that becomes a varying; textures and images stay."""
_MAIN = "void main() {\n"
"""Where the vertex shader begins to run."""


def hoisted(vertex: str, fragment: str) -> tuple[str, str]:
    """Vertex and fragment shader in which pixels read no uniform but textures and images.

    Args:
        vertex: Source without `#version`, with one `void main() {` line.
        fragment: Source without `#version`, uniforms declared one to a line.
    """
    known = {uniform[2] for uniform in _UNIFORM.finditer(vertex)}
    renamed, declared, copied = "", "", ""
    for line in fragment.split("\n"):
        if uniform := _UNIFORM.match(line):
            declaration, name = uniform.groups()
            renamed += f"#define {name} flat_{name}\n"
            declared += "" if name in known else f"uniform {declaration}\n"
            declared += f"flat out {declaration.replace(name, f'flat_{name}', 1)}\n"
            copied += f"    flat_{name} = {name};\n"
        elif line.startswith("#"):
            # Both are compiled under the conditions of the fragment shader.
            declared += line + "\n"
            copied += "" if line.startswith("#define") else line + "\n"
    before, after = vertex.split(_MAIN)
    return f"{before}{declared}{_MAIN}{copied}{after}", renamed + _UNIFORM.sub(r"flat in \1", fragment)


PACKAGES = "libegl1 libgl1 libgl1-mesa-dri"
"""Debian and Ubuntu packages that bring OpenGL to a machine without a GPU."""


VERSION = 430
"""Version of OpenGL that is needed."""
_INCLUDE = re.compile(r'^#include "(.+)"$', re.MULTILINE)
"""A line of GLSL that stands for the text of another file."""


def create_context() -> moderngl.Context:
    """A context of its own, not bound to any window.

    The device of a machine with several GPUs is chosen by ``GLCONTEXT_DEVICE_INDEX``.

    Raises:
        RenderError: there is no OpenGL 4.3; the message names the packages to install.
    """
    _load_triton_first()
    index = int(os.environ.get("GLCONTEXT_DEVICE_INDEX", "0"))
    settings: Any = {"backend": "egl", "device_index": index}
    try:
        # NVIDIA's driver gives the version that is asked for and none above it.
        return moderngl.create_context(standalone=True, require=VERSION, **settings)
    except Exception as error:
        # glcontext and moderngl raise bare Exceptions here.
        raise RenderError(
            f"no OpenGL {VERSION // 100}.{VERSION // 10 % 10} for pictures ({error}); "
            f"apt-get install {PACKAGES}, and unset GALLIUM_DRIVER"
        ) from error


def _load_triton_first() -> None:
    """Load Triton, the compiler of PyTorch, before Mesa, where it is installed (0.3 s).

    Both bring a LLVM. Mesa's is visible to all that is loaded later, and PyTorch, which loads Triton only
    when a first optimiser is made, would crash on it.
    """
    with suppress(ImportError):
        import_module("triton")


def is_software(context: moderngl.Context) -> bool:
    """Whether the context draws on the CPU, where texture filters are dear."""
    renderer = str(context.info["GL_RENDERER"]).lower()
    return "llvmpipe" in renderer or "softpipe" in renderer


def shader_source(name: str) -> str:
    """Text of a file in ``render/shaders`` with its ``#include "file"`` lines replaced."""
    path = resources.files("carlaloc_env.render").joinpath("shaders", name)
    text = path.read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda match: shader_source(match[1]), text)


def glsl(value: ArrayLike) -> str:
    """A number, or two to four of them as a vector, as GLSL has it: to the bit in single precision."""
    numbers = [np.format_float_positional(x, trim="0") for x in np.atleast_1d(np.asarray(value, np.float32))]
    return f"({numbers[0]})" if len(numbers) == 1 else f"vec{len(numbers)}({', '.join(numbers)})"


class Programs:
    """Shader programs by file names and features, compiled when first asked for.

    llvmpipe runs both sides of a branch, so every feature is a ``#define``, never a uniform.
    """

    def __init__(self, context: moderngl.Context, constants: tuple[str, ...] = ()) -> None:
        """Make ready; every program has the constants, a name and a value each, defined."""
        self.context = context
        self.constants = constants
        self._head = "#version 430 core\n" + "".join(f"#define {constant}\n" for constant in constants)
        self._hoists = is_software(context)
        self._programs: dict[tuple[str, str, tuple[str, ...]], moderngl.Program] = {}
        self._compute: dict[str, moderngl.ComputeShader] = {}

    def get(self, vertex: str, fragment: str, *features: str) -> moderngl.Program:
        """Program of two shader files with some features defined."""
        key = (vertex, fragment, features)
        if key not in self._programs:
            head = self._head + "".join(f"#define {feature}\n" for feature in features)
            common = shader_source("packing.glsl")
            sources = shader_source(vertex), shader_source(fragment)
            if self._hoists:
                sources = hoisted(*sources)
            self._programs[key] = self.context.program(
                vertex_shader=head + common + sources[0], fragment_shader=head + common + sources[1]
            )
        return self._programs[key]

    def compute(self, name: str) -> moderngl.ComputeShader:
        """Compute shader of a file."""
        if name not in self._compute:
            self._compute[name] = self.context.compute_shader(shader_source(name))
        return self._compute[name]


def set_uniforms(program: moderngl.Program, **values: object) -> None:
    """Set uniforms that the program uses; the compiler drops those that a variant does not need."""
    for name, value in values.items():
        member: Any = program.get(name, None)
        if member is None:
            continue
        if isinstance(value, bytes):
            member.write(value)
        else:
            member.value = value


_kept: defaultdict[tuple[int, str, tuple[str, ...]], list[Programs]] = defaultdict(list)
"""Programs ready for use, by process (a context does not survive a fork), device and constants."""


def take_programs(constants: tuple[str, ...]) -> Programs:
    """Programs of a context that no other renderer draws with.

    Args:
        constants: Definitions of every program, a name and a value each.

    Raises:
        RenderError: there is no OpenGL 4.3.
    """
    try:
        return _kept[_key(constants)].pop()
    except IndexError:
        return Programs(create_context(), constants)


def give_back(programs: Programs) -> None:
    """Hand programs and their context on; all that was made in it beside them has been released."""
    _kept[_key(programs.constants)].append(programs)


def _key(constants: tuple[str, ...]) -> tuple[int, str, tuple[str, ...]]:
    return os.getpid(), os.environ.get("GLCONTEXT_DEVICE_INDEX", "0"), constants


class GrowingBuffer:
    """Room that is at least as large as what was last written.

    Vertex arrays name buffers, so a buffer that has become too small lives on until all are released; sizes
    double, so that all of those together are no larger than the last.
    """

    def __init__(self, context: moderngl.Context, size: int) -> None:
        """Room for some bytes."""
        self._context = context
        self._all = [context.buffer(reserve=size, dynamic=True)]

    @property
    def buffer(self) -> moderngl.Buffer:
        """Where it was last written."""
        return self._all[-1]

    def write(self, data: Any) -> None:
        """Write an array or bytes from the beginning; what is being drawn keeps what stood there."""
        size = memoryview(data).nbytes
        if size > self.buffer.size:
            self._all.append(self._context.buffer(reserve=2 * size, dynamic=True))
        self.buffer.orphan()
        self.buffer.write(data)

    def release(self) -> None:
        """Free it."""
        for buffer in self._all:
            buffer.release()
