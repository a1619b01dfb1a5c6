"""Compare the covariances that SLAM systems state with their true scatter over many seeds of noise.

Examples:
  carlaloc consistency drive.mcap --methods small_gicp,rko_lio --seeds 20 --rig lidar --out scatter
  carlaloc consistency drive.mcap --methods my_system.py --start 5 --duration 20 --out scatter --plot
  carlaloc consistency seed0.tum seed1.tum seed2.tum --truth truth.tum --out scatter
  carlaloc consistency filter.tum --truth truth.tum --align none --out scatter
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from carlaloc_env.core.errors import UsageError
from recorder.cli.arguments import (
    OutputFolder,
    add_condition_options,
    add_stretch_options,
    config_of,
    drive_config,
    input_path,
    names,
    option,
    positive_int,
    positive_seconds,
)
from recorder.cli.output import write_rows
from recorder.cli.progress import Progress

if TYPE_CHECKING:
    from recorder.laboratory.consistency import ConsistencyResult

TABLE, PICTURE = "consistency.csv", "consistency.png"
"""Names of the files in the folder."""

NOTE = """The drive and its truth are the same in all runs: only the noise of the sensors differs.
Covariances of an estimate stand beside it (estimate.cov beside estimate.tum).
Runs are kept: a second call does new ones."""
"""Text below the options of ``--help``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc consistency`."""
    parser.epilog = NOTE
    parser.add_argument(
        "data", type=input_path, nargs="+", help="a drive (.mcap), or TUM files of one drive with --truth"
    )
    parser.add_argument("--out", type=OutputFolder(), required=True, help="folder of runs, table and figure")
    parser.add_argument("--truth", type=input_path, help="true trajectory of the files' frame")
    parser.add_argument(
        "--align", choices=("first", "none"), default="first", help="of files: lay the first pose on the true"
    )
    option(parser, "--over", positive_seconds, "M", "distance of relative errors [m]", 10.0)
    parser.add_argument("--plot", action="store_true", help=f"draw {PICTURE}, too")
    group = parser.add_argument_group("of a drive")
    option(group, "--methods", names, "A,B", "systems, or .py or .yaml files; else all", ())
    option(group, "--seeds", positive_int, "N", "seeds of noise (default: 20)", 20)
    add_condition_options(group, weathers=("ClearNoon",), traffic=("static",))
    add_stretch_options(group)
    group.add_argument("--map", help="map of the drive, where the episode names none that is known")
    option(group, "--workers", positive_int, "N", "runs at a time", 1)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run the systems, or read the files, and compare."""
    result = _of_files(arguments) if arguments.truth is not None else _of_drive(arguments)
    rows = result.rows()
    write_rows(arguments.out / TABLE, rows, digits=6)
    files = [arguments.out / TABLE]
    if arguments.plot:
        from recorder.laboratory.consistency import plot_consistency

        files.append(plot_consistency(result, arguments.out / PICTURE, overwrite=True))
    return {"rows": rows, "failures": list(result.failures), "files": [str(path) for path in files]}


def _of_files(arguments: argparse.Namespace) -> ConsistencyResult:
    from recorder.dataset.trajectories import read_trajectory
    from recorder.laboratory.consistency import compare_files

    tied = arguments.align == "first"
    truth = read_trajectory(arguments.truth)
    return compare_files(truth, arguments.data, over_m=arguments.over, tied=tied)


def _of_drive(arguments: argparse.Namespace) -> ConsistencyResult:
    from recorder.laboratory.consistency import ConsistencyConfig, run_consistency

    given: list[Path] = arguments.data
    if len(given) != 1 or given[0].suffix != ".mcap":
        raise UsageError("give one drive (.mcap), or TUM files with --truth")
    drive = drive_config(arguments, given, noise_seeds=arguments.seeds)
    config = config_of(ConsistencyConfig, arguments, drive=drive)
    with Progress("runs", unit="runs") as progress:
        return run_consistency(config, progress.pieces)


def show(result: dict[str, Any]) -> None:
    """Print what is wrong with each covariance."""
    for row in result["rows"]:
        print(f"{row['method']}, error {row['error']}: {row['runs']} runs, {row['poses']} poses")
        print("  scatter   " + _axes(row, "scatter"))
        print("  shared    " + _axes(row, "shared"))
        for part in ("pose", "position", "rotation"):
            if f"{part}_anees" not in row:
                continue
            covered = ", ".join(f"{row[f'{part}_coverage_{n}']:.0%} of {n} %" for n in (50, 90, 95))
            print(
                f"  {part:<9} variance too small by {_interval(row, f'{part}_factor')}, "
                f"of noise alone by {_interval(row, f'{part}_noise_factor')}; covered {covered}"
            )
        if "pose_anees" not in row:
            print("  no covariance that could be compared")
    for line in [*result["files"], *result["failures"]]:
        print(line)


def _axes(row: dict[str, Any], prefix: str) -> str:
    along, across, up, *turns = (row[f"{prefix}_{axis}"]
                                 for axis in ("along", "across", "up", "roll", "pitch", "yaw"))  # fmt: skip
    lengths = f"along {1000 * along:.2f} mm, across {1000 * across:.2f} mm, up {1000 * up:.2f} mm"
    return lengths + ", roll, pitch, yaw " + ", ".join(f"{1000 * turn:.3f}" for turn in turns) + " mrad"


def _interval(row: dict[str, Any], name: str) -> str:
    return f"{row[name]:.3g} ({row[f'{name}_low']:.3g} to {row[f'{name}_high']:.3g})"
