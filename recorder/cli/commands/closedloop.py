"""Let the scripted driver drive by the pose of SLAM systems, and score lane keeping beside APE.

Examples:
  carlaloc closedloop Town06 --methods small_gicp,kiss_icp --offset 0.1,0.3,0.5 --out wheel
  carlaloc closedloop Town06 --methods my_system.py --traffic static,dynamic --seeds 2 --out wheel
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from recorder.cli.arguments import (
    OutputFolder,
    config_of,
    force_option,
    names,
    numbers,
    option,
    positive_int,
    positive_seconds,
)
from recorder.cli.output import write_rows
from recorder.cli.progress import Progress

if TYPE_CHECKING:
    from recorder.laboratory.closed_loop import DriveScore

TABLE = "closed_loop.csv"
"""Name of the table in the folder."""

NOTE = """The world moves by the truth; lanes, lights and route are found by the estimated pose.
A drive by the truth is always among them. A system that dies ends its drive, with the reason in the table."""
"""Text below the options of ``--help``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc closedloop`."""
    parser.epilog = NOTE
    parser.add_argument("town", help="town, or an OpenDRIVE file")
    parser.add_argument("--out", type=OutputFolder(TABLE), required=True, help="folder of the table")
    option(parser, "--methods", names, "A,B", "systems, or .py files", ())
    option(parser, "--offset", numbers, "M,M", "known errors to the left [m]", ())
    option(parser, "--traffic", names, "A,B", "levels (default: static)", ("static",))
    option(parser, "--seeds", positive_int, "N", "drives, with seeds from 0 on (default: 1)", 1)
    parser.add_argument("--rig", default="lidar", help="sensors of the systems (default: lidar)")
    parser.add_argument("--route", default="town", choices=("town", "random"), help="town or random")
    option(parser, "--limit", positive_seconds, "S", "end of a drive [s] (default: 120)", 120.0)
    option(parser, "--silence", positive_seconds, "S", "longest time without a pose [s]", 2.0)
    force_option(parser, "an older table")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Drive."""
    from recorder.laboratory.closed_loop import ClosedLoopConfig, run_closed_loop

    config = config_of(
        ClosedLoopConfig, arguments, offsets_m=arguments.offset, seeds=tuple(range(arguments.seeds)),
        time_limit_s=arguments.limit,
    )  # fmt: skip
    table = arguments.out / TABLE

    def keep(scores: Sequence[DriveScore]) -> None:
        write_rows(table, [asdict(score) for score in scores], digits=4)

    with Progress("drives", unit="drives") as progress:
        scores = run_closed_loop(config, progress.pieces, keep)
    return {"drives": [asdict(score) for score in scores], "table": str(table)}


def show(result: dict[str, Any]) -> None:
    """Print a line for each drive."""
    for row in result["drives"]:
        print(
            f"{row['source']:<12} {row['traffic']:<8} seed {row['seed']}: {row['route_completion']:.0%} of "
            f"the route, ended by {row['ended_by']}; in the lane {row['lateral_rms_m']:.2f} m RMS, "
            f"{row['lateral_max_m']:.2f} m at most, {row['lane_invasions']} times out of it; "
            f"pose {row['pose_error_rms_m']:.2f} m RMS, APE {row['ape_m']:.2f} m; "
            f"{row['real_time']:.1f} x real time"
        )
        if row["reason"]:
            print(f"  {row['reason']}")
    print(result["table"])
