"""Machine code that numba keeps: it must change when any source that went into it does."""

import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

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
