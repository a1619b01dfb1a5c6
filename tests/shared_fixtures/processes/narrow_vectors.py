"""Environment that holds libraries to 128-bit vectors without fused multiply-add."""

import importlib
import re

import cv2


def narrow_environment() -> dict[str, str]:
    """Variables for a process that may use only what every x86-64 of the last fifteen years can do."""
    dispatch = importlib.import_module("numpy._core._multiarray_umath").__cpu_dispatch__
    dispatched = re.findall(r"\*([\w.-]+)", cv2.getCPUFeaturesLine())
    wide = ("AVX", "AVX2", "FMA", "FMA4", "AVX512F", "AVX512VL", "AVX512DQ", "AVX512BW", "AVX512CD")
    return {
        "LP_NATIVE_VECTOR_WIDTH": "128",
        "MESA_SHADER_CACHE_DISABLE": "true",
        "NUMBA_CPU_NAME": "x86-64",
        "NUMBA_CPU_FEATURES": "",
        "NPY_DISABLE_CPU_FEATURES": " ".join(dispatch),
        "OPENCV_CPU_DISABLE": ",".join(dispatched),
        "OPENBLAS_CORETYPE": "Nehalem",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=" + ",".join(f"-{name}" for name in wide),
    }
