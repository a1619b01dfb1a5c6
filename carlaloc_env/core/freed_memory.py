"""What a process has freed, given back to the system."""

from __future__ import annotations

import ctypes
import sys


def give_back_freed_memory() -> None:
    """Return pages that were freed to the system, where the C library keeps them (glibc); else nothing.

    Building a scene takes some hundred megabytes for a moment, which glibc would hold for good.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
