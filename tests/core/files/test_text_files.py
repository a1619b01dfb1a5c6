"""Text files that users give are read whatever editor wrote them, and refused in words of ours."""

from collections.abc import Callable
from pathlib import Path

import pytest

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.map.config import TownConfig
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.weather.schedule import weather_of
from recorder.devices.profile import known_profiles
from recorder.evaluation.trajectory_files import read_tum

READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "rig": ("rig.yaml", SensorRig.load),
    "weather schedule": ("weather.yaml", weather_of),
    "town.toml": ("town.toml", TownConfig.from_toml),
    "trajectory": ("estimate.tum", read_tum),
    "device profile": ("wheel.yaml", lambda path: known_profiles(path.parent)),
}


def test_a_byte_order_mark_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(b"\xef\xbb\xbfna\xc3\xafve")
    assert read_text(path, "note") == "naïve"


@pytest.mark.parametrize("kind", READERS)
def test_binary_files_are_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    """Which file, what it should be, where it stops being text; nothing of codecs."""
    name, read = READERS[kind]
    path = tmp_path / name
    path.write_bytes(b"caf\xe9: 1\n")
    with pytest.raises(CarlaLocError) as caught:
        read(path)
    said = str(caught.value)
    assert said.startswith(f"cannot read the {kind} {path}: no UTF-8 text at byte 4; ")
    assert "codec" not in said
    assert "\n" not in said


def test_missing_files_are_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"^cannot read the trajectory .*: No such file or directory"):
        read_tum(tmp_path / "nothing.tum")
