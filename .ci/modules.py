"""Check that a module has one subject: one paragraph of docstring, and constants before its first definition.

Modules that were glued together show three or more constants below their first class or function, or three or
more paragraphs in their docstring.
"""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
MOST = 2
"""Constants below the first definition, and paragraphs of the docstring, at most."""
LATE_CONSTANTS = {
    "carlaloc_env/assets/catalog.py": "tables made of the classes above them",
    "carlaloc_env/envs/task/state_vector.py": "tables made of the class above them",
    "carlaloc_env/scenery/buildings/walls.py": "tables made by the function above them",
    "recorder/slam/runners/evalio_pipelines.py": "one function with the name of each pipeline",
}
"""Modules with more such constants, each with its reason."""
LONG_DOCSTRINGS: dict[str, str] = {}
"""Modules that keep longer docstrings, each with the reason."""


def late_constants(tree: ast.Module) -> int:
    """Number of constants below the first class or function."""
    definitions = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    first = next((node.lineno for node in tree.body if isinstance(node, definitions)), sys.maxsize)
    return sum(isinstance(node, ast.Assign | ast.AnnAssign) and node.lineno > first for node in tree.body)


def paragraphs(tree: ast.Module) -> int:
    """Number of paragraphs of the module's docstring."""
    return len((ast.get_docstring(tree) or "").split("\n\n"))


def main() -> int:
    """Print a line per module that breaks the rule, or whose exception is no longer needed."""
    counts = {}
    for package in ("carlaloc_env", "recorder"):
        for path in sorted((ROOT / package).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            counts[str(path.relative_to(ROOT))] = (late_constants(tree), paragraphs(tree))
    faults = 0
    kinds = ("constants below the first definition", "paragraphs of docstring")
    for column, (kind, exceptions) in enumerate(zip(kinds, (LATE_CONSTANTS, LONG_DOCSTRINGS), strict=True)):
        many = {name for name, count in counts.items() if count[column] > MOST}
        for name in sorted(many - exceptions.keys()):
            print(f"{name}: {counts[name][column]} {kind}; split it by subject, or move them up")
        for name in sorted(exceptions.keys() - many):
            print(f"{name}: has few {kind} by now; take it off the list in .ci/modules.py")
        faults += len(many ^ exceptions.keys())
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
