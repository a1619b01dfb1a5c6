"""Machine code that numba keeps: it must change when any source that went into it does."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from shared_fixtures.processes.small_disks import small_disk

from carlaloc_env.core import jit
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


GROUPS: dict[str, tuple[dict[str, str], int]] = {
    "none": ({}, 16),
    "2, that of the group above": (
        {
            "proc/self/cgroup": "0::/app.slice/job\n",
            "sys/fs/cgroup/app.slice/job/cpu.max": "max 100000\n",
            "sys/fs/cgroup/app.slice/cpu.max": "350000 100000\n",
        },
        4,
    ),
    "2, from within": ({"proc/self/cgroup": "0::/\n", "sys/fs/cgroup/cpu.max": "50000 100000\n"}, 1),
    "1, from within": (
        {
            "proc/self/cgroup": "4:cpu,cpuacct:/docker/ab\n3:cpuset:/docker/ab\n1:name=systemd:/docker/ab\n",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "200000\n",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n",
        },
        2,
    ),
    "1, without a limit": (
        {
            "proc/self/cgroup": "4:cpu,cpuacct:/\n",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1\n",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n",
        },
        16,
    ),
}
"""Files of control groups by version, and the cores of 16 that they leave."""


@pytest.mark.parametrize("groups", GROUPS)
def test_cores_are_those_that_a_container_is_granted(
    groups: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files, count = GROUPS[groups]
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(3, 19)), raising=False)
    assert jit.usable_cores(tmp_path) == tuple(range(3, 3 + count))


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs affinities")
def test_cores_are_those_of_the_affinity() -> None:
    one = min(os.sched_getaffinity(0))
    script = (
        f"import os; os.cpu_count = lambda: 8; os.sched_setaffinity(0, [{one}])\n"
        "from carlaloc_env.core.jit import usable_cores; print(*usable_cores())"
    )
    command = [sys.executable, "-c", script]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == f"{one}\n"


_NO_HOME = """
import os, pwd

def nobody(_):
    raise KeyError("no such user")

pwd.getpwuid = nobody
import kept.caller
"""


@pytest.mark.parametrize("home", [None, "read-only"])
def test_machine_code_is_kept_without_a_home_beside_a_read_only_install(
    home: str | None, tmp_path: Path
) -> None:
    """In a folder of temporary files, which one line names; a folder called ``~`` does not appear."""
    here, kept = tmp_path / "here", tmp_path / "temporary"
    here.mkdir()
    kept.mkdir()
    unset = ("HOME", "XDG_CACHE_HOME", "CARLALOC_CACHE", "NUMBA_CACHE_DIR")
    environment = {key: value for key, value in os.environ.items() if key not in unset}
    with small_disk(tmp_path / "disk", 1 << 20) as disk:
        (disk / "kept").mkdir()
        (disk / "kept" / "__init__.py").write_text("")
        (disk / "kept" / "caller.py").write_text(
            _CALLER.replace("kept.inner.callee", "math").replace("shift()", "2.0").replace("shift", "pi")
        )
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        environment |= {"TMPDIR": str(kept), "PYTHONPATH": os.pathsep.join([str(disk), *sys.path])}
        environment |= {} if home is None else {"HOME": str(disk)}
        for hits in (0, 1):
            done = subprocess.run(
                [sys.executable, "-B", "-c", _NO_HOME],
                cwd=here, env=environment, capture_output=True, text=True, check=True,
            )  # fmt: skip
            assert done.stdout == f"3.0 {hits}\n"
            assert len(done.stderr.splitlines()) == 1
            assert str(kept) in done.stderr
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
    from carlaloc_env.sensors.event_camera import pixels as log_intensity

    assert log_intensity.log_of._cache._cache_file._source_stamp == source_digest(log_intensity.__name__)


def test_bands_cover_every_row_once_and_in_order() -> None:
    for rows in (0, 1, jit.BAND_ROWS, 5 * jit.BAND_ROWS + 7):
        bands = jit.over_bands(lambda first, end: list(range(first, end)), rows)
        assert [row for band in bands for row in band] == list(range(rows))


def test_a_band_that_fails_fails_the_whole() -> None:
    def half(first: int, end: int) -> int:
        if first >= 2 * jit.BAND_ROWS:
            raise ValueError("no such rows")
        return end

    with pytest.raises(ValueError, match="no such rows"):
        jit.over_bands(half, 5 * jit.BAND_ROWS)
