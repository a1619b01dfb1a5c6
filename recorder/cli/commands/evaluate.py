"""Compare estimated trajectories with the truth: APE and RPE.

Examples:
  carlaloc evaluate --truth data/Town03/ground_truth/lidar.tum estimate.tum
  carlaloc evaluate --truth truth.tum orb.tum vins.tum --align posyaw --plot figures
  carlaloc evaluate --truth truth.tum odometry.bag --topic /odometry --time-offset search
  carlaloc evaluate --truth gnss.csv run.bag --topic /tf:map.base_link --interpolate
"""

from __future__ import annotations

import argparse
from typing import Any

from carlaloc_env.core.errors import ConfigError, unknown_name
from recorder.cli.arguments import OutputFolder, force_option, input_path, number_or_search, positive_seconds

PLOT = "trajectories.png"
"""Name of the picture."""
_SECONDS_MAX = 3.2e9
"""Longest time that an option may give: a century [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc evaluate`."""
    parser.add_argument("--truth", type=input_path, required=True, help="true trajectory")
    parser.add_argument(
        "estimates", type=input_path, nargs="+", metavar="EST", help="TUM, KITTI, EuRoC, tables or bags"
    )
    parser.add_argument("--align", default="se3", help="se3, sim3, posyaw or none (default: se3)")
    parser.add_argument("--times", type=input_path, metavar="TXT", help="times of KITTI poses")
    for what, prefix in (("estimates", ""), ("the truth", "truth-")):
        parser.add_argument(
            f"--{prefix}topic",
            help=f"topic of poses in bags of {what}, or /tf:PARENT.CHILD; else the only one",
        )
        parser.add_argument(
            f"--{prefix}quaternion",
            choices=("xyzw", "wxyz"),
            help=f"order in texts of {what} without a header; else by form and motion",
        )
        parser.add_argument(
            f"--{prefix}time-unit",
            choices=("s", "ms", "us", "ns"),
            help=f"unit of times in texts of {what}; else by name or size",
        )
    parser.add_argument(
        "--max-gap",
        type=positive_seconds,
        metavar="S",
        help="longest time between poses of a pair (default: 0.01)",
    )
    parser.add_argument(
        "--interpolate",
        action="store_true",
        help="interpolate the one of the higher rate, over 1.5 of its intervals or --max-gap",
    )
    parser.add_argument(
        "--time-offset",
        type=number_or_search,
        default=0.0,
        metavar="S",
        help="added to the stamps [s], or search",
    )
    parser.add_argument("--plot", type=OutputFolder(PLOT), metavar="DIR", help=f"draw {PLOT} there")
    force_option(parser, "an older picture")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Evaluate."""
    from recorder.dataset.trajectories import read_trajectory
    from recorder.evaluation.align import Alignment
    from recorder.evaluation.associate import MAX_GAP_NS, Association, interpolation
    from recorder.evaluation.evaluate import evaluate

    known = {alignment.name.lower(): alignment for alignment in Alignment}
    if arguments.align not in known:
        raise ConfigError(unknown_name("alignment", arguments.align, known))
    alignment = known[arguments.align]
    truth = read_trajectory(
        arguments.truth,
        times=arguments.times,
        topic=arguments.truth_topic or arguments.topic,
        quaternion=arguments.truth_quaternion,
        time_unit=arguments.truth_time_unit,
    )
    results, offsets_s = [], []
    for path in arguments.estimates:
        estimate = read_trajectory(
            path,
            times=arguments.times,
            topic=arguments.topic,
            quaternion=arguments.quaternion,
            time_unit=arguments.time_unit,
        )
        if arguments.time_offset == "search":
            # Here, since what it needs of SciPy takes half of a scoring's time to import.
            from recorder.evaluation.time_offset import find_time_offset

            offset_ns = find_time_offset(truth, estimate, alignment)
        else:
            offset_ns = _nanoseconds(arguments.time_offset)
        association, gap_ns = Association.NEAREST, MAX_GAP_NS
        if arguments.interpolate:
            association, gap_ns = interpolation(truth, estimate)
        if arguments.max_gap is not None:
            gap_ns = _nanoseconds(arguments.max_gap)
        results.append(
            evaluate(
                truth,
                estimate,
                alignment=alignment,
                association=association,
                max_gap_ns=gap_ns,
                time_offset_ns=offset_ns,
            )
        )
        offsets_s.append(offset_ns / 1e9)
    plots: list[str] = []
    if arguments.plot is not None:
        from recorder.report.trajectory_plot import plot_trajectories

        picture = plot_trajectories(results, arguments.plot / PLOT, overwrite=arguments.force)
        plots = [str(picture)]
    rows = zip(results, offsets_s, strict=True)
    return {
        "results": [{**result.to_mapping(), "time_offset_s": offset_s} for result, offset_s in rows],
        "plots": plots,
    }


def _nanoseconds(time_s: float) -> int:
    if abs(time_s) > _SECONDS_MAX:
        raise ConfigError(f"{time_s:g} s is more than a century; give less")
    return round(time_s * 1e9)


def show(result: dict[str, Any]) -> None:
    """Print a table."""
    for row in result["results"]:
        print(f"{row['estimate']}  against {row['truth']}")
        print(f"  {row['matched']} of {row['expected']} poses ({row['coverage']:.1%}); {row['alignment']}")
        if row["time_offset_s"]:
            print(f"  {row['time_offset_s']:+.6f} s added to the estimate's stamps")
        for metric in row["metrics"].values():
            print(
                f"  {metric['label']:<58} rmse {metric['rmse']:.4f}  mean {metric['mean']:.4f}  "
                f"max {metric['max']:.4f} {metric['unit']}"
            )
    for plot in result["plots"]:
        print(plot)
