"""`carlaloc list` and `carlaloc completion`."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from carlaloc_env.rigs.presets import RIGS, rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.weather.presets import weather_by_name
from recorder.cli.commands.list import KINDS
from recorder.cli.main import COMMANDS, main
from recorder.dataset.layout import FORMATS
from recorder.devices.base import DEVICES
from recorder.writers.topic_profiles import profile_by_name

NAMED_BY = {"weathers": weather_by_name, "rigs": rig_by_name, "topics": profile_by_name}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_listed_can_be_named(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", kind, "--json"]) == 0
    names = json.loads(capsys.readouterr().out)["names"]
    assert names
    assert all(what.strip() for what in names.values())
    if kind in NAMED_BY:
        for name in names:
            NAMED_BY[kind](name)
    if kind == "formats":
        assert tuple(names) == tuple(FORMATS)
    if kind == "devices":
        assert tuple(names) == DEVICES
    assert main(["list", kind]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(names)


def test_a_file_of_a_rig_is_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With and without the sensors that it extends written out; its path may be a text in Python, too."""
    file = tmp_path / "my.yaml"
    file.write_text("extends: lidar\nname: mine\nsensors: [{kind: imu, rate_hz: 50}]\n")
    assert main(["list", "rigs", str(file), "--yaml"]) == 0
    assert SensorRig.from_yaml(capsys.readouterr().out) == SensorRig.load(str(file), RIGS)
    file.write_text("sensors: [{kind: imu, rate: 50}]\n")
    assert main(["list", "rigs", str(file)]) == 1
    assert "did you mean 'rate_hz'" in capsys.readouterr().err


def test_places_of_a_rigs_sensors_are_listed_and_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line for each sensor, notes, and a picture that has ink at both views of a sensor."""
    pytest.importorskip("matplotlib")
    file, picture = tmp_path / "my.yaml", tmp_path / "my.png"
    file.write_text("extends: lidar\nname: mine\nsensors: [{kind: lidar, name: top, preset: vlp16}]\n")
    assert main(["list", "rigs", str(file), "--out", str(picture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:5] for line in lines if " top " in line][-1] == [
        "lidar",
        "top",
        "0.00",
        "0.00",
        "0.00",
    ]
    assert sum(line.startswith("note: ") for line in lines) == 2
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["list", "rigs", str(file), "--out", str(picture)]) == 1
    assert main(["list", "rigs", "--out", str(tmp_path / "b.png")]) == 2


def test_a_system_that_needs_more_than_a_bag_names_the_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["odometry", "run.bag", "--method", "rko_lio", "--out", "a.tum"]) == 1
    assert "carlaloc benchmark DATA --methods rko_lio" in capsys.readouterr().err


def test_bash_completes_commands_and_options(tmp_path: Path) -> None:
    pytest.importorskip("shtab")
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    script = subprocess.run(
        [sys.executable, "-m", "recorder.cli.main", "completion", "bash"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    (tmp_path / "carlaloc").write_text(script)
    ask = (
        f"source {tmp_path}/carlaloc; "
        "COMP_WORDS=(carlaloc {words}); COMP_CWORD={at}; COMP_LINE='carlaloc {words}'; "
        "$(complete -p carlaloc | sed 's/.*-F \\([^ ]*\\).*/\\1/') carlaloc; "
        'printf "%s\\n" "${{COMPREPLY[@]}}"'
    )
    commands = subprocess.run(
        [bash, "-c", ask.format(words="''", at=1)], capture_output=True, text=True, check=False
    ).stdout.split()
    assert set(COMMANDS) <= set(commands)
    options = subprocess.run(
        [bash, "-c", ask.format(words="replay --we", at=2)], capture_output=True, text=True, check=False
    ).stdout.split()
    assert options == ["--weather"]


def test_a_rig_is_printed_as_the_file_that_makes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["list", "rigs", "lidar", "--yaml"]) == 0
    path = tmp_path / "mine.yaml"
    path.write_text(capsys.readouterr().out)
    assert rig_by_name(path) == rig_by_name("lidar")
    assert main(["list", "rigs", "lidr"]) == 1
    assert "did you mean 'lidar'" in capsys.readouterr().err
    assert main(["list", "rigs", "--yaml"]) == 2
