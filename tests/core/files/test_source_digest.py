"""What kept files are named after: every source that went into them, found by reading imports."""

import ast
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from carlaloc_env.core.files import source_digest as module
from carlaloc_env.core.files.source_digest import imported_by, source_digest

ROOT = Path(__file__).parents[3]
BUILDERS = (
    "carlaloc_env.town.build",
    "carlaloc_env.assets.model_library",
    "carlaloc_env.render.textures.build",
)


def _imports(source: bytes) -> Iterator[str]:
    """Names that a source imports, by Python's own parser: modules, and what is taken from them."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports are not read"
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _is_module(name: str) -> bool:
    path = ROOT.joinpath(*name.split("."))
    return path.with_name(f"{path.name}.py").is_file() or (path / "__init__.py").is_file()


@pytest.mark.parametrize("builder", BUILDERS)
def test_every_import_is_followed(builder: str) -> None:
    """The sources are closed under imports, as Python's parser reads them; libraries are all there."""
    importlib.import_module(builder)
    sources, libraries = imported_by(builder)
    assert len(sources) > 10
    for content in sources.values():
        for name in _imports(content):
            top = name.partition(".")[0]
            if top == "carlaloc_env":
                assert name in sources or not _is_module(name) or name == top, name
            else:
                assert top in libraries or top in sys.stdlib_module_names, name


def test_shapely_and_numpy_shape_towns() -> None:
    assert {"numpy", "shapely"} <= imported_by("carlaloc_env.town.build")[1]


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of two folders: `made.a.top` imports `made.b.deep` in a function, beside `made.b.other`."""
    folder = tmp_path / "made"
    for name in ("", "a", "b"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("")
    (folder / "a" / "top.py").write_text(
        "def f():\n    from made.b import (\n        deep,\n    )\n    return deep\n"
    )
    (folder / "b" / "deep.py").write_text("import json, numpy\nX = 1\n")
    (folder / "b" / "other.py").write_text("X = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("made.a.top")

    yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == "made"]:
        del sys.modules[name]


def _digest() -> str:
    source_digest.cache_clear()
    module._read.cache_clear()
    return source_digest("made.a.top")


def test_a_digest_changes_with_what_is_imported_and_with_nothing_else(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = _digest()
    (package / "b" / "other.py").write_text("X = 2\n")
    assert _digest() == before
    (package / "b" / "deep.py").write_text("import json, numpy\nX = 2\n")
    edited = _digest()
    assert edited != before
    module._version.cache_clear()
    monkeypatch.setattr("numpy.__version__", "0.0.1")
    assert _digest() != edited
    module._version.cache_clear()
