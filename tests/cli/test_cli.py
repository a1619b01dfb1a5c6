"""The `carlaloc` command as a user meets it: results, exit codes, one-line errors, JSON."""

import json
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.ring_maps import ring_map

from recorder.cli.main import main, make_parser

Capture = pytest.CaptureFixture[str]


def run_json(capfd: Capture, *words: str, code: int = 0) -> Any:
    """Run a command with --json and parse what stands on stdout."""
    assert main([*words, "--json"]) == code
    return json.loads(capfd.readouterr().out)


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of the scripted driver, recorded by the command."""
    path = tmp_path_factory.mktemp("episode") / "drive.mcap"
    words = ["record", "--map", "Town03", "--out", str(path), "--duration", "6", "--seed", "2"]
    with redirect_stdout(StringIO()) as told:
        assert main([*words, "--json"]) == 0
    path.with_suffix(".json").write_text(told.getvalue())
    return path


def test_record_and_info_agree(episode: Path, capfd: Capture) -> None:
    """`info` names the distances, the actors and the health of what `record` wrote."""
    recorded = json.loads(episode.with_suffix(".json").read_text())
    info = run_json(capfd, "info", str(episode))
    assert info["duration_s"] == pytest.approx(6.0, abs=0.02)
    assert (info["vehicles"], info["walkers"], info["device"]) == (237, 34, "scripted")
    assert info["complete"] is True
    assert recorded["driven_m"] == info["driven_m"] > 1.0
    assert recorded["route_m"] == info["route_m"] == pytest.approx(info["driven_m"], abs=1.0)
    assert main(["info", str(episode)]) == 0
    text = capfd.readouterr().out
    assert "237 vehicles, 34 walkers" in text
    assert f"{info['driven_m']:.1f} m driven, {info['route_m']:.1f} m along the route" in text
    assert "complete" in text


def test_recording_twice_gives_the_same_drive(episode: Path, tmp_path: Path) -> None:
    """The same command records the same motion, bit for bit."""
    from recorder.episode.episode import Episode

    again = tmp_path / "again.mcap"
    assert main(["record", "--out", str(again), "--duration", "6", "--seed", "2"]) == 0
    first, second = Episode.load(episode), Episode.load(again)
    assert first.ego.tobytes() == second.ego.tobytes()
    assert first.steps.tobytes() == second.steps.tobytes()


def test_replay_and_evaluate(episode: Path, tmp_path: Path, capfd: Capture) -> None:
    """A replay without cameras writes a bag; its truth, shifted by 3-4-0 m, scores zero after alignment."""
    out = tmp_path / "data"
    result = run_json(
        capfd, "replay", str(episode), "--out", str(out), "--rig", "state", "--format", "rosbag1"
    )
    assert result["samples"]["imu"] == pytest.approx(1200, abs=5)
    truth = out / "Town03" / "ground_truth" / "imu.tum"
    rows = np.loadtxt(truth)
    rows[:, 1:4] += (3.0, 4.0, 0.0)
    estimate = tmp_path / "shifted.tum"
    np.savetxt(estimate, rows, fmt="%.9f")
    for align, error_m in (("none", 5.0), ("se3", 0.0)):
        words = ["--align", align, "--plot", str(tmp_path), "--force"]
        scores = run_json(capfd, "evaluate", "--truth", str(truth), str(estimate), *words)
        ape = scores["results"][0]["metrics"]["ape_translation"]
        assert ape["rmse"] == pytest.approx(error_m, abs=1e-6)
    assert (tmp_path / "trajectories.png").stat().st_size > 10_000


@pytest.mark.long
def test_maps(tmp_path: Path, capfd: Capture) -> None:
    """Towns are listed with their sizes; a good map has no faults; waypoints are written."""
    towns = run_json(capfd, "maps", "list")["towns"]
    town = next(town for town in towns if town["name"] == "Town03")
    assert town["junctions"] >= 10
    csv = tmp_path / "waypoints.csv"
    report = run_json(capfd, "maps", "check", town["path"], "--waypoints", "5", "--csv", str(csv))
    assert {problem["element"] for problem in report["report"]["problems"]} <= {"roadMark"}
    lines = csv.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "road_id,section,lane_id,s,x,y,z,heading"
    assert len(lines) > 1000


def test_maps_check_ends_with_1_for_what_hinders_driving(tmp_path: Path, capfd: Capture) -> None:
    """Warnings end with 0, or with 1 for authors; kinds are printed once, all are in the JSON."""
    path = tmp_path / "ring.xodr"
    records = "".join(f'<elevation s="{s}" a="0" b="0" c="0" d="0"/>' for s in (0, 20, 10, 5))
    path.write_text(
        ring_map(more=f"<elevationProfile>{records}</elevationProfile>", link=" "), encoding="utf-8"
    )
    assert main(["maps", "check", str(path)]) == 0
    lines = capfd.readouterr().out.splitlines()
    (kind,) = [line for line in lines if "ascending order" in line]
    assert "(2 of this kind; --all lists them)" in kind
    assert sum("is a dead end" in line for line in lines) == 1
    assert main(["maps", "check", str(path), "--all"]) == 0
    assert sum("ascending order" in line for line in capfd.readouterr().out.splitlines()) == 2
    report = run_json(capfd, "maps", "check", str(path), "--strict", code=1)["report"]
    assert {problem["severity"] for problem in report["problems"]} == {"warning"}
    assert report["origin"] == {"latitude_deg": 0, "longitude_deg": 0, "height_m": 0, "azimuth_deg": 0}
    path.write_text(ring_map().replace('"driving"', '"restricted"'), encoding="utf-8")
    report = run_json(capfd, "maps", "check", str(path), code=1)["report"]
    assert any("no lane is of type driving" in problem["message"] for problem in report["problems"])


@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        ("maps import a.osm --out o --bbox -76.62,39.28,-76.60,39.29", "bbox", (-76.62, 39.28, -76.6, 39.29)),
        ("closedloop Town01 --out o --offset -.3,0.3", "offset", (-0.3, 0.3)),
        ("evaluate a.tum --truth b.tum --time-offset -1e-3", "time_offset", -1e-3),
    ],
)
def test_negative_numbers_are_values_as_typed(words: str, name: str, value: Any) -> None:
    assert getattr(make_parser().parse_args(words.split()), name) == value


def test_negative_values_are_refused_by_their_own_rule(capfd: Capture) -> None:
    """Of an option that takes no negative number, not as an unknown option."""
    assert main(["replay", "drive.mcap", "--out", "o", "--start", "-2s"]) == 2
    assert "-2s is negative" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["record", "--map", "Tawn03", "--out", "{tmp}/a.mcap"], "did you mean 'Town03'"),
        (["record", "--device", "scriptd", "--out", "{tmp}/a.mcap"], "did you mean 'scripted'"),
        (["record", "--traffic", "dinamic", "--out", "{tmp}/a.mcap"], "did you mean 'dynamic'"),
        (["replay", "{episode}", "--out", "{tmp}/o", "--format", "eurok"], "did you mean 'euroc'"),
    ],
)
def test_errors_are_one_line_and_leave_nothing(
    words: list[str], hint: str, episode: Path, tmp_path: Path, capfd: Capture
) -> None:
    """A named error: exit code 1, one line on stderr, no file under a final name."""
    assert main([word.format(tmp=tmp_path, episode=episode) for word in words]) == 1
    captured = capfd.readouterr()
    lines = [line for line in captured.err.splitlines() if line.startswith("carlaloc")]
    assert len(lines) == 1
    assert hint in lines[0]
    assert captured.out == ""
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_truncated_episode_names_its_last_good_time(episode: Path, tmp_path: Path, capfd: Capture) -> None:
    """A cut-off file is not replayed; `info` tells until when it is good, and repair saves that."""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(episode.read_bytes()[: int(0.7 * episode.stat().st_size)])
    assert main(["replay", str(cut), "--out", str(tmp_path / "o")]) == 1
    assert "last good time" in capfd.readouterr().err
    info = run_json(capfd, "info", str(cut))
    assert info["complete"] is False
    assert 2.0 < info["duration_s"] < 6.0
    repaired = run_json(capfd, "info", "--repair", str(cut))
    assert repaired["complete"] is True
    assert repaired["duration_s"] == pytest.approx(info["duration_s"], abs=1.0)


@pytest.mark.parametrize("blocked", ["moderngl", "open3d"])
@pytest.mark.long
def test_what_needs_no_graphics_works_without(blocked: str, straight_map: Path, tmp_path: Path) -> None:
    """Without OpenGL or Open3D all the rest works; what needs them says so in one line."""
    code = (
        "import sys\n"
        f"sys.modules[{blocked!r}] = None\n"
        "from recorder.cli.main import main\n"
        f"out = {str(tmp_path)!r}\n"
        f"town = ['--map', {str(straight_map)!r}]\n"
        "assert main(['record', *town, '--out', out + '/d.mcap', '--duration', '1']) == 0\n"
        "assert main(['replay', out + '/d.mcap', *town, '--out', out + '/s', '--rig', 'state']) == 0\n"
        "paper = ['--out', out + '/p', '--rig', 'paper', '--workers', '1']\n"
        "assert main(['replay', out + '/d.mcap', *town, *paper]) == 1\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("carlaloc replay")]
    assert len(errors) == 1
    assert "apt-get install" in errors[0] or "pip install" in errors[0]
    assert not (tmp_path / "p" / "straight").exists()
