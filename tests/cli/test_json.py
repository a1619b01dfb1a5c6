"""`--json` gives one JSON document on stdout, whatever happens; commands come from the parsers."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.processes.commands import all_commands, required_words

from recorder.cli.arguments import input_path
from recorder.cli.commands import info
from recorder.cli.main import main
from recorder.cli.output import to_json

Capture = pytest.CaptureFixture[str]
COMMANDS = [pytest.param(words, parser, id=" ".join(words)) for words, parser in all_commands()]


def strict(text: str) -> Any:
    """The document, by the letter of the standard: NaN and Infinity are none of JSON's."""

    def refuse(word: str) -> None:
        raise ValueError(word)

    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize(("words", "parser"), COMMANDS)
def test_errors_are_json(
    words: tuple[str, ...], parser: argparse.ArgumentParser, tmp_path: Path, capfd: Capture
) -> None:
    """An option that does not exist, an argument that is missing, an input that is not there."""
    cases = [[*words, "--no-such-option", "--json"], ["--json", *words[:-1], "no-such-command"]]
    needed = required_words(parser, tmp_path / "missing")
    if needed:
        cases += [[*words, "--json"]]
    if any(action.required and action.type is input_path for action in parser._actions):
        cases += [[*words, *needed, "--json"]]
    for case in cases:
        code = main(case)
        captured = capfd.readouterr()
        document = strict(captured.out)
        assert code in (1, 2), case
        assert document["error"] in captured.err
        assert "Traceback" not in captured.err
    assert not (tmp_path / "missing").exists()


@pytest.mark.parametrize(("words", "parser"), COMMANDS)
def test_help_is_json_too(words: tuple[str, ...], parser: argparse.ArgumentParser, capfd: Capture) -> None:
    assert main([*words, "--help", "--json"]) == 0
    assert "usage: carlaloc" in strict(capfd.readouterr().out)["text"]


def test_an_error_nobody_foresaw(monkeypatch: pytest.MonkeyPatch, capfd: Capture) -> None:
    """The traceback goes on; stdout still holds a document."""

    def broken(_: argparse.Namespace) -> dict[str, Any]:
        raise ZeroDivisionError("by hand")

    monkeypatch.setattr(info, "run", broken)
    with pytest.raises(ZeroDivisionError):
        main(["info", "x.mcap", "--json"])
    assert strict(capfd.readouterr().out) == {"error": "ZeroDivisionError: by hand"}


def test_numbers_that_json_does_not_know() -> None:
    result = {
        "nan": math.nan, "inf": [math.inf, np.float32(np.nan)], "array": np.arange(3),
        "path": Path("a"), "count": np.int64(7), "yes": np.bool_(True), "text": "ü\n", 3: None,
    }  # fmt: skip
    assert strict(to_json(result)) == {
        "nan": None, "inf": [None, None], "array": [0, 1, 2],
        "path": "a", "count": 7, "yes": True, "text": "ü\n", "3": None,
    }  # fmt: skip
