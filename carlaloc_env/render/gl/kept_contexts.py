"""Contexts and their compiled programs, handed on from a closed renderer to the next one.

Mesa 22.3 keeps about 40 kB of every context that is released, and 18 kB of every program; and compiling them
again is most of what a second renderer takes.
"""

from __future__ import annotations

import os
from collections import defaultdict

from carlaloc_env.render.gl.context import Programs, create_context

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
