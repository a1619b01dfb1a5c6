"""Uniforms of fragment shaders as flat varyings, for drivers that fetch uniforms pixel by pixel.

llvmpipe (Mesa 22) loads every word of a uniform eight times for eight pixels, with a bounds check each,
some 25 instructions; a flat varying is one broadcast. The vertex shader hands the values over.
"""

from __future__ import annotations

import re

from carlaloc_env.core.errors import RenderError

_UNIFORM = re.compile(r"^uniform ((?:u?int|float|u?vec[234]|mat[234]) (\w+)(?:\[\w+\])?;)")
"""A uniform that becomes a varying."""
_OPAQUE = re.compile(r"^(?:layout\([^)]*\) )?(?:readonly )?uniform [iu]?(?:sampler|image)\w+ \w+;")
"""A texture or image, which stays a uniform."""
_DIRECTIVE = re.compile(r"^#(ifdef|ifndef|else|endif|define)\b *(\w*)")
"""A directive that this module follows."""
_MAIN = "void main() {\n"
"""Where the vertex shader begins to run."""


def hoisted(vertex: str, fragment: str, defined: set[str]) -> tuple[str, str]:
    """Vertex and fragment shader in which pixels read no uniform but textures and images.

    Args:
        vertex: Source without `#version`, with one `void main() {` line.
        fragment: Source without `#version`, uniforms declared one to a line.
        defined: Names that both have defined.

    Raises:
        RenderError: a line that declares uniforms or a condition is not in a form that is understood here.
    """
    wanted = _uniforms(fragment, defined)
    known = _uniforms(vertex, defined)
    renamed, outputs, copies = [], [], []
    lines = fragment.split("\n")
    for name, (row, declaration) in wanted.items():
        lines[row] = "flat in " + declaration
        renamed.append(f"#define {name} flat_{name}\n")
        if name not in known:
            outputs.append(f"uniform {declaration}\n")
        outputs.append(f"flat out {declaration.replace(name, f'flat_{name}', 1)}\n")
        copies.append(f"    flat_{name} = {name};\n")
    if vertex.count(_MAIN) != 1:
        raise RenderError(f"a vertex shader needs the line '{_MAIN.strip()}' once")
    before, after = vertex.split(_MAIN)
    vertex = before + "".join(outputs) + _MAIN + "".join(copies) + after
    return vertex, "".join(renamed) + "\n".join(lines)


def _uniforms(source: str, defined: set[str]) -> dict[str, tuple[int, str]]:
    """Line number and declaration, after the word `uniform`, of the uniforms that are compiled in."""
    defined, active = set(defined), [True]
    found = {}
    for row, line in enumerate(source.split("\n")):
        code = line.split("//")[0].strip()
        if code.startswith("#"):
            _follow(line, defined, active)
        elif re.search(r"\buniform\b", code):
            uniform = _UNIFORM.match(line)
            if uniform is None and not _OPAQUE.match(line):
                raise RenderError(f"declare one uniform to a line, as 'uniform vec3 u_name;', not '{code}'")
            if uniform is not None and all(active):
                found[uniform[2]] = (row, uniform[1])
    if len(active) != 1:
        raise RenderError("a shader has an #ifdef without #endif")
    return found


def _follow(line: str, defined: set[str], active: list[bool]) -> None:
    """Take a directive into account: names that are defined, and which lines are compiled in."""
    directive = _DIRECTIVE.match(line)
    if directive is None:
        raise RenderError(f"use #ifdef, #ifndef, #else, #endif and #define in shaders, not '{line.strip()}'")
    word, name = directive.groups()
    if word in ("ifdef", "ifndef"):
        active.append((name in defined) == (word == "ifdef"))
    elif word == "define":
        if all(active):
            defined.add(name)
    elif len(active) == 1:
        raise RenderError(f"a shader has an #{word} without #ifdef")
    elif word == "else":
        active[-1] = not active[-1]
    else:
        active.pop()
