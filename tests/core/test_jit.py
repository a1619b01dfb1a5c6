"""Machine code that numba keeps: it must change when any source that went into it does."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from shared_fixtures.processes.small_disks import small_disk

from carlaloc_env.core import cores, jit
from carlaloc_env.core.files.source_digest import source_digest

_CALLER = """
from carlaloc_env.core.jit import compiled
from kept.inner.callee import shift

@compiled
def moved(x):
    return x + shift()

print(moved(1.0), sum(moved.stats.cache_hits.values()))
"""
_WITH_CLASS = """
from typing import NamedTuple
from carlaloc_env.core.jit import compiled

class {0}(NamedTuple):
    x: float

@compiled
def of(record):
    return record.x + 4.0

print(of({0}(3.0)), sum(of.stats.cache_hits.values()))
"""
_CALLEE = "from carlaloc_env.core.jit import compiled\n\n@compiled\ndef shift():\n    return {}\n"


V1 = "4:cpu,cpuacct:/docker/ab\n3:cpuset:/docker/ab\n1:name=systemd:/docker/ab\n"
GROUPS: tuple[tuple[str, dict[str, str], int], ...] = (
    ("", {}, 16),
    ("0::/app/job\n", {"app/job/cpu.max": "max 100000\n", "app/cpu.max": "350000 100000\n"}, 4),
    ("0::/\n", {"cpu.max": "50000 100000\n"}, 1),
    (V1, {"cpu/cpu.cfs_quota_us": "200000\n", "cpu/cpu.cfs_period_us": "100000\n"}, 2),
    (V1, {"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, 16),
)
"""The control groups of a process, their files, and the cores of 16 that they leave; the first: no groups."""


@pytest.mark.parametrize(("groups", "files", "count"), GROUPS)
def test_cores_are_those_that_a_container_is_granted(
    groups: str, files: dict[str, str], count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a group above, as seen from within, of version 1, and without a limit."""
    all_files = {"proc/self/cgroup": groups} | {f"sys/fs/cgroup/{name}": text for name, text in files.items()}
    for name, text in all_files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(3, 19)), raising=False)
    assert cores.usable_cores(tmp_path) == tuple(range(3, 3 + count))


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs affinities")
def test_cores_are_those_of_the_affinity() -> None:
    one = min(os.sched_getaffinity(0))
    script = (
        f"import os; os.cpu_count = lambda: 8; os.sched_setaffinity(0, [{one}])\n"
        "from carlaloc_env.core.cores import usable_cores; print(*usable_cores())"
    )
    command = [sys.executable, "-c", script]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == f"{one}\n"


_NO_HOME = "import pwd; pwd.getpwuid = {}.__getitem__; import kept.caller"
"""A user whom the system does not know, as with Docker's --user."""


@pytest.mark.parametrize("home", ["none", "read-only"])
def test_machine_code_is_kept_without_a_home_beside_a_read_only_install(home: str, tmp_path: Path) -> None:
    """In a folder of temporary files, which one line names; a folder called ``~`` does not appear."""
    here, kept = tmp_path / "here", tmp_path / "temporary"
    unset = ("HOME", "XDG_CACHE_HOME", "CARLALOC_CACHE", "NUMBA_CACHE_DIR")
    environment = {key: value for key, value in os.environ.items() if key not in unset}
    with small_disk(tmp_path / "disk", 1 << 20) as disk:
        for folder in (here, kept, disk / "kept"):
            folder.mkdir()
        (disk / "kept" / "__init__.py").touch()
        (disk / "kept" / "caller.py").write_text(_WITH_CLASS.format("Old"))
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        environment |= {"TMPDIR": str(kept), "PYTHONPATH": os.pathsep.join([str(disk), *sys.path])}
        environment |= {} if home == "none" else {"HOME": str(disk)}
        command = [sys.executable, "-B", "-c", _NO_HOME]
        for hits in (0, 1):
            done = subprocess.run(
                command, cwd=here, env=environment, capture_output=True, text=True, check=True
            )
            assert done.stdout == f"7.0 {hits}\n"
            assert [str(kept) in line for line in done.stderr.splitlines()] == [True]
    assert not list(here.iterdir())


def _run(folder: Path) -> tuple[float, int]:
    # Python takes kept bytecode for current while the source's size and whole second are the same: keep none.
    command = [sys.executable, "-B", "-c", "import kept.caller"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    value, hits = done.stdout.split()
    return float(value), int(hits)


def test_machine_code_is_kept_until_a_source_that_it_calls_changes(tmp_path: Path) -> None:
    """A second process compiles nothing; after an edit of the function that is called, it does."""
    callee = tmp_path / "kept" / "inner" / "callee.py"
    callee.parent.mkdir(parents=True)
    for folder in (callee.parent, callee.parents[1]):
        (folder / "__init__.py").write_text("")
    (tmp_path / "kept" / "caller.py").write_text(_CALLER)
    callee.write_text(_CALLEE.format(2.0))
    assert _run(tmp_path) == (3.0, 0)
    assert _run(tmp_path) == (3.0, 1)
    callee.write_text(_CALLEE.format(5.0))
    assert _run(tmp_path) == (6.0, 0)


def test_machine_code_of_a_class_that_is_gone_is_made_anew(tmp_path: Path) -> None:
    """The kept index names the classes of arguments; one that has been renamed must not stop a start."""
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    for name, hits in (("Old", 0), ("Old", 1), ("New", 0), ("New", 1)):
        (folder / "caller.py").write_text(_WITH_CLASS.format(name))
        assert _run(tmp_path) == (7.0, hits)


def test_kept_machine_code_is_read_and_written_by_one_at_a_time(tmp_path: Path) -> None:
    """Numba numbers its files by an index that it reads before and writes after."""
    inside: list[int] = []
    most: list[int] = []

    def use(number: int) -> None:
        inside.append(number)
        time.sleep(0.01)
        most.append(len(inside))
        inside.remove(number)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(jit._in_turn(use, str(tmp_path)), range(8)))
    assert most == [1] * 8


def test_numba_still_keeps_its_stamp_where_ours_replaces_it() -> None:
    """Without the attribute nothing would be kept on disk any more: every start would compile for minutes."""
    from carlaloc_env.sensors.event_camera import log_intensity

    assert log_intensity.log_of._cache._cache_file._source_stamp == source_digest(log_intensity.__name__)


def test_bands_cover_every_row_once_and_in_order() -> None:
    for rows in (0, 1, cores.BAND_ROWS, 5 * cores.BAND_ROWS + 7):
        bands = cores.over_bands(lambda first, end: list(range(first, end)), rows)
        assert [row for band in bands for row in band] == list(range(rows))


def test_a_band_that_fails_fails_the_whole() -> None:
    def half(first: int, end: int) -> int:
        if first >= 2 * cores.BAND_ROWS:
            raise ValueError("no such rows")
        return end

    with pytest.raises(ValueError, match="no such rows"):
        cores.over_bands(half, 5 * cores.BAND_ROWS)
