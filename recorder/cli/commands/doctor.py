"""Report what works on this machine, how fast, and the packages to install for the rest."""

import argparse
from dataclasses import asdict
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc doctor`."""
    parser.add_argument("--clear-cache", action="store_true", help="delete kept towns, models and textures")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Examine this machine, or clear the cache."""
    if arguments.clear_cache:
        from carlaloc_env.core.files.array_cache import clear_cache, default_cache_dir

        return {"cleared_bytes": clear_cache(), "cache": str(default_cache_dir())}
    from recorder.doctor import examine

    report = examine()
    return {
        "findings": [asdict(finding) for finding in report.findings],
        "quality": report.quality,
        "failed": not report.healthy,
    }


def show(result: dict[str, Any]) -> None:
    """Print the findings, or the size of the deleted files."""
    if "cache" in result:
        print(f"deleted {result['cleared_bytes'] / 1e9:.2f} GB in {result['cache']}")
        return
    for finding in result["findings"]:
        mark = "ok  " if finding["works"] else "FAIL" if finding["needed"] else "--  "
        print(f"{mark} {finding['name']:<12} {finding['detail']}")
        if finding["remedy"]:
            print(f"     {'':<12} → {finding['remedy']}")
    print(f"     {'pictures':<12} quality '{result['quality']}' suits this machine")
