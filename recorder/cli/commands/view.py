"""Look at an episode, a sequence or a town in rerun's viewer, or write a recording (.rrd) or a page of it.

Examples:
  carlaloc view drive.mcap
  carlaloc view data/Town03/ClearNoon_dynamic --estimate kiss.tum --out look.rrd
  carlaloc view --html data/Town03/ClearNoon_dynamic --out scene.html
  carlaloc view Town03
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import UsageError
from recorder.cli.arguments import OutputFile, force_option, input_path, option, positive_seconds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc view`."""
    parser.add_argument("what", type=input_path, help="episode (.mcap), folder of a sequence, or town")
    parser.add_argument("--map", type=input_path, help="map of an episode that was driven on a file")
    parser.add_argument(
        "--estimate", type=input_path, action="append", metavar="TUM", help="estimate of a sequence; repeat"
    )
    parser.add_argument(
        "--drive", type=input_path, metavar="E.mcap", help="drive of a sequence, whose movers its page shows"
    )
    parser.add_argument(
        "--frame",
        choices=("lidar", "imu", "camera", "base_link"),
        default="lidar",
        help="whose poses estimates are",
    )
    option(parser, "--period", positive_seconds, "S", "between clouds (default: 0.2)", 0.2)
    parser.add_argument(
        "--html", action="store_true", help="write one page that any browser opens, offline; needs --out"
    )
    parser.add_argument(
        "--out", type=OutputFile(".rrd", ".html"), help="write a recording or page and open no viewer"
    )
    force_option(parser, "an older file")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write a recording or page, and show the recording if it has no name."""
    if arguments.html != (arguments.out is not None and arguments.out.suffix.lower() == ".html"):
        raise UsageError("--html and a page after --out go together; give both: --html --out scene.html")
    if arguments.out is not None:
        kind = _record(arguments, arguments.out)
        written = {"kind": kind, "out": str(arguments.out), "bytes": arguments.out.stat().st_size}
        return written | ({"html": True} if arguments.html else {})
    from recorder.view.recording import check_display, open_viewer

    check_display()
    with tempfile.TemporaryDirectory(prefix="carlaloc-view-") as folder:
        path = Path(folder, "view.rrd")
        kind = _record(arguments, path)
        open_viewer(path)
    return {"kind": kind, "out": None}


def _record(arguments: argparse.Namespace, out: Path) -> str:
    """Write the recording or page and return its kind."""
    from recorder.view.write_view import write_view

    return write_view(
        arguments.what, out, map=arguments.map, estimates=arguments.estimate or (), frame=arguments.frame,
        period_s=arguments.period, drive=arguments.drive, overwrite=arguments.force,
    )  # fmt: skip


def show(result: dict[str, Any]) -> None:
    """Print what was written."""
    if result["out"] is not None:
        how = "open it in a browser" if result.get("html") else "rerun FILE shows it"
        print(f"{result['out']}  {result['kind']}, {result['bytes'] / 1e6:.1f} MB; {how}")
