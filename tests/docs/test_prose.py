"""Checks of sentences, commit subjects and lines of code; help and public docstrings keep the rules, too."""

import inspect
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from shared_fixtures.processes.checkout import ROOT, script
from shared_fixtures.processes.commands import all_commands

import carlaloc_env
import recorder


@pytest.fixture(scope="module")
def prose() -> ModuleType:
    return script(".ci/prose.py")


@pytest.mark.parametrize(
    ("rule", "sentence"),
    [
        ("subject", "What is killed while building blocks others."),
        ("count as a subject", "Three exceed the bound."),
        ("verb of speech", "The command tells the time."),
        ("'goes on' (better: continue, resume)", "After a kill the same command goes on."),
        ("more than 35 words", "The car " + "drives on and on " * 9 + "."),
        ("more than 6 numbers", "It takes 1, 2, 3.5, 4, 5 000, 6 or 7 s."),
    ],
)
def test_a_bad_sentence_is_found_in_its_line(prose: ModuleType, rule: str, sentence: str) -> None:
    page = f"# Things told\n\n* It is 5 m long.\n* It is wide. {sentence} It ends.\n\n| what | told |\n"
    ((line, broken, _),) = prose.faults(page)
    assert (line, broken) == (4, rule)


@pytest.mark.parametrize("title", ["The estimate at the wheel", "Why we differ", "It ends."])
def test_a_title_that_names_no_subject_is_found(prose: ModuleType, title: str) -> None:
    """A line of a shell block is no title."""
    page = f"# Sweeps\n\n```sh\n# Why we wait\n```\n\n## {title}\n"
    assert (7, "title") in [(line, rule) for line, rule, _ in prose.faults(page)]


@pytest.mark.parametrize(
    "page",
    [
        "How is fog drawn? What a question?",
        "# Sweeps and breaking points\n\n## How to add a sensor\n\n### Where does a scan come from?\n",
        "Three of seven findings are reproduced. Half of the runs fail. It has 4 of 5 wheels.",
        "Run this:\n\n```sh\necho what nobody told\n```\n",
        "The option `--tell-me what` prints the date.",
        "| what | told |\n|---|---|\n| 1 | " + "word " * 40 + "|\n",
    ],
)
def test_good_text_code_and_tables_pass(prose: ModuleType, page: str) -> None:
    assert list(prose.faults(page)) == []


def test_help_keeps_the_rules(prose: ModuleType) -> None:
    """Descriptions without their examples, and every option."""
    texts = {
        re.sub(r"(?m)^Examples:\n(?:  .*\n?)*", "", parser.description or "") for _, parser in all_commands()
    }
    texts |= {action.help or "" for _, parser in all_commands() for action in parser._actions}
    assert [fault for text in texts for fault in prose.faults(text)] == []


def test_public_docstrings_keep_the_rules(prose: ModuleType) -> None:
    """Those of public names, their fields and their public methods; an argument's line is an item."""
    texts = [text for source in _public_sources() for _, text in prose.docstrings(source)]
    assert len(texts) > 400
    assert [fault for text in texts for fault in prose.faults(text)] == []


def _public_sources() -> Iterator[str]:
    for package in (carlaloc_env, recorder):
        for value in (getattr(package, name) for name in package.__all__):
            if inspect.isclass(value) or inspect.isfunction(value):
                yield inspect.cleandoc("\n" + inspect.getsource(value))


def test_scripts_and_tutorials_are_checked(prose: ModuleType) -> None:
    """Docstrings and the Markdown cells of tutorials, with the lines at which they begin."""
    found = {(path.relative_to(prose.ROOT).as_posix(), line): text for path, line, text in prose.texts()}
    assert found["docs/tutorials/dataset.py", 2].startswith("# A dataset\n\nA drive is recorded once")
    assert found["examples/04_evaluate.py", 1].startswith("Score an estimate")
    items = dict(prose.docstrings('def f(a):\n    """Go.\n\n    Args:\n        a: First.\n    """\n'))
    assert items == {2: "Go.\n\n\n* a: First."}


SPOKEN = """
def _tell_all(told, retold=0):
    self._said = [says for says in told]
    stated = file.tell()
"""


def test_names_that_are_verbs_of_speech_are_found(prose: ModuleType) -> None:
    """Where they are given: a call of `file.tell()` is no fault."""
    assert sorted(prose.spoken_names(SPOKEN)) == [(2, "_tell_all"), (2, "told"), (3, "_said"), (3, "says")]


@pytest.mark.parametrize(
    ("subject", "fault"),
    [
        ("docs: name the subject in titles", ""),
        ("Name the subject in titles", "no `area: `"),
        ("docs: named the subject", "no imperative"),
        ("docs: name the subject.", "full stop"),
        ("docs: name the subject" + " of it" * 9, "76 characters, more than 72"),
    ],
)
def test_commit_subjects(subject: str, fault: str, tmp_path: Path) -> None:
    """A hook runs the script on the file of the message, in which git writes comments, too."""
    message = tmp_path / "COMMIT_EDITMSG"
    message.write_text(f"# A comment.\n{subject}\n\nThe body is free. It has any length." + " word" * 20)
    done = subprocess.run(
        [ROOT / ".ci" / "commit-subject", message], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (int(bool(fault)), "")
    assert fault in done.stderr
    assert len(done.stderr.splitlines()) == int(bool(fault))


def test_lines_of_code_are_counted() -> None:
    """Neither docstrings, comments, blanks nor imports count; every line of a longer statement does."""
    source = "'''Docstring\nin two lines.'''\n\nfrom math import (\n    pi,\n)\n\n"
    source += "text = '''a string\nof two lines''' + str(  # Comment.\n    pi\n)\n"
    assert script(".ci/code_lines.py").code_lines(source) == 4
