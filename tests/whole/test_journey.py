"""README's journey: each command works on what the one before has written; the towns are small ones."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from shared_fixtures.drives import straight_drives
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.worlds.render_scenes import need_opengl

from recorder.cli.main import main
from recorder.dataset.manifest import DatasetManifest

ROOT = Path(__file__).parents[2]
PARTS = (("README.md", "## A dataset\n"), ("docs/commands.md", "## Using a dataset\n"))
"""Sections whose commands make up the journey."""
TOWNS = {"Town01": "East", "Town07": "West"}
"""Towns of README, and the small ones that stand for them."""
SHORTER = ["--rig", "rig.yaml", "--sample", "0.5", "--quality", "low", "--workers", "1"]
"""Documented options that make README's dataset small."""
RIG = (
    straight_drives.RIG.partition("- kind: camera\n  name: right")[0]
    .replace("[rgb, depth, semantic, events]", "[rgb, depth]")
    .replace("name: left\n", "name: left\n  rate_hz: 10\n")
)
"""The small rig with one camera, at half its rate."""


def command(beginning: str) -> list[str]:
    """Words of the last documented line that begins so, with the small towns."""
    parts = [(ROOT / page).read_text("utf-8").split(head)[1].split("\n## ")[0] for page, head in PARTS]
    # The last one is on a dataset of all towns; README's first lines are on a drive of one's own.
    *_, line = [line for part in parts for line in part.splitlines() if line.startswith(beginning)]
    for theirs, ours in TOWNS.items():
        line = line.replace(theirs, ours)
    return shlex.split(line, comments=True)


@pytest.fixture(scope="module")
def home(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the dataset that README's command makes: two towns are driven through and replayed."""
    need_opengl()
    home = tmp_path_factory.mktemp("journey")
    for town in TOWNS.values():
        (home / "maps" / town).mkdir(parents=True)
        shutil.copy(straight_drive.town, home / "maps" / town / "town.xodr")
    (home / "rig.yaml").write_text(RIG)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        patch.setenv("CARLALOC_MAPS", str(home / "maps"))
        assert main([*command("carlaloc dataset")[1:], *SHORTER]) == 0
    return home


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)
    monkeypatch.setenv("CARLALOC_MAPS", str(home / "maps"))


def test_the_dataset_has_two_drives_and_six_conditions_each(home: Path) -> None:
    manifest = DatasetManifest.read(home / "dataset")
    assert set(manifest.drives) == set(TOWNS.values())
    assert len(manifest.sequences) == 12
    sums = subprocess.run(["sha256sum", "-c", "--quiet", "SHA256SUMS"], cwd=home / "dataset", check=False)
    assert sums.returncode == 0


def test_the_same_command_finds_all_made(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*command("carlaloc dataset")[1:], *SHORTER]) == 0
    assert "all sequences of 2 of 2 towns" in capsys.readouterr().err


def test_verify_finds_nothing_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(command("carlaloc verify")[1:]) == 0
    assert "12 sequences: nothing is wrong" in capsys.readouterr().out


def test_two_makings_are_the_same_dataset(capsys: pytest.CaptureFixture[str]) -> None:
    """Driven and replayed anew by the same words; only the time of recording differs."""
    words = command("carlaloc dataset")[1:]
    assert main([*words, *SHORTER, "--out", "again", "--towns", "East"]) == 0
    capsys.readouterr()
    assert main(["verify", "again", "--against", "dataset", "--json"]) == 1
    findings = json.loads(capsys.readouterr().out)["findings"]
    assert findings
    assert all("West" in line or line.startswith("dataset.yaml") for line in findings), findings


def test_benchmark_scores_every_drive_and_draws_the_page(home: Path) -> None:
    pytest.importorskip("small_gicp", reason="needs small_gicp")
    pytest.importorskip("matplotlib", reason="needs matplotlib")
    assert main(command("carlaloc benchmark")[1:]) == 0
    table = (home / "scores" / "tables.md").read_text(encoding="utf-8")
    page = (home / "scores" / "report.html").read_text(encoding="utf-8")
    for town in TOWNS.values():
        assert town in table
        assert town in page


def test_view_writes_a_sequence_as_a_page(home: Path) -> None:
    assert main(command("carlaloc view --html")[1:]) == 0
    page = (home / "scene.html").read_text("utf-8")
    assert page.rstrip().endswith("</html>")
    assert len(page) > 1_000_000


def test_view_writes_a_recording_for_rerun(home: Path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")
    sequence = next(word for word in command("carlaloc view") if word.startswith("dataset/"))
    assert main(["view", sequence, "--out", "look.rrd"]) == 0
    assert (home / "look.rrd").stat().st_size > 10_000


def test_odometry_and_evaluate_go_on_from_a_bag(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("small_gicp", reason="needs small_gicp")
    assert main(command("carlaloc odometry")[1:]) == 0
    capsys.readouterr()
    assert main([*command("carlaloc evaluate")[1:], "--json"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["results"]
    assert result["coverage"] > 0.9
    assert result["metrics"]["ape_translation"]["rmse"] < 0.3


@pytest.mark.long
def test_evalio_lists_the_sequences(home: Path) -> None:
    pytest.importorskip("evalio", reason="needs evalio")
    *settings, _, what, kind = command("CARLALOC_DATA=")
    environment = os.environ | dict(word.split("=") for word in settings) | {"COLUMNS": "400"}
    program = Path(sys.executable).with_name("evalio")
    done = subprocess.run(
        [str(program), what, kind], env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode and subprocess.run([str(program), "--help"], capture_output=True).returncode:
        pytest.skip(f"evalio's command does not start here: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    shown = re.sub(r"\s", "", done.stdout).lower()
    assert "carla_loc" in shown or "carlaloc" in shown
