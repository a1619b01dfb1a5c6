"""Write docs/reliability.md from the long tests: `python docs/scripts/make_reliability.py`.

It takes some hours on two cores. Reports of tests that passed stay in `out/reliability`; an interrupted run
resumes after them; before a run after changes, remove that folder.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[2]
REPORTS = ROOT / "out" / "reliability"
PAGE = Path(__file__).parents[1] / "reliability.md"
PYTEST = (sys.executable, "-m", "pytest")
HEAD = """\
# Reliability

`docs/scripts/make_reliability.py` writes this page from a run of the tests in the last column, on two cores
without a GPU. The guarantees: any bad input gives a named error of one line and nothing else; files are
written only in the output; writes are atomic; a drive loses at most its last second.

| case | tried | refused by name | longest answer | memory grew by | lost or broken | shown by |
|---|---|---|---|---|---|---|
"""
TOLD = (
    ("tests/bad_input", "test_a_hundred_thousand_inputs or at_random"),
    ("tests/drive", "test_killed_at_fifty_random_moments"),
    ("tests/envs", "a_row or resets"),
)
"""Folders and names of the reported long tests."""


def main() -> None:
    """Run the tests and write the page; the page is left as it is where one of them failed."""
    REPORTS.mkdir(parents=True, exist_ok=True)
    rows: list[str] = []
    for folder, names in TOLD:
        for test in _tests(folder, names):
            rows += _rows(_report(test), folder)
    PAGE.write_text(HEAD + "\n".join(rows) + "\n", encoding="utf-8")


def _tests(folder: str, names: str) -> list[str]:
    """Names of the long tests of a folder, one a parameter."""
    command = [*PYTEST, "--collect-only", folder, "-m", "soak", "-k", names]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [line for line in listed.splitlines() if "::" in line]


def _report(test: str) -> Path:
    """Report of a test, from this run or an earlier one."""
    report = REPORTS / (re.sub(r"\W+", "_", test.split("::")[1]).strip("_") + ".xml")
    if not report.exists():
        sys.stderr.write(f"{test}\n")
        running = report.with_suffix(".part")
        command = [*PYTEST, "-m", "soak", test, f"--junitxml={running}"]
        if subprocess.run(command, cwd=ROOT, check=False).returncode:
            sys.exit(f"{test} failed; {PAGE.name} is left as it is")
        running.rename(report)
    return report


def _rows(report: Path, folder: str) -> Iterator[str]:
    for case in ElementTree.parse(report).iter("testcase"):
        properties = {item.get("name"): item.get("value") for item in case.iter("property")}
        if "inputs" not in properties:
            continue
        cells = [
            properties.get("what", case.get("name", "")),
            f"{int(properties['inputs'] or 0):,}".replace(",", " "),
            properties.get("refused", "–"),
            properties.get("slowest", "–"),
            properties.get("growth", "–"),
            properties.get("lost", "nothing"),
            f"`{folder}`",
        ]
        yield "| " + " | ".join(str(cell) for cell in cells) + " |"


if __name__ == "__main__":
    main()
