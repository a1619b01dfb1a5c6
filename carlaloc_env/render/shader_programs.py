"""Shader programs of a context, compiled when first asked for, and handed from a closed renderer to the next.

Mesa 22.3 keeps about 40 kB of every context that is released, and 18 kB of every program. Compiling them
again is most of the time that a second renderer takes.
"""

import os
import re
from collections import defaultdict
from importlib import resources
from typing import Any

import moderngl
import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.render.flat_uniforms import hoisted
from carlaloc_env.render.gl_context import create_context, is_software

_INCLUDE = re.compile(r'^#include "(.+)"$', re.MULTILINE)
"""A line of GLSL that stands for the text of another file."""


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
