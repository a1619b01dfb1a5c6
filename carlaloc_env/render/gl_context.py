"""The OpenGL context: headless by EGL, and one clear line when there is none."""

import os
from contextlib import suppress
from importlib import import_module
from typing import Any

import moderngl

from carlaloc_env.core.errors import RenderError
from carlaloc_env.core.opengl_process import begin_opengl

PACKAGES = "libegl1 libgl1 libgl1-mesa-dri"
"""Debian and Ubuntu packages that bring OpenGL to a machine without a GPU."""
VERSION = 430
"""Version of OpenGL that is needed."""


def create_context() -> moderngl.Context:
    """A context of its own, not bound to any window.

    The device of a machine with several GPUs is chosen by ``GLCONTEXT_DEVICE_INDEX``.

    Raises:
        RenderError: there is no OpenGL 4.3, with the packages to install; or this process is a fork.
    """
    begin_opengl()
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
