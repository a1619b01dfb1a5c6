"""Memory given back to the system: pages that a process has freed, and pages of files that it maps."""

import ctypes
import mmap
import sys
from typing import Any

from numpy.typing import NDArray


def give_back_freed_memory() -> None:
    """Return pages that were freed to the system, where the C library keeps them (glibc); else nothing.

    Building a scene takes some hundred megabytes for a moment, which glibc would hold for good.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def give_back_mapped_pages(array: NDArray[Any]) -> None:
    """Let go of the pages of the whole file that an array is a view of; they are read again when needed.

    Other arrays are left alone, and so are all on systems that cannot do it.
    """
    base: Any = array
    while base is not None and not isinstance(base, mmap.mmap):
        base = getattr(base, "base", None)
    if base is not None and hasattr(mmap, "MADV_DONTNEED"):
        base.madvise(mmap.MADV_DONTNEED)
