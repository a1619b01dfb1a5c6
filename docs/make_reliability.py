"""Write docs/reliability.md out of the long tests: `python docs/make_reliability.py`.

It takes some hours on two cores.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("reliability.md")
HEAD = """\
# Reliability

Written by `docs/make_reliability.py` from a run of the tests named in the last column, on two cores
without a GPU. What is promised: nothing but a named error of one line for any input; nothing written
outside the output; nothing half-written under a final name; at most the last second of a drive lost.

| what | tried | refused by name | longest answer | memory grew by | lost or broken | shown by |
|---|---|---|---|---|---|---|
"""
ROWS = (
    ("tests/robustness", "test_a_hundred_thousand_inputs"),
    ("tests/robustness", "test_killed_at_random_moments"),
    ("tests/robustness", "test_disk_fills_up_at_random_places"),
    ("tests/drive", "test_killed_at_fifty_random_moments"),
    ("tests/env", "a_row or resets"),
)
"""Folders and names of the long tests that are told."""


def main() -> None:
    """Run the tests and write the page; the page is left as it is where one of them failed."""
    rows: list[str] = []
    for folder, name in ROWS:
        with tempfile.TemporaryDirectory() as work:
            report = Path(work) / "report.xml"
            command = [
                sys.executable,
                "-m",
                "pytest",
                folder,
                "-m",
                "soak",
                "-k",
                name,
                f"--junitxml={report}",
            ]
            if subprocess.run(command, cwd=ROOT, check=False).returncode:
                sys.exit(f"{folder} {name} failed; {PAGE.name} is left as it is")
            rows += _rows(report, folder)
    PAGE.write_text(HEAD + "\n".join(rows) + "\n", encoding="utf-8")


def _rows(report: Path, folder: str) -> Iterator[str]:
    for case in ElementTree.parse(report).iter("testcase"):
        told = {item.get("name"): item.get("value") for item in case.iter("property")}
        if "inputs" not in told:
            continue
        cells = [
            told.get("what", case.get("name", "")),
            f"{int(told['inputs'] or 0):,}".replace(",", " "),
            told.get("refused", "–"),
            told.get("slowest", "–"),
            told.get("growth", "–"),
            told.get("lost", "nothing"),
            f"`{folder}`",
        ]
        yield "| " + " | ".join(str(cell) for cell in cells) + " |"


if __name__ == "__main__":
    main()
