"""No option of any command writes over what is there; the options come from the parsers themselves."""

import argparse
from pathlib import Path

import pytest
from shared_fixtures.processes.commands import all_commands, is_output, required_words

from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.output_paths import check_output_file, check_output_folder
from recorder.cli import arguments
from recorder.cli.commands.evaluate import body_transform
from recorder.cli.commands.record import route_place, route_start
from recorder.cli.commands.replay import car_number
from recorder.cli.main import main

CONTENT = b"bytes of a drive that nobody can make again"
OUTPUTS = [
    pytest.param(words, parser, action, id=" ".join((*words, action.dest)))
    for words, parser in all_commands()
    for action in parser._actions
    if is_output(action)
]
NAMES_THAT_ARE_READ = {
    "action", "align", "camera", "cluster", "device", "drop", "fault", "imu", "lidar", "map", "method",
    "over", "quality", "quaternion", "name", "ride", "rig", "roadside", "sensor", "time_field", "time_unit",
    "topic", "topics", "town", "traffic", "truth_quaternion", "truth_time_unit", "truth_topic", "weather",
}  # fmt: skip
"""Options that are plain text. Whoever adds one says here that it names nothing that is written."""
VALUES = (
    int, float, arguments.names, arguments.number, arguments.numbers, arguments.seconds,
    arguments.positive_seconds, arguments.positive_int, arguments.seed, arguments.number_or_search,
    body_transform, route_place, route_start, car_number,
)  # fmt: skip

Words, Parser, Action = tuple[str, ...], argparse.ArgumentParser, argparse.Action
Capture = pytest.CaptureFixture[str]


def run(words: Words, parser: Parser, action: Action, value: Path, *more: str) -> int:
    rest = required_words(parser, value.parent / "missing", without=action)
    return main([*words, *rest, action.option_strings[0], str(value), *more])


def test_every_option_is_of_a_known_kind() -> None:
    """A path is read or written, and its kind says which."""
    for words, parser in all_commands():
        for action in parser._actions:
            if action.nargs == 0 or is_output(action) or action.type is arguments.input_path:
                continue
            if action.type is None:
                assert action.choices or action.dest in NAMES_THAT_ARE_READ, (*words, action.dest)
            else:
                assert action.type in VALUES, (*words, action.dest)
    assert len(OUTPUTS) >= 10


@pytest.mark.parametrize(("words", "parser", "action"), OUTPUTS)
def test_what_exists_is_kept(
    words: Words, parser: Parser, action: Action, tmp_path: Path, capfd: Capture
) -> None:
    """A file of the right kind and one of another, with `--force` and without."""
    suffixes = action.type.suffixes if isinstance(action.type, arguments.OutputFile) else ("",)
    forces = "--force" in parser._option_string_actions
    assert forces or isinstance(action.type, arguments.OutputFolder)
    for suffix in {*suffixes, ".mcap", ".txt"}:
        there = tmp_path / f"there{suffix}"
        there.write_bytes(CONTENT)
        assert run(words, parser, action, there) == 1
        error = capfd.readouterr().err
        assert "there" in error
        assert suffix != ".mcap" or "--force" not in error
        if forces and suffix not in suffixes:
            assert run(words, parser, action, there, "--force") == 1
            assert suffixes == ("",) or "does not end in" in capfd.readouterr().err
        assert there.read_bytes() == CONTENT
        assert not (tmp_path / "missing").exists()


@pytest.mark.parametrize(("words", "parser", "action"), OUTPUTS)
def test_what_is_read_is_not_written(
    words: Words, parser: Parser, action: Action, tmp_path: Path, capfd: Capture
) -> None:
    """Not even with `--force` a command writes over its own input."""
    inputs = [a for a in parser._actions if a.type is arguments.input_path]
    if not inputs or not isinstance(action.type, arguments.OutputFile):
        pytest.skip("reads no file, or writes a folder")
    path = tmp_path / f"a{action.type.suffixes[0]}"
    path.write_bytes(CONTENT)
    rest = required_words(parser, tmp_path / "missing", without=action)
    for other in inputs:
        value = str(tmp_path / "missing" / other.dest)
        given = [str(path) if word == value else word for word in rest]
        if other.option_strings:
            given += [other.option_strings[0], str(path)]
        assert main([*words, *given, action.option_strings[0], str(path), "--force"]) == 1
        assert "is read by this command" in capfd.readouterr().err
        assert path.read_bytes() == CONTENT


def test_the_rule(tmp_path: Path) -> None:
    """Suffix first, then what is there; `overwrite` says yes to the second alone."""
    old = tmp_path / "old.csv"
    old.write_text("a")
    with pytest.raises(OutputError, match=r"does not end in \.png"):
        check_output_file(old, suffixes=(".png",), overwrite=True)
    with pytest.raises(OutputError, match="--force"):
        check_output_file(old, suffixes=(".csv",))
    assert check_output_file(old, suffixes=(".csv",), overwrite=True) == old
    (tmp_path / "to_nowhere.csv").symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="exists"):
        check_output_file(tmp_path / "to_nowhere.csv")
    with pytest.raises(OutputError, match="is a folder"):
        check_output_file(tmp_path, overwrite=True)
    for check in (check_output_file, check_output_folder):
        with pytest.raises(OutputError, match="is no folder"):
            check(old / "below" / "it.csv")
