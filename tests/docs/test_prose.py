"""The style check of `make check` finds bad sentences; help and public docstrings keep its rules, too."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from shared_fixtures.processes.commands import all_commands

import carlaloc_env
import recorder


@pytest.fixture(scope="module")
def prose() -> ModuleType:
    spec = importlib.util.spec_from_file_location("prose", Path(__file__).parents[2] / ".ci" / "prose.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("rule", "sentence"),
    [
        ("subject", "What is killed while building blocks others."),
        ("subject", "Go to `town/`; who builds it, waits."),
        ("subject", "The file is kept for whoever comes later."),
        ("verb of speech", "The command tells the time."),
        ("verb of speech", "This is said in [the page](page.md)."),
        ("more than 35 words", "The car " + "goes on and on " * 9 + "."),
        ("more than 6 numbers", "It takes 1, 2, 3.5, 4, 5 000, 6 or 7 s."),
    ],
)
def test_a_bad_sentence_is_found_in_its_line(prose: ModuleType, rule: str, sentence: str) -> None:
    page = f"# What is told\n\n* It is 5 m long.\n* It is wide. {sentence} It ends.\n\n| what | told |\n"
    ((line, broken, _),) = prose.faults(page)
    assert (line, broken) == (4, rule)


@pytest.mark.parametrize(
    "page",
    [
        "How is fog drawn? What a question?",
        "It takes 3 s (1, 2, 3, 4, 5, 6 and 7 cores) in Towns 01, 03, 04, 05, 06, 07 and 10.",
        "Run this:\n\n```sh\necho what nobody told\n```\n",
        "The option `--tell-me what` prints the date.",
        "| what | told |\n|---|---|\n| 1 | " + "word " * 40 + "|\n",
        "* " + "One item has ten words and so has every other " * 2 + "\n* " + "word " * 20 + "\n",
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
    texts = list(_docstrings())
    assert len(texts) > 400
    items = [re.sub(r"(?m)^ +(?=\*{0,2}\w+: )", "* ", re.sub(r"(?m)^\w+:$", "", text)) for text in texts]
    assert [fault for text in items for fault in prose.faults(text)] == []


def _docstrings() -> Iterator[str]:
    for package in (carlaloc_env, recorder):
        for value in (getattr(package, name) for name in package.__all__):
            if not inspect.isclass(value) and not inspect.isfunction(value):
                continue
            tree = ast.parse(inspect.cleandoc("\n" + inspect.getsource(value)))
            for node in ast.walk(tree):
                if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                    yield inspect.cleandoc(str(node.value.value))
