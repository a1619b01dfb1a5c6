"""Verify a dataset: checksums, counts, stamps, gaps, stereo pairs, and its calibration against its data.

Examples:
  carlaloc verify data
  carlaloc verify data --against /mnt/made_elsewhere/data
"""

import argparse
from dataclasses import asdict
from typing import Any

from recorder.cli.arguments import input_path, option


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc verify`."""
    parser.add_argument("folder", type=input_path, help="folder of the dataset")
    text = "compare with the same dataset made elsewhere; pictures and events may differ within bounds"
    option(parser, "--against", input_path, "DIR", text)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Verify."""
    from recorder.verification.verify import verify

    result = verify(arguments.folder, against=arguments.against)
    return {**asdict(result), "failed": bool(result.findings)}


def show(result: dict[str, Any]) -> None:
    """Print what is wrong."""
    for line in result["findings"]:
        print(line)
    if result["within"]:
        print(f"{len(result['within'])} files differ within the bounds for another kind of processor")
    wrong = f"{len(result['findings'])} things are wrong" if result["findings"] else "nothing is wrong"
    print(f"{result['files']} files, {result['sequences']} sequences: {wrong}")
