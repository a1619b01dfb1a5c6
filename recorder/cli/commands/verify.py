"""Verify a dataset: checksums, counts, stamps, gaps, stereo pairs, and its calibration against its data.

Examples:
  carlaloc verify data
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

from recorder.cli.arguments import input_path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc verify`."""
    parser.add_argument("folder", type=input_path, help="folder of the dataset")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Verify."""
    from recorder.generation.verification.verify import verify

    result = verify(arguments.folder)
    return {**asdict(result), "failed": bool(result.findings)}


def show(result: dict[str, Any]) -> None:
    """Print what is wrong."""
    for line in result["findings"]:
        print(line)
    wrong = f"{len(result['findings'])} things are wrong" if result["findings"] else "nothing is wrong"
    print(f"{result['files']} files, {result['sequences']} sequences: {wrong}")
