"""The names that options take stand in `--help` and in docs."""

import re
from pathlib import Path

import pytest

from carlaloc_env.rigs.presets import RIGS
from recorder.cli.main import main
from recorder.dataset.layout import FORMATS
from recorder.devices.base import DEVICES
from recorder.evaluation.align import Alignment
from recorder.writers.topic_profiles import PROFILES

ROOT = Path(__file__).parents[2]
NAMES = {
    ("replay", "--format"): set(FORMATS),
    ("replay", "--topics"): set(PROFILES),
    ("replay", "--rig"): set(RIGS),
    ("record", "--device"): set(DEVICES),
    ("evaluate", "--align"): {alignment.name.lower() for alignment in Alignment},
}


@pytest.mark.parametrize(("command", "option"), NAMES)
def test_help_names_all_that_an_option_takes(
    command: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--help"]) == 0
    text = capsys.readouterr().out.split("options:")[1]
    block = re.split(r"\n  -", text[text.index(f"\n  {option}") + 3 :])[0]
    assert NAMES[command, option] <= set(re.findall(r"\w+", block.partition("\n")[0] + block))


@pytest.mark.parametrize(
    ("page", "names"), [("docs/formats.md", {*FORMATS, *PROFILES}), ("docs/sensors.md", {*RIGS})]
)
def test_pages_name_all_formats_profiles_and_rigs(page: str, names: set[str]) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert not [name for name in names if f"`{name}`" not in text]
