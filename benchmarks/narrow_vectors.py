"""Differences of a dataset made on a processor without wide vectors, by stream.

A short drive is recorded and replayed twice by the commands that a user types, with separate caches. One run
uses all instructions of this machine. The other restricts numba, NumPy, OpenCV, OpenBLAS, the C library and
llvmpipe to 128-bit vectors without fused multiply-add. Embree chooses for itself.
"""

import argparse
import importlib
import os
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[Any]]

_RECORD = ("record", "--map", "Town03", "--device", "scripted", "--seed", "7", "--duration", "3")
_REPLAY = ("--traffic", "dynamic", "--format", "raw", "--topics", "full", "--start", "2", "--workers", "1")
_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "<i2", "uint16": "<u2", "int32": "<i4", "uint32": "<u4"},
    **{"float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8"},
}


def main(work: Path, weathers: str, length_s: float) -> None:
    """Make both datasets and print what differs, a line for each stream and kind of cached file."""
    make(work / "wide", {}, weathers, length_s)
    make(work / "narrow", narrow_environment(), weathers, length_s)
    print(f"{'':<44}{'files':>7}{'equal':>7}  largest difference, share of values that differ")
    for name, pairs in sorted(matched(work / "wide", work / "narrow").items()):
        unequal = [pair for pair in pairs if pair[0].read_bytes() != pair[1].read_bytes()]
        print(f"{name:<44}{len(pairs):>7}{len(pairs) - len(unequal):>7}  {differences(unequal)}", flush=True)


def narrow_environment() -> dict[str, str]:
    """Variables that hold libraries to what every x86-64 of the last fifteen years can do."""
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


def make(folder: Path, environment: dict[str, str], weathers: str, length_s: float) -> None:
    """Record and replay a drive in a folder, with its caches; existing results are kept."""
    if (folder / "data" / "dataset.yaml").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    caches = {"CARLALOC_CACHE": str(folder / "cache"), "NUMBA_CACHE_DIR": str(folder / "numba")}
    drive = folder / "drive.mcap"
    stretch = ("--weather", weathers, "--duration", str(length_s), "--no-preview")
    commands = (
        (*_RECORD, "--force", "--out", str(drive)),
        ("replay", str(drive), "--out", str(folder / "data"), *_REPLAY, *stretch),
    )
    for command in commands:
        subprocess.run(
            [sys.executable, "-m", "recorder.cli.main", *command],
            env={**os.environ, **caches, **environment},
            check=True,
        )


def matched(wide: Path, narrow: Path) -> dict[str, list[tuple[Path, Path]]]:
    """Files of both folders by what they hold.

    Raises:
        FileNotFoundError: one has a file that the other has not.
    """
    found: dict[str, list[tuple[Path, Path]]] = defaultdict(list)
    names = [_names(folder) for folder in (wide, narrow)]
    if names[0] != names[1]:
        raise FileNotFoundError(f"only in one of both: {sorted(names[0] ^ names[1])[:5]}")
    for name in sorted(names[0]):
        path = Path(name)
        kind = f"cache/{path.suffix}" if path.parts[0] == "cache" else str(path.parent)
        found[kind].append((wide / path, narrow / path))
    return found


def _names(folder: Path) -> set[str]:
    # Descriptions hold checksums, and the time at which a drive was recorded does not count.
    files = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    hidden = ("numba",)
    return {
        str(path)
        for path in files
        if path.parts[0] not in hidden and path.suffix not in (".yaml", ".lock") and path.name[0] != "."
    }


def differences(pairs: list[tuple[Path, Path]]) -> str:
    """Largest difference of every array of some pairs of files, and the share of values that differ."""
    largest: dict[str, float] = defaultdict(float)
    differing: dict[str, int] = defaultdict(int)
    total: dict[str, int] = defaultdict(int)
    remarks = set()
    for pair in pairs:
        wide, narrow = (columns_of(path) for path in pair)
        if not wide:
            remarks.add("other bytes")
        for name, values in wide.items():
            others = narrow[name]
            if values.shape != others.shape:
                remarks.add(f"{name}: {len(values)} and {len(others)}")
                continue
            apart = np.abs(values.astype(np.float64) - others.astype(np.float64))
            apart = apart[np.isfinite(apart)]
            largest[name] = max(largest[name], float(apart.max(initial=0.0)))
            differing[name] += int(np.count_nonzero(apart))
            total[name] += values.size
    numbers = [f"{n} {largest[n]:.3g} in {differing[n] / total[n]:.2g}" for n in largest if differing[n]]
    return "; ".join([*numbers, *sorted(remarks)])


def columns_of(path: Path) -> Columns:
    """Arrays of a file by name; none where its kind is unknown."""
    if path.suffix == ".png":
        return {"steps": np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))}
    if path.suffix == ".npz":
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        plain = {name: values for name, values in arrays.items() if values.dtype.kind in "iufb"}
        tables = [values for values in arrays.values() if values.dtype.names]
        return plain | {name: table[name] for table in tables for name in table.dtype.names or ()}
    if path.suffix == ".ply":
        return dict(_ply(path.read_bytes()))
    if path.suffix == ".tum":
        return {"values": np.loadtxt(path)}
    return {}


def _ply(content: bytes) -> Iterator[tuple[str, NDArray[Any]]]:
    head, _, data = content.partition(b"end_header\n")
    fields = re.findall(r"property (\w+) (\w+)", head.decode("ascii"))
    rows = np.frombuffer(data, np.dtype([(name, _PLY_TYPES[kind]) for kind, name in fields]))
    for _, name in fields:
        yield name, rows[name]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder for both datasets, about 2 GB")
    parser.add_argument("--weather", default="ClearNoon,FoggyNoon,RainyNight", metavar="A,B")
    parser.add_argument("--length", type=float, default=0.4, metavar="S", help="stretch that is replayed [s]")
    options = parser.parse_args()
    main(options.work, options.weather, options.length)
