"""Show a recorded drive: a first picture within a minute, then sequences, SLAM systems and their errors.

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
from recorder.cli.terminal import Progress, announced

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
    option(parser, "--duration", positive_seconds, "S", "replayed (20)", 20.0)
    option(parser, "--camera-start", seconds, "S", "pictures begin here (4)", 4.0)
    option(parser, "--camera-duration", positive_seconds, "S", "of pictures (6)", 6.0)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run the demo, or what an interrupted one has left to do."""
    from recorder.replaying.conditions import code_digest

    options = {name: getattr(arguments, name) for name in ("duration", "camera_start", "camera_duration")}
    with _folder(arguments.out, json.dumps([options, code_digest()])) as out:
        return _show_steps(arguments, out)


def _show_steps(arguments: argparse.Namespace, out: Path) -> dict[str, Any]:
    """Run the steps, and write the demo's page after each."""
    began = time.monotonic()
    from recorder.demo.story import (
        EXTRAS,
        LOOK,
        STEPS,
        DemoConfig,
        cost_of,
        draw_story,
        first_look,
        replay_drive,
        run_systems,
        scores_of,
        write_index,
        write_scene,
    )

    config = DemoConfig(
        out=out,
        duration_s=arguments.duration,
        camera_start_s=arguments.camera_start,
        camera_duration_s=arguments.camera_duration,
    )
    ended = len(STEPS) + 1
    titles = [f"{number}/{len(STEPS)} {step}" for number, step in enumerate(STEPS, start=1)]
    if not arguments.look:
        announced(cost_of(config))
    if not (out / LOOK).exists():
        with Progress(titles[0], unit="parts") as progress:
            first_look(config, progress.pieces)
    page = write_index(config.out, [], {}, [], step=ended if arguments.look else 2)
    print(f"look at {page} after {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    if arguments.look:
        return {"out": str(config.out), "page": str(page)}
    with Progress(titles[1]) as progress:
        result = replay_drive(config, progress.update)
    films = [folder / "preview.mp4" for folder in result.sequences]
    write_index(config.out, films, {}, [], step=3)
    with Progress(titles[2], unit="runs") as progress:
        found = run_systems(config, progress.pieces)
    scores = scores_of(found)
    drawn = draw_story(config, found, result.ground_truth)
    scene = write_scene(config, result.sequences, scores)
    return {
        "out": str(config.out),
        "page": str(write_index(config.out, films, scores, drawn, step=ended, scene=scene)),
        "scene": str(scene),
        "sequences": [str(path) for path in result.sequences],
        "ground_truth": str(result.ground_truth),
        "ape_m": {
            system: {level: score.ape_m for level, (score, _) in by_level.items()}
            for system, by_level in scores.items()
        },
        "drawn": [str(path) for path in drawn],
        "missing": "" if drawn else EXTRAS,
        "took_s": round(time.monotonic() - began, 1),
    }


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
        print("Odometry against the true motion, position error after alignment (APE, RMSE):")
        for system, by_level in result["ape_m"].items():
            print(f"  {system:<24}" + "   ".join(f"{level} {ape:.3f} m" for level, ape in by_level.items()))
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
