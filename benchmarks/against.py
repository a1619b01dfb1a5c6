"""Measure rows here and at another commit, in turns: `python benchmarks/against.py f9376d4b camera events`.

Prints ratios, here over there: of each row's figure, median time and CPU time, as medians over the turns.
The other commit is checked out in out/against-COMMIT and uses the libraries of this Python.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rows.table import ROWS

ROOT = Path(__file__).parents[1]
COLUMNS = ("figure", "median", "CPU")


def checkout(commit: str) -> Path:
    """The other commit beside this one, made where it is missing."""
    folder = ROOT / "out" / f"against-{commit}"
    if not folder.exists():
        command = ["git", "worktree", "add", "--quiet", "--detach", str(folder), commit]
        subprocess.run(command, cwd=ROOT, check=True)
        # The installed package maps `carlaloc_env.maps` to this checkout's towns; the other has its own.
        (folder / "carlaloc_env" / "maps").symlink_to(folder / "maps")
    return folder


def measure(checkout: Path, name: str, repeat: int) -> dict[str, Any] | None:
    """A row as JSON, None where that commit has no such row or cannot measure it."""
    with TemporaryDirectory() as folder:
        out = Path(folder, "row.json")
        words = ["benchmarks/run.py", "--only", name, "--repeat", str(repeat), "--json", str(out)]
        environment = os.environ | {"PYTHONPATH": str(checkout)}
        subprocess.run(
            [sys.executable, *words], cwd=checkout, env=environment, capture_output=True, check=False
        )
        if not out.exists():
            return None
        (row,) = json.loads(out.read_text())["rows"]
        return dict(row)


def figures(row: dict[str, Any] | None) -> tuple[float | None, float | None, float | None]:
    """Figure, median time and CPU time of a row, as far as it has them."""
    if row is None:
        return None, None, None
    ours = row["ours"] or {}
    return row["value"], ours.get("median_s"), ours.get("cpu_s")


def compare(name: str, other: Path, turns: int, repeat: int) -> list[str]:
    """Ratios of a row, here over there, as cells of the table."""
    ratios: list[list[float]] = [[], [], []]
    for _ in range(turns):
        there, here = (figures(measure(place, name, repeat)) for place in (other, ROOT))
        for column, (ours, theirs) in enumerate(zip(here, there, strict=True)):
            if ours is not None and theirs:
                ratios[column].append(ours / theirs)
    return [f"{statistics.median(column):.2f}" if column else "–" for column in ratios]


def main() -> None:
    """Measure row after row and print a line for each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("commit", help="the other commit")
    parser.add_argument("rows", nargs="*", default=list(ROWS), metavar="ROW", help="rows (all)")
    parser.add_argument("--turns", type=int, default=3, metavar="N", help="measurements of each (3)")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="timed calls in each (3)")
    options = parser.parse_args()
    other = checkout(options.commit)
    print(f"{'here / ' + options.commit:<22}" + "".join(f"{column:>9}" for column in COLUMNS), flush=True)
    for name in options.rows:
        cells = compare(name, other, options.turns, options.repeat)
        print(f"{name:<22}" + "".join(f"{cell:>9}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
