"""Uniforms of fragment shaders as flat varyings, for drivers that fetch uniforms pixel by pixel.

llvmpipe (Mesa 22) loads every word of a uniform eight times for eight pixels, with a bounds check each,
some 25 instructions; a flat varying is one broadcast. The vertex shader hands the values over.
"""

from __future__ import annotations

import re

_UNIFORM = re.compile(r"^uniform ((?:u?int|float|u?vec[234]|mat[234]) (\w+)(?:\[\w+\])?;)")
_DIRECTIVE = re.compile(r"^#(ifdef|ifndef|else|endif|define)\b *(\w*)")
_MAIN = "void main() {\n"


def hoisted(vertex: str, fragment: str, defined: set[str]) -> tuple[str, str]:
    """Vertex and fragment shader in which pixels read no uniform but textures, images and blocks.

    Args:
        vertex: Source without `#version`, with one `void main() {` line.
        fragment: Source without `#version`, uniforms declared one to a line.
        defined: Names that both have defined.
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
    before, after = vertex.split(_MAIN)
    vertex = before + "".join(outputs) + _MAIN + "".join(copies) + after
    return vertex, "".join(renamed) + "\n".join(lines)


def _uniforms(source: str, defined: set[str]) -> dict[str, tuple[int, str]]:
    """Line number and declaration, after the word `uniform`, of the uniforms that are compiled in."""
    defined, active = set(defined), [True]
    found = {}
    for row, line in enumerate(source.split("\n")):
        directive = _DIRECTIVE.match(line)
        if directive is not None:
            word, name = directive.groups()
            if word in ("ifdef", "ifndef"):
                active.append((name in defined) == (word == "ifdef"))
            elif word == "else":
                active[-1] = not active[-1]
            elif word == "endif":
                active.pop()
            elif all(active):
                defined.add(name)
            continue
        uniform = _UNIFORM.match(line)
        if uniform is not None and all(active):
            found[uniform[2]] = (row, uniform[1])
    return found
