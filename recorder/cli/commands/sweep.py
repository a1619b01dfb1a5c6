"""Sweep physical quantities over drives: errors and failures of SLAM systems as curves with bands.

Examples:
  carlaloc sweep drive.mcap --methods kiss_icp,rko_lio --rig lidar --over fault.lidar.time_offset_ms=0:100:6
  carlaloc sweep a.mcap b.mcap --rig lidar --over traffic=0:4:6 --over fog_visibility_m=20:500:log8 --seeds 5
  carlaloc sweep drive.mcap --rig lidar --over traffic=0,1 --over fault.lidar.drop_share=0:0.8:5 --product
"""

import argparse
import sys
from typing import Any

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
)
from recorder.cli.commands.benchmark import check_tools
from recorder.cli.progress import Progress

NOTE = """Each --over is swept by itself from the base condition (--weather, --traffic, --fault).
Results are kept, and the same command resumes the sweep."""
"""Text below the options of ``--help``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc sweep`."""
    parser.epilog = NOTE
    parser.add_argument("drives", type=input_path, nargs="+", help="drives (.mcap)")
    parser.add_argument("--out", type=OutputFolder(), help="results; else DRIVE-sweep beside the first")
    parser.add_argument(
        "--over",
        action="append",
        required=True,
        metavar="NAME=FROM:TO:N",
        help="traffic, a quantity of the weather or fault.SENSOR.NAME; logN spaces evenly in the logarithm",
    )
    option(parser, "--seeds", positive_int, "N", "seeds (default: 5)", 5)
    parser.add_argument("--product", action="store_true", help="run all combinations of the axes")
    option(parser, "--methods", names, "A,B", "systems; else all installed", ())
    option(parser, "--workers", positive_int, "N", "systems at a time", 1)
    parser.add_argument("--cluster", metavar="ADDRESS", help="Dask scheduler whose workers do the work")
    option(parser, "--clouds", names, "A,B", "raw, seg (default: raw)", ("raw",))
    parser.add_argument("--again", choices=("failed", "all"), help="run kept results again, too")
    parser.add_argument("--map", help="map of the drives, where the episodes name none that is known")
    add_condition_options(parser, weathers=("ClearNoon",), traffic=("dynamic",))
    add_stretch_options(parser)


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run the sweep."""
    check_tools()
    from recorder.benchmark.config import BenchmarkConfig
    from recorder.laboratory.sweep import Axis, SweepConfig
    from recorder.laboratory.sweep_report import write_sweep_report
    from recorder.laboratory.sweep_run import run_sweep

    axes = tuple(Axis.parse(word) for word in arguments.over)
    first = arguments.drives[0].resolve()
    out = arguments.out or first.with_name(f"{first.stem}-sweep")
    drives = drive_config(arguments, arguments.drives)
    config = SweepConfig(
        drives=drives, out=out, axes=axes, seeds=arguments.seeds, is_product=arguments.product
    )
    benchmark = config_of(BenchmarkConfig, arguments, data=drives, out=out)
    with Progress("runs", unit="runs") as progress:
        result = run_sweep(config, benchmark, progress.pieces, lambda line: print(line, file=sys.stderr))
    files = write_sweep_report(result)
    return {
        "out": str(out),
        "files": [str(path) for path in files],
        "points": len(result.runs),
        "runs": len(result.benchmark.jobs),
        "reused": result.benchmark.reused,
        "instants": result.instants,
        "frames": result.frames,
        "failures": result.benchmark.failures,
    }


def show(result: dict[str, Any]) -> None:
    """Print what was made, what was shared, and the files."""
    print(f"{result['points']} points by {result['runs']} runs, {result['reused']} of them done before")
    print(f"{result['frames']} sweeps or pairs made of {result['instants']} measured instants")
    for path in result["files"]:
        print(path)
    if result["failures"]:
        print(f"{len(result['failures'])} runs failed, the first: {result['failures'][0]}")
