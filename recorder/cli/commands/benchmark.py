"""Run SLAM systems over the sequences of a folder, or over drives, and write tables and a report.

Examples:
  carlaloc benchmark data --out scores
  carlaloc benchmark drive.mcap --weather ClearNoon,FoggyNoon --traffic static,dynamic --noise-seeds 3
  carlaloc benchmark --standard --out scores --rig lidar --traffic static,dynamic
  carlaloc benchmark data --out scores --methods kiss_icp,small_gicp --runs 3
  carlaloc benchmark data --out scores --methods my_system.py --fail-above 0.5
  carlaloc benchmark data --out scores --again failed
  carlaloc benchmark data --out scores --windows 8
  carlaloc benchmark data --out scores --rerun
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from carlaloc_env.core.errors import EvaluationError, MissingDependencyError, UsageError
from recorder.cli.arguments import (
    OutputFolder,
    add_condition_options,
    add_stretch_options,
    config_of,
    drive_config,
    input_path,
    names,
    number,
    option,
    positive_int,
    positive_seconds,
)
from recorder.cli.output import announced
from recorder.cli.progress import Progress

if TYPE_CHECKING:
    from recorder.streaming.drive import DriveConfig

NOTE = """Sensor data of a drive are made while systems read them, and are not kept on the disk.
Results are kept: a second call does new runs only, and failed ones with --again failed.
The exit code is 1 when every run failed, or by --fail-above."""
"""Text below the options of ``--help``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc benchmark`."""
    parser.epilog = NOTE
    parser.add_argument(
        "data", type=input_path, nargs="*", help="folder with sequences, or drives (.mcap), one or more"
    )
    parser.add_argument("--out", type=OutputFolder(), help="results; else DATA-benchmark beside it")
    group = parser.add_argument_group("of drives")
    add_condition_options(group, weathers=("ClearNoon",), traffic=("dynamic",))
    add_stretch_options(group)
    option(group, "--noise-seeds", positive_int, "N", "seeds of noise (default: 1)", 1)
    group.add_argument(
        "--standard", action="store_true", help="the standard drives of seven towns, recorded in OUT/episodes"
    )
    group.add_argument("--map", help="map of the drives, where the episodes name none that is known")
    group.add_argument("--cluster", metavar="ADDRESS", help="Dask scheduler whose workers do the work")
    option(parser, "--methods", names, "A,B", "systems, or .py or .yaml files; else all installed", ())
    option(parser, "--runs", positive_int, "N", "repetitions (default: 1)", 1)
    option(parser, "--workers", positive_int, "N", "runs at a time, on cores of their own", 1)
    parser.add_argument("--lidar", metavar="NAME", help="LiDAR that systems read; else the rig's first")
    option(parser, "--clouds", names, "A,B", "raw, seg", ("raw", "seg"))
    option(parser, "--windows", positive_seconds, "S", "report where movers or weather hurt, in S seconds")
    parser.add_argument("--again", choices=("failed", "all"), help="run kept results again, too")
    parser.add_argument(
        "--rerun", action="store_true", help="a recording of each sequence with all estimates, too (rerun)"
    )
    option(parser, "--fail-above", number, "M", "exit 1 if a run fails or its APE is larger [m]")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run the systems."""
    check_tools()
    import pandas as pd

    from recorder.benchmark.cars import cars_tables, write_cars
    from recorder.benchmark.headline import headline
    from recorder.benchmark.page import write_benchmark_report
    from recorder.benchmark.run import BenchmarkConfig, run_benchmark
    from recorder.benchmark.windows import hurt_windows, window_tables

    out = _out(arguments)
    config = config_of(BenchmarkConfig, arguments, data=_data(arguments, out), out=out)
    if arguments.rerun:
        from recorder.view.recording import import_rerun

        import_rerun()  # reports now, not after hours, that it is missing
    with Progress("runs", unit="runs") as progress:
        result = run_benchmark(config, progress.pieces)
    windows = None if arguments.windows is None else hurt_windows(result, arguments.windows)
    files, cars = write_cars(result)
    more = [] if windows is None else window_tables(windows)
    files = [*write_benchmark_report(result, [*more, *cars_tables(pd.DataFrame(cars))]), *files]
    if arguments.rerun:
        from recorder.benchmark.recordings import write_recordings

        files += write_recordings(result)
    failures = result.failures
    if len(failures) == len(result.scores):
        raise EvaluationError(f"every run failed, {len(failures)} in all; {failures[0]}")
    limit_m = arguments.fail_above
    above = [s for s in result.scores if limit_m is not None and (s.failed is not None or s.ape_m > limit_m)]
    scores = [asdict(score) for score in result.scores]
    return {
        "out": str(out),
        "headline": headline(pd.DataFrame(scores))[0],
        "files": [str(path) for path in files],
        "runs": len(result.scores),
        "reused": result.reused,
        "windows": None if windows is None else windows.to_dict("records"),
        "scores": scores,
        "cars": cars,
        "failures": failures,
        "above": [
            f"{s.title} {s.town} {s.weather} {s.traffic}: {s.failed or f'APE {s.ape_m:.3f} m'}" for s in above
        ],
        "failed": bool(above),
    }


def _out(arguments: argparse.Namespace) -> Path:
    """Folder of the results.

    Raises:
        UsageError: there is nothing to run on, or no name to be had from it.
    """
    if arguments.standard == bool(arguments.data):
        raise UsageError("give a folder with sequences, drives (.mcap), or --standard")
    if arguments.out is None and arguments.standard:
        raise UsageError("--standard needs a folder for drives and results; give --out")
    first = arguments.data[0].resolve() if arguments.data else Path()
    out: Path = arguments.out or first.with_name(f"{first.stem}-benchmark")
    return out


def _data(arguments: argparse.Namespace, out: Path) -> Path | DriveConfig:
    """The folder, or the drives with their conditions.

    Raises:
        UsageError: folders and drives are mixed, or an option does not fit.
    """
    given: list[Path] = arguments.data
    drives = [path for path in given if path.suffix == ".mcap"]
    if not drives and len(given) == 1:
        return given[0]
    if arguments.standard:
        from recorder.drive.standard_drives import standard_drives

        with Progress("drives", unit="towns") as progress:
            given = drives = list(standard_drives(out / "episodes", progress.update))
    if len(drives) != len(given):
        raise UsageError("give one folder with sequences, or drives (.mcap) alone")
    _note_cars(drives)
    if arguments.rerun:
        raise UsageError("--rerun shows sensor data, which drives leave nowhere; replay them into a dataset")
    return drive_config(arguments, given)


def _note_cars(drives: list[Path]) -> None:
    """Report which car is scored where a drive has several."""
    from recorder.episode.episode import open_episode

    for path in drives:
        if (cars := len(open_episode(path).egos)) > 1:
            announced(f"note: {path} has {cars} cars, the first is scored; for all, replay it with --car all")


def check_tools() -> None:
    """Refuse to begin what could not be reported at the end.

    Raises:
        MissingDependencyError: a library of the report is not installed.
    """
    missing = [name for name in ("matplotlib", "pandas") if find_spec(name) is None]
    if missing:
        raise MissingDependencyError(
            f'the report needs {", ".join(missing)}; install it with: pip install "carlaloc[report]"'
        )


def show(result: dict[str, Any]) -> None:
    """Print the result in a sentence, the tables of errors and cost, and a line for each failed run."""
    import pandas as pd

    from recorder.benchmark.cars import cars_tables
    from recorder.benchmark.tables import all_tables
    from recorder.benchmark.windows import window_tables

    runs = pd.DataFrame(result["scores"])
    print(result["headline"] + "\n")
    if result["windows"] == []:
        print("no window in which an error clearly grows; it needs two conditions, and longer drives\n")
    windows, cars = (pd.DataFrame(result[name]) for name in ("windows", "cars"))
    for title, table in [*window_tables(windows), *cars_tables(cars), *all_tables(runs)]:
        print(title)
        rows = [list(table), *table.to_numpy().tolist()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            words = (word.ljust(width) for word, width in zip(row, widths, strict=True))
            print(("  " + "  ".join(words)).rstrip())
        print()
    print(f"{result['runs']} runs, {result['reused']} of them done before")
    if lidars := sorted({score["lidar"] for score in result["scores"]} - {""}):
        print(f"LiDAR that systems read: {', '.join(lidars)}")
    for path in result["files"]:
        print(path)
    for line in result["failures"]:
        print(line)
    for line in result["above"]:
        print(f"above the limit: {line}")
