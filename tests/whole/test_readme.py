"""What README and docs tell people to type is right, and README's commands really run."""

import csv
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.processes.commands import all_commands

from carlaloc_env.core.errors import RaycastError, RenderError
from recorder.cli.arguments import replay_options
from recorder.cli.main import COMMANDS, main, make_parser
from recorder.demo.answers import SEEDS
from recorder.demo.story import DemoConfig, cost_of
from recorder.evaluation.trajectory_files import read_tum
from recorder.replaying.cost import replay_cost
from recorder.writers.stream_sizes import Stretch

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
SHORTER = {
    "record": ["--duration", "4"],
    "replay": [
        *["--duration", "0.3", "--quality", "low"],
        *["--camera-start", "3", "--camera-duration", "0.05", "--workers", "1"],
    ],
    "evaluate": ["--align", "none"],
}
"""Documented options that make README's lines quick; they stand last and so replace what stands there.

A third of a second is too straight for an alignment.
"""


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a language."""
    found: list[str] = re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    return found


def command_lines(page: Path) -> list[list[str]]:
    """Words of every `carlaloc` line in a shell block, comments left out."""
    whole = (block.replace("\\\n", " ") for block in blocks(page, "sh"))
    lines = [line for block in whole for line in block.splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("carlaloc ")]


def mentions(page: Path) -> list[list[str]]:
    """Words of every complete `carlaloc` command in running text: those without ellipsis or choice."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    found = (code.split()[1:] for code in re.findall(r"`(carlaloc [^`]+)`", text))
    return [words for words in found if not set(" ".join(words)) & set("…<|")]


@pytest.mark.parametrize(
    "words", [words for page in PAGES for words in command_lines(page)], ids=lambda words: " ".join(words)
)
def test_every_command_parses(words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No option that does not exist, none that is missing."""
    monkeypatch.chdir(tmp_path)
    if "--condition" in words:  # a file that `carlaloc break` writes
        file = Path(words[words.index("--condition") + 1])
        file.parent.mkdir()
        file.write_text("weather: ClearNoon\n", encoding="utf-8")
    arguments = make_parser().parse_args(words)
    assert arguments.command == words[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_mentioned_command_exists(page: Path) -> None:
    """Commands and options in running text exist, even where the rest is left out."""
    for words in mentions(page):
        assert words[0] in COMMANDS
        options = {word for word in words if word.startswith("--")}
        known = {
            option
            for path, parser in all_commands()
            if path[0] == words[0]
            for option in parser._option_string_actions
        }
        assert options <= known


def test_the_table_is_that_of_the_kept_seeds() -> None:
    """Median and range of ten seeds, as the demo's file has them."""
    with SEEDS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = text.split("seeds.csv -->\n")[1].split("<!-- end")[0].splitlines()[2:]
    assert len(lines) == 3
    for line in lines:
        name, *cells = [cell.strip() for cell in line.strip("|").split("|")]
        system, weather = name.split(", ")
        for cell, traffic, cloud in zip(
            cells, ("static", "dynamic", "dynamic"), ("raw", "raw", "seg"), strict=True
        ):
            wanted = (system, weather, traffic, cloud)
            found = [
                float(r["ape_m"])
                for r in rows
                if (r["title"], r["weather"], r["traffic"], r["cloud"]) == wanted
            ]
            digits = 3 if system == "small_gicp" else 2
            low, high = (f"{value:.{digits}f}" for value in (min(found), max(found)))
            assert cell == f"{np.median(found):.{digits}f} m ({low}–{high})"


def test_readme_is_short() -> None:
    """A stranger reads it in three minutes; tables and details belong to docs."""
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 800


def test_readme_as_it_stands_fits_into_5_gb() -> None:
    """Demo, replay and dataset together, by the sizes that the commands print before they begin."""
    cost = cost_of(DemoConfig(out=ROOT))
    for words in command_lines(ROOT / "README.md"):
        if words[0] in ("replay", "dataset"):
            arguments = make_parser().parse_args(words)
            options = replay_options(arguments)
            stretches = (
                [Stretch(arguments.duration, arguments.camera_duration)] if words[0] == "replay" else []
            )
            stretches = stretches or [Stretch(arguments.sample, arguments.sample)] * len(arguments.towns)
            more = replay_cost(options, stretches, 2)
            cost = replace(more, written_bytes=cost.written_bytes + more.written_bytes)
    assert 3e9 < cost.written_bytes + cost.spooled_bytes < 5e9


def test_the_first_lines_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """doctor, record, replay, odometry, evaluate, as README has them, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    lines = [words for words in command_lines(ROOT / "README.md") if words[0] != "demo"][:5]
    assert [words[0] for words in lines] == ["doctor", "record", "replay", "odometry", "evaluate"]
    if main(lines[0]) != 0:
        pytest.skip(f"this machine cannot do all: {capfd.readouterr().out}")
    for words in lines[1:]:
        if words[0] == "odometry":
            pytest.importorskip("kiss_icp")
        if words[0] == "evaluate":
            assert len(read_tum(tmp_path / "estimate.tum")) == 6
            _pretend_estimate(tmp_path / "data/Town03/ground_truth/lidar.tum", tmp_path / "estimate.tum")
        assert main([*words, *SHORTER.get(words[0], [])]) == 0, capfd.readouterr().err
    exec(blocks(ROOT / "README.md", "python")[0].replace("duration_s=8", "duration_s=0.3"), {})
    assert (tmp_path / "night" / "Town03" / "RainyNight_dynamic" / "RainyNight_dynamic.bag").is_file()
    out, err = capfd.readouterr()
    assert "a false start" not in err
    assert re.search(r"APE, position.* rmse 10\.8167", out)
    assert (tmp_path / "figures" / "trajectories.png").is_file()
    for name in ("ClearNoon_static", "ClearNoon_dynamic", "FoggyNoon_static", "FoggyNoon_dynamic"):
        folder = tmp_path / "data" / "Town03" / name
        assert {f"{name}.bag", "mav0", "preview.mp4", "preview.png", "sequence.yaml", "SHA256SUMS"} == {
            path.name for path in folder.iterdir()
        }
    documented = set(re.findall(r"`([\w/-]+\.(?:yaml|md|json|launch))`", _calibration_section()))
    written = {
        str(path.relative_to(tmp_path / "data/Town03/calibration"))
        for path in (tmp_path / "data/Town03/calibration").rglob("*.*")
    }
    assert written == {f"vins_fusion/{n}" if re.fullmatch(r"cam\d.yaml", n) else n for n in documented}


def _calibration_section() -> str:
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    return text.split("## Calibration")[1].split("\n## ")[0]


def _pretend_estimate(truth: Path, estimate: Path) -> None:
    """The truth, shifted by √117 = 10.8167 m."""
    rows = np.loadtxt(truth)
    rows[:, 1:4] += (10.0, -4.0, 1.0)
    assert len(read_tum(truth)) == len(rows)
    np.savetxt(estimate, rows, fmt="%.9f")


def test_the_gymnasium_lines_run() -> None:
    """README's loop as it stands: half throttle brings the car forward."""
    block = blocks(ROOT / "README.md", "python")[1]
    code = [line for line in block.splitlines() if line and not line.startswith("import")]
    assert len(code) <= 8
    names: dict[str, object] = {}
    try:
        exec(compile(block, "README.md", "exec"), names)
    except (RenderError, RaycastError) as error:
        pytest.skip(str(error))
    observation, info = names["observation"], names["info"]
    assert isinstance(observation, dict)
    assert isinstance(info, dict)
    assert info["stamp_ns"] == 1_000_000_000
    assert 0.3 < info["route_s_m"] < 6.0
    assert observation["rgb_front"].std() > 5.0
    assert observation["speed"][0] > 0.5
