"""Memory of a command and of all processes that it starts."""

import subprocess
import sys
import time
from pathlib import Path

_EVERY_S = 0.1


def peak_memory_bytes(command: list[str]) -> tuple[int, float]:
    """Run a command; return its greatest memory [bytes] and how long it took [s].

    Counted is the proportional set size, which shares out pages that several processes use, summed
    over the command and its descendants alive at the same time.

    Raises:
        RuntimeError: the command failed; the message holds the end of its output.
    """
    began = time.perf_counter()
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace"
    ) as process:
        assert process.stderr is not None
        peak = 0
        while process.poll() is None:
            peak = max(peak, sum(_pss_bytes(pid) for pid in _family(process.pid)))
            time.sleep(_EVERY_S)
        if process.returncode:
            raise RuntimeError(f"{' '.join(command)} failed: {process.stderr.read()[-500:]}")
    return peak, time.perf_counter() - began


def can_measure() -> bool:
    """Whether this system reports the memory of processes."""
    return sys.platform == "linux" and Path("/proc/self/smaps_rollup").exists()


def _family(root: int) -> list[int]:
    parents: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                # The name in brackets may hold blanks; the parent comes second after it.
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except (OSError, IndexError):
                continue
            parents.setdefault(parent, []).append(int(entry.name))
    found = [root]
    for pid in found:
        found += parents.get(pid, [])
    return found


def _pss_bytes(pid: int) -> int:
    try:
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return 1024 * int(line.split()[1])
    except OSError:
        return 0
    return 0
