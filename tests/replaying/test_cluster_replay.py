"""A drive replayed on a Dask cluster of which a worker is killed with a unit in hand: the same bytes."""

import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from shared_fixtures.drives.straight_drives import RIG, StraightDrive

from recorder.dataset.checksums import checksums
from recorder.replaying.replay import replay
from recorder.replaying.working_folder import FOLDER, UNITS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="open files are seen in /proc")


def kill_who_makes_a_unit(out: Path, killed: list[int]) -> None:
    """Kill the first process that holds a spool of a unit open."""
    end = time.monotonic() + 600.0
    while time.monotonic() < end and not killed:
        for entry in Path("/proc").glob("[0-9]*/fd/*"):
            try:
                held = entry.readlink()
            except OSError:
                continue
            if held.suffix == ".spool" and held.is_relative_to(out / FOLDER / UNITS):
                killed.append(int(entry.parts[2]))
                os.kill(killed[0], signal.SIGKILL)
                return
        time.sleep(0.002)


def test_a_killed_worker_changes_no_byte(
    straight_drive: StraightDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed", reason="clusters need the extra `cluster`")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG.partition("- kind: camera")[0])
    settings = {"rig": str(rig), "formats": ("rosbag1",), "preview": False}
    replay(straight_drive.config(tmp_path / "alone", **settings))
    out, killed = tmp_path / "cluster", list[int]()
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as scheduler:
        killer = threading.Thread(target=kill_who_makes_a_unit, args=(out, killed), daemon=True)
        killer.start()
        replay(straight_drive.config(out, cluster=scheduler.scheduler_address, **settings))
        killer.join()
    assert killed
    assert killed[0] != os.getpid()
    assert checksums(out) == checksums(tmp_path / "alone")
