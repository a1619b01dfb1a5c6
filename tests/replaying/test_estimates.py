"""The cost announced of a replay against what it takes: size of the files, CPU time of all."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from recorder.demo.story import DEMO_DRIVE
from recorder.drive.record import RecordConfig, record
from recorder.replaying.cost import SIZE_ERROR, TIME_FACTOR, size_of
from recorder.replaying.machine_speed import FILE, remember_slowness, slowness

STEREO = """\
name: stereo
sensors:
- kind: camera
  name: left
  mount: {position_m: [1.8, 0.3, 1.6], axes: optical}
  pinhole: {width_px: 640, height_px: 480, fx_px: 450, fy_px: 450, cx_px: 320, cy_px: 240}
  outputs: [rgb]
- kind: camera
  name: right
  mount: {position_m: [1.8, -0.3, 1.6], axes: optical}
  pinhole: {width_px: 640, height_px: 480, fx_px: 450, fy_px: 450, cx_px: 320, cy_px: 240}
  outputs: [rgb]
- {kind: imu}
"""
ALL = ("ClearNoon", "FoggyNoon", "RainyNight")
NIGHTS = ALL[1:]
SLAM, COMPACT, TWO = {"topics": "slam"}, {"topics": "compact_full"}, {"workers": 2}
REAL, SHORT = {"rig": "real", "start_s": 15.0}, {"duration_s": 1.2, "unit_s": 0.6}
Job = dict[str, Any]
JOBS: dict[str, tuple[str, Job]] = {
    "LiDAR": (
        "",
        {"rig": "lidar", "formats": ("rosbag1",), "traffic": ("static", "dynamic"), "start_s": 8.0},
    ),
    "state": ("", {"rig": "state", "formats": ("rosbag2", "rosbag1"), "duration_s": 20.0, "unit_s": 5.0}),
    "stereo": ("", {"rig": STEREO, "formats": ("euroc", "colmap"), "weathers": NIGHTS, "start_s": 10.0}),
    "a second of pictures": ("", {"start_s": 14.0, "camera_start_s": 15.0, "camera_duration_s": 1.0}),
    "SLAM": (
        "Town03",
        {"rig": "flu", **SLAM, "formats": ("rosbag2",), "weathers": ALL, "start_s": 12.0, **TWO},
    ),
    "compact": ("Town05", {**COMPACT, "formats": ("rosbag2",), "weathers": ALL[::2], "start_s": 15.0, **TWO}),
    "events": ("", {"topics": "full", "formats": ("rosbag2", "raw"), "start_s": 20.05, **SHORT}),
    "KITTI": ("Town03", {**SLAM, **REAL, "formats": ("kitti", "rosbag1_lz4"), "weathers": ALL[2:]}),
}
"""Town of the drive, else the demo's; and the replay's options, three seconds in units of one if not said."""
QUICK = ("LiDAR", "state", "stereo")
_REPLAY = """
import json, sys
from pathlib import Path
from recorder.replaying.replay import ReplayConfig, replay
options = json.loads(sys.argv[1])
options = {name: tuple(value) if isinstance(value, list) else value for name, value in options.items()}
costs = []
config = ReplayConfig(**{**options, "episode": Path(options["episode"]), "out": Path(options["out"])})
replay(config, announce=costs.append)
print(json.dumps([[c.written_bytes, c.spooled_bytes, c.size_error, c.cpu_s] for c in costs]))
"""


def taken(job: Job, episode: Path, folder: Path) -> tuple[list[list[float]], float, float]:
    """Announcements of a replay, first and corrected, its bytes, and its CPU time [s]."""
    options: Job = {"duration_s": 3.0, "unit_s": 1.0, "workers": 1} | job
    if "\n" in options.get("rig", ""):
        (folder / "rig.yaml").write_text(options["rig"], encoding="utf-8")
        options["rig"] = str(folder / "rig.yaml")
    options |= {"episode": str(episode), "out": str(folder / "data")}
    command = [sys.executable, "-c", _REPLAY, json.dumps(options)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = process.stdout.read().splitlines()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    size = sum(size_of(path.parent) for path in (folder / "data").rglob("sequence.yaml"))
    return json.loads(lines[-1]), size, usage.ru_utime + usage.ru_stime


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(name, marks=pytest.mark.soak) for name in JOBS if name not in QUICK)]
)
def test_what_is_announced_is_what_it_takes(name: str, tmp_path: Path) -> None:
    """The size within the error announced, and within 10 % after the first unit; the time within 1.5."""
    town, job = JOBS[name]
    episode = tmp_path / "drive.mcap" if town else DEMO_DRIVE
    if town:
        record(RecordConfig(map=town, out=episode, duration_s=21.0, seed=6, traffic="dynamic"))
    (first, corrected), size, cpu_s = taken(job, episode, tmp_path)
    assert first[0] == pytest.approx(size, rel=first[2])
    assert corrected[0] == pytest.approx(size, rel=SIZE_ERROR)
    assert corrected[2] == SIZE_ERROR
    assert 1.0 / TIME_FACTOR < corrected[3] / cpu_s < TIME_FACTOR


def test_the_machines_slowness_is_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A damaged file, or a factor of no machine, is ignored."""
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path))
    assert slowness() == 1.0
    remember_slowness(2.5)
    assert slowness() == 2.5
    for text in ("", "[]", '{"slowness": "x"}', '{"slowness": 1e9}', '{"slowness": NaN}', "\xff"):
        (tmp_path / FILE).write_text(text, encoding="latin-1")
        assert slowness() == 1.0
