"""The process in which OpenGL began: its forks lack the driver's threads, and would wait for them."""

import os

from carlaloc_env.core.errors import RenderError

_begun_in: list[int] = []
"""Its process id, once OpenGL has begun; a fork inherits it."""


def begin_opengl() -> None:
    """Note that this process begins to use OpenGL.

    Raises:
        RenderError: see `check_opengl`.
    """
    check_opengl()
    _begun_in[:] = [os.getpid()]


def lost_by_fork() -> bool:
    """Whether this process was forked from one that had used OpenGL, closed since or not."""
    return bool(_begun_in) and _begun_in[0] != os.getpid()


def check_opengl() -> None:
    """Refuse OpenGL in a fork.

    Raises:
        RenderError: see `lost_by_fork`.
    """
    if lost_by_fork():
        raise RenderError(
            "this process was forked from one that had drawn pictures, and OpenGL does not survive a fork; "
            'start new processes: AsyncVectorEnv(…, context="spawn"), multiprocessing.get_context("spawn"), '
            'SubprocVecEnv(…, start_method="spawn")'
        )
