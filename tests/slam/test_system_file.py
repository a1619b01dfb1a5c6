"""Programs as SLAM systems by a YAML file: what it may say, and a run that copies the truth."""

import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from shared_fixtures.readings.slam_dataset import write_dataset

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.rigs.presets import rig_by_name
from recorder.benchmark.run import BenchmarkConfig, run_benchmark
from recorder.slam.system import END
from recorder.slam.system_file import read_system_file
from recorder.slam.systems import system_of
from recorder.writers.calibration.files import calibration_texts
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.topic_profiles import profile_by_name

COPY = (
    "import shutil, sys, pathlib; "
    "shutil.copy(pathlib.Path(sys.argv[1]).parents[1] / 'ground_truth/lidar.tum', sys.argv[2])"
)
GOOD = f"""
name: copy
title: Copy
needs: [lidar]
frame: lidar
instant: end
command: [{sys.executable}, -c, "{COPY}", "{{bag}}", "{{out}}"]
"""
EXTERNAL = Path(__file__).parents[2] / "examples" / "external"


def test_a_program_is_run_by_its_file(tmp_path: Path) -> None:
    (tmp_path / "copy.yaml").write_text(GOOD.replace("instant: end", "instant: start"))
    data = write_dataset(tmp_path / "set", sweeps=15)
    config = BenchmarkConfig(
        data=data, out=tmp_path / "out", methods=(str(tmp_path / "copy.yaml"),), clouds=("raw",)
    )
    (score,) = run_benchmark(config).scores
    assert (score.failed, score.title) == (None, "Copy")
    assert score.ape_m < 1e-6


def test_it_says_what_poses_mean(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(GOOD)
    system = system_of(str(tmp_path / "a.yaml"))
    assert (system.name, system.needs, system.frame, system.instant) == ("copy", ("lidar",), "lidar", END)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("frame: lidar", "frame: lida"), "lida"),
        (("instant: end", "instant: 3"), "instant"),
        (("[lidar]", "[sonar]"), "sonar"),
        (("{out}", "x"), r"names no \{out\}"),
        (("title: Copy\n", ""), "key 'title' is missing"),
        (("title:", "titel: a\ntitle:"), "titel"),
        (("command:", "ros1: {poses: /a, pace: /b, command: [c]}\ncommand:"), "either 'command' or 'ros1'"),
        (("command:", "ros1: {poses: /a}\ncommand:"), "ros1: the key 'pace' is missing"),
        (("command:", "ros1: {poses: /a, pace: /b, command: [c], every: 0}\ncommand:"), "every is 0"),
        (("command:", "ros1: {poses: /a, pace: /b, command: c}\ncommand:"), "command: expected a list"),
        (("command:", "ros1: {pase: /a}\ncommand:"), "pase.*did you mean 'pace'"),
    ],
)
def test_faults_are_named(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    (tmp_path / "a.yaml").write_text(GOOD.replace(*change))
    with pytest.raises(ConfigError, match=message):
        read_system_file(tmp_path / "a.yaml")


def test_files_beside_it_are_named_by_its_folder(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(GOOD.replace("command: [", 'command: ["{here}/play.py", '))
    assert read_system_file(tmp_path / "a.yaml").command[0] == str(tmp_path / "play.py")


@pytest.mark.parametrize("path", sorted(EXTERNAL.glob("*.yaml")), ids=lambda path: path.stem)
def test_files_that_we_give_are_read(path: Path) -> None:
    found = read_system_file(path)
    assert found.name == path.stem
    assert found.system.takes_seg == (found.ros1 is not None and found.system.sensor == "lidar")
    assert found.instant_source != "its settings"


def test_launch_files_that_we_name_lie_in_datasets() -> None:
    """Each is one that roslaunch reads, and names files that lie beside it."""
    texts = calibration_texts(
        RigCalibration.from_configs(rig_by_name("flu").sensors), profile_by_name("standard")
    )
    named = set()
    for path in EXTERNAL.glob("*.yaml"):
        for word in getattr(read_system_file(path).ros1, "command", ()):
            named |= {word.removeprefix("{calibration}/")} if word.startswith("{calibration}/") else set()
    assert len(named) == 7
    for name in named:
        launch = ElementTree.fromstring(texts[name])
        assert {node.get("required") for node in launch.iter("node")} == {"true"}
        folder = Path(name).parent
        for file in re.findall(r"\$\(dirname\)/([\w.-]+)", texts[name]):
            assert (folder / file).as_posix() in texts
