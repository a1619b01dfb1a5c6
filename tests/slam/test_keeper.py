"""All that a run has started ends with it, orphans too: at its end, at its limit and by Ctrl-C."""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from shared_fixtures.readings.slam_dataset import write_dataset

from recorder.slam.keeper import kept
from recorder.slam.supervisor import run_isolated

ORPHAN = """
import os, pathlib, signal, subprocess, sys, time
for one in (signal.SIGINT, signal.SIGTERM):
    signal.signal(one, signal.{on_signals})
until = time.process_time() + 1.0
while time.process_time() < until:
    pass
pathlib.Path(sys.argv[1]).write_text(str(os.getpid()))
time.sleep(600)
"""
"""It ignores signals or ends by them; the shell that starts it lets it ignore SIGINT."""
LEAVES_ONE = """
import pathlib, subprocess, sys, time
subprocess.Popen(["sh", "-c", '"$@" & exit', "sh", "setsid", sys.executable, sys.argv[1], sys.argv[2]])
while not pathlib.Path(sys.argv[2]).exists():
    time.sleep(0.02)
"""
SYSTEM = """
import subprocess, sys, time
from recorder.slam.system import System
SYSTEM = System(name="leaves", title="leaves", what="a test", needs=("lidar",), runner="x:run", frame="lidar")
def run(sequence, clock):
    subprocess.run([sys.executable, {leaves!r}, {orphan!r}, {pid!r}], check=True)
    time.sleep(600)
"""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone has subreapers and /proc")


@pytest.fixture
def programs(tmp_path: Path) -> tuple[str, str, str]:
    """A program that leaves an orphan, the orphan, and the file that it writes its number to."""
    leaves, orphan = tmp_path / "leaves.py", tmp_path / "orphan.py"
    leaves.write_text(LEAVES_ONE)
    orphan.write_text(ORPHAN.format(on_signals="SIG_DFL"))
    return str(leaves), str(orphan), str(tmp_path / "pid")


def has_ended(pid_file: str) -> bool:
    try:
        os.kill(int(Path(pid_file).read_text()), 0)
    except ProcessLookupError:
        return True
    return False


def children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_an_orphan_ends_and_its_time_is_counted(programs: tuple[str, str, str]) -> None:
    """It ignores SIGINT and SIGTERM, so that SIGKILL ends it, after 8 s."""
    before_s = children_s()
    Path(programs[1]).write_text(ORPHAN.format(on_signals="SIG_IGN"))
    assert subprocess.run(kept([sys.executable, *programs]), check=False).returncode == 0
    assert has_ended(programs[2])
    assert children_s() - before_s > 1.0


@pytest.mark.parametrize(
    ("code", "status"), [("import sys; sys.exit(3)", 3), ("import os; os.abort()", -signal.SIGABRT)]
)
def test_it_ends_as_its_command_does(code: str, status: int) -> None:
    assert subprocess.run(kept([sys.executable, "-c", code]), check=False).returncode == status


def test_it_ends_with_its_parent(programs: tuple[str, str, str]) -> None:
    code = f"import subprocess, time; subprocess.Popen({kept([sys.executable, *programs])}); time.sleep(600)"
    parent = subprocess.Popen([sys.executable, "-c", code])
    while not Path(programs[2]).exists():
        time.sleep(0.02)
    parent.kill()
    parent.wait()
    for _ in range(1500):
        if has_ended(programs[2]):
            return
        time.sleep(0.02)
    pytest.fail("an orphan is left")


@pytest.mark.parametrize("by", ["limit", "stop"])
def test_a_run_that_is_ended_leaves_nothing(by: str, programs: tuple[str, str, str], tmp_path: Path) -> None:
    system = tmp_path / "leaves_system.py"
    system.write_text(SYSTEM.format(leaves=programs[0], orphan=programs[1], pid=programs[2]))
    sequence = write_dataset(tmp_path / "set", sweeps=2) / "Box" / "ClearNoon_dynamic"
    stop, limit_s = threading.Event(), 600.0

    def when_it_runs() -> None:
        while not Path(programs[2]).exists():
            time.sleep(0.02)
        stop.set()

    if by == "stop":
        threading.Thread(target=when_it_runs, daemon=True).start()
        with pytest.raises(KeyboardInterrupt):
            run_isolated(str(system), sequence, tmp_path, cloud="raw", limit_s=limit_s, stop=stop)
    else:
        # Beside others it may not get as far within the shorter one.
        for limit_s in (10.0, 90.0):
            record = run_isolated(str(system), sequence, tmp_path, cloud="raw", limit_s=limit_s)
            assert record.error == f"ended after its time limit of {limit_s:g} s"
            if Path(programs[2]).exists():
                break
        assert record.cpu_s > 1.5
    assert has_ended(programs[2])
