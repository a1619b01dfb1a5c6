"""Show what moving cars do to SLAM: a first picture within a minute, then sequences, systems and errors.

Examples:
  carlaloc demo
  carlaloc demo --look
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import rmtree
from typing import Any

from carlaloc_env.core.files.file_locks import take_lock
from recorder.cli.arguments import OutputFolder, option, positive_seconds, seconds
from recorder.cli.output import announced
from recorder.cli.progress import Progress

UNFINISHED = ".carlaloc-demo"
"""File that marks the folder of an unfinished demo; locked, so that one run works at a time."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc demo`."""
    parser.add_argument(
        "--out",
        type=OutputFolder(),
        default=Path("carlaloc-demo"),
        help="folder for the results (default: carlaloc-demo, or the next number of it); the same command "
        "resumes an unfinished demo",
    )
    parser.add_argument("--look", action="store_true", help="end after the first picture")
    option(parser, "--start", seconds, "S", "of the drive's 26 s (16)", 16.0)
    option(parser, "--duration", positive_seconds, "S", "replayed (8)", 8.0)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run the demo, or what an interrupted one has left to do."""
    began = time.monotonic()
    from recorder.demo.run import run_demo
    from recorder.demo.story import DemoConfig, cost_of
    from recorder.replaying.code_digest import code_digest

    options = {name: getattr(arguments, name) for name in ("start", "duration")}

    def look(page: Path) -> None:
        print(f"look at {page} after {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)

    with _folder(arguments.out, json.dumps([options, code_digest()])) as out:
        config = DemoConfig(out=out, **{f"{name}_s": seconds for name, seconds in options.items()})
        if not arguments.look:
            announced(cost_of(config))
        result = run_demo(config, only_look=arguments.look, step=Progress, look=look)
    return result if arguments.look else {**result, "took_s": round(time.monotonic() - began, 1)}


@contextmanager
def _folder(out: Path, demo: str) -> Iterator[Path]:
    """Hold the folder of an unfinished demo, or a new one: of that name, or with the first free number.

    Args:
        out: The folder.
        demo: All that determines what the demo writes.
    """
    for candidate in (out, *(out.with_name(f"{out.name}-{number}") for number in range(2, 10_000))):
        mark = candidate / UNFINISHED
        if candidate.exists() and not mark.exists():
            continue
        candidate.mkdir(parents=True, exist_ok=True)
        with mark.open("a+", encoding="utf-8") as file:
            file.seek(0)
            if not take_lock(file) or file.read() not in ("", demo):
                continue
            file.truncate(0)
            file.write(demo)
            file.flush()
            try:
                yield candidate
                mark.unlink()
            finally:
                if [*candidate.iterdir()] == [mark]:
                    rmtree(candidate)
        return


def show(result: dict[str, Any]) -> None:
    """Print errors, and where everything lies."""
    if "ape_m" in result:
        print(result["answer"])
        for system, by_condition in result["ape_m"].items():
            errors = "   ".join(f"{condition} {ape_m:.3f} m" for condition, ape_m in by_condition.items())
            print(f"  {system:<24}{errors}")
        for path in result["sequences"]:
            print(f"A sequence     {path}   (bag, EuRoC mav0/, preview.mp4)")
        print(f"Ground truth   {result['ground_truth']}")
        print(f"In 3-D         {result['scene']}")
        for path in result["drawn"]:
            print(f"A picture      {path}" if path.endswith(".png") else f"All runs       {path}")
        if result["missing"]:
            print(f"With the rest  {result['missing']}: LiDAR systems, figures, the page of all runs")
        print(f"Everything     {result['out']}   in {result['took_s'] / 60:.1f} min")
    print(f"Open           {result['page']}")
