"""Uniforms of fragment shaders as flat varyings, for drivers that fetch uniforms pixel by pixel.

llvmpipe (Mesa 22) loads every word of a uniform eight times for eight pixels, with a bounds check each, some
25 instructions; a flat varying is one broadcast. The vertex shader hands the values over.
"""

import re

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
    vertex_uniforms = {uniform[2] for uniform in _UNIFORM.finditer(vertex)}
    renamed, declared, copied = "", "", ""
    for line in fragment.split("\n"):
        if uniform := _UNIFORM.match(line):
            declaration, name = uniform.groups()
            renamed += f"#define {name} flat_{name}\n"
            declared += "" if name in vertex_uniforms else f"uniform {declaration}\n"
            declared += f"flat out {declaration.replace(name, f'flat_{name}', 1)}\n"
            copied += f"    flat_{name} = {name};\n"
        elif line.startswith("#"):
            # Both are compiled under the conditions of the fragment shader.
            declared += line + "\n"
            copied += "" if line.startswith("#define") else line + "\n"
    before, after = vertex.split(_MAIN)
    return f"{before}{declared}{_MAIN}{copied}{after}", renamed + _UNIFORM.sub(r"flat in \1", fragment)
