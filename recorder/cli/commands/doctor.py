"""Report what works on this machine, how fast, and the packages to install for the rest."""

import argparse
from dataclasses import asdict
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc doctor`."""


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Examine this machine."""
    from recorder.doctor import examine

    report = examine()
    return {
        "findings": [asdict(finding) for finding in report.findings],
        "quality": report.quality,
        "failed": not report.healthy,
    }


def show(result: dict[str, Any]) -> None:
    """Print the findings."""
    for finding in result["findings"]:
        mark = "ok  " if finding["works"] else "FAIL" if finding["needed"] else "--  "
        print(f"{mark} {finding['name']:<12} {finding['detail']}")
        if finding["remedy"]:
            print(f"     {'':<12} → {finding['remedy']}")
    print(f"     {'pictures':<12} quality '{result['quality']}' suits this machine")
