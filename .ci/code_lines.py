"""Print how many lines of code each folder has, beside the project's budgets; information, never a failure.

A line counts if it holds code: no blanks, comments, docstrings and imports.
"""

import ast
import io
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUDGETS = {"carlaloc_env + recorder": 65_900, "tests": 35_500}
LAYOUT = {getattr(tokenize, name) for name in ("COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENDMARKER")}


def code_lines(source: str) -> int:
    """Lines of a Python source that hold code."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in LAYOUT:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        text = isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str)
        if text or isinstance(node, ast.Import | ast.ImportFrom):
            lines.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def main() -> None:
    """Print one line."""
    parts = []
    for name in (*BUDGETS, "maps", "docs", "examples", "benchmarks", ".ci"):
        files = [path for folder in name.split(" + ") for path in (ROOT / folder).rglob("*.py")]
        count = sum(code_lines(path.read_text(encoding="utf-8")) for path in files)
        parts.append(f"{name} {count}" + (f" (budget {BUDGETS[name]})" if name in BUDGETS else ""))
    print("lines of code:", ", ".join(parts))


if __name__ == "__main__":
    main()
