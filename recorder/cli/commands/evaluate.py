"""Compare estimated trajectories, and maps, with the truth: APE, RPE, accuracy, completeness, ghosts.

Examples:
  carlaloc evaluate --truth data/Town03/ground_truth/lidar.tum estimate.tum
  carlaloc evaluate --truth car1/lidar.tum --truth car2/lidar.tum first.tum second.tum
  carlaloc evaluate --truth truth.tum orb.tum vins.tum --align posyaw --plot figures
  carlaloc evaluate --truth truth.tum odometry.bag --topic /odometry --time-offset search
  carlaloc evaluate --truth lidar.tum orb.tum --estimate-to-truth=-90,0,-90
  carlaloc evaluate --truth gnss.csv run.bag --topic /tf:map.base_link --interpolate
  carlaloc evaluate --truth gnss_truth.pos out.pos --align none
  carlaloc evaluate --truth truth.tum est.tum --map est.ply --drive town03.mcap --plot figures
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING, Any

from carlaloc_env.core.errors import ConfigError, UsageError, unknown_name
from recorder.cli.arguments import (
    OutputFolder,
    config_of,
    force_option,
    input_path,
    number,
    number_or_search,
    numbers,
    option,
    positive_seconds,
)

if TYPE_CHECKING:
    from recorder.evaluation.align import Alignment
    from recorder.evaluation.evaluation_result import EvaluationResult
    from recorder.evaluation.trajectory import Trajectory

PLOT = "trajectories.png"
"""Name of the picture."""
_SECONDS_MAX = 3.2e9
"""Longest time that an option may give: a century [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `carlaloc evaluate`."""
    parser.add_argument(
        "--truth", type=input_path, required=True, action="append",
        help="true trajectory; again for each further estimate, of robots that are scored together",
    )  # fmt: skip
    parser.add_argument(
        "estimates",
        type=input_path,
        nargs="+",
        metavar="EST",
        help="TUM, KITTI, EuRoC, RTKLIB's .pos, tables or bags",
    )
    parser.add_argument("--align", default="se3", help="se3, sim3, posyaw or none (default: se3)")
    option(parser, "--times", input_path, "TXT", "times of KITTI poses, or of numbers of frames")
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
    option(parser, "--max-gap", positive_seconds, "S", "longest time between poses of a pair (default: 0.01)")
    parser.add_argument(
        "--interpolate",
        action="store_true",
        help="interpolate the one of the higher rate, over 1.5 of its intervals or --max-gap",
    )
    option(parser, "--time-offset", number_or_search, "S", "added to the stamps [s], or search", 0.0)
    parser.add_argument(
        "--estimate-to-truth",
        type=body_transform,
        metavar="R,P,Y",
        help="turn of the estimate's body frame in the truth's [deg], or its extrinsic X,Y,Z,QX,QY,QZ,QW "
        "[m], or auto (default: none); --estimate-to-truth=-90,0,-90",
    )
    option(parser, "--plot", OutputFolder(PLOT), "DIR", f"draw {PLOT} there")
    force_option(parser, "an older picture")
    maps = parser.add_argument_group("maps", "built by the system of the one estimate, in its frame")
    maps.add_argument(
        "--map", type=input_path, action="append", metavar="CLOUD", help="PLY, PCD or XYZ; again for more"
    )
    option(maps, "--drive", input_path, "E.mcap", "drive of which the truth is")
    maps.add_argument("--town", metavar="FILE", help="its town, if the drive does not name it")
    maps.add_argument("--traffic", default="dynamic", help="traffic level that the system saw")
    maps.add_argument("--rig", default="paper", help="rig whose LiDAR decides about visibility")
    option(maps, "--reach", number, "M", "reach about the path within which maps count (default: 50)", 50.0)
    text = "d of precision and recall [m] (default: 0.1,0.2,0.5)"
    option(maps, "--distances", numbers, "A,B", text, (0.1, 0.2, 0.5))


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Evaluate."""
    from carlaloc_env.core.transforms import from_rotation
    from recorder.dataset.trajectories import named_apart, read_trajectory
    from recorder.evaluation.align import Alignment, body_rotation
    from recorder.evaluation.associate import MAX_GAP_NS, Association, interpolation
    from recorder.evaluation.evaluate import evaluate
    from recorder.evaluation.rtklib_pos import SUFFIX, origin_of

    if bool(arguments.map) != (arguments.drive is not None) or (
        arguments.map and len(arguments.estimates) > 1
    ):
        raise UsageError("--map CLOUD and --drive E.mcap go together, with the estimate of one system")
    alignments = {alignment.name.lower(): alignment for alignment in Alignment}
    if arguments.align not in alignments:
        raise ConfigError(unknown_name("alignment", arguments.align, alignments))
    alignment = alignments[arguments.align]
    truths = [
        read_trajectory(
            path, times=arguments.times, topic=arguments.truth_topic or arguments.topic,
            quaternion=arguments.truth_quaternion, time_unit=arguments.truth_time_unit,
        )
        for path in arguments.truth
    ]  # fmt: skip
    # Solutions of RTKLIB stand in the axes of the truth where that is one, too.
    origin = origin_of(arguments.truth[0]) if arguments.truth[0].suffix == SUFFIX else None
    estimates = [
        read_trajectory(
            path, times=arguments.times, topic=arguments.topic, quaternion=arguments.quaternion,
            time_unit=arguments.time_unit, origin=origin,
        )
        for path in arguments.estimates
    ]  # fmt: skip
    named = named_apart([*arguments.truth, *arguments.estimates], [*truths, *estimates])
    truths, estimates = named[: len(truths)], named[len(truths) :]
    if len(truths) > 1:
        return _of_robots(truths, estimates, alignment)
    truth = truths[0]
    results, offsets_s = [], []
    for estimate in estimates:
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
        score = partial(
            evaluate, truth, estimate, alignment=alignment, association=association, max_gap_ns=gap_ns,
            time_offset_ns=offset_ns,
        )  # fmt: skip
        T = arguments.estimate_to_truth
        if T == "auto":
            first_result = score()
            T = from_rotation(body_rotation(first_result.truth, first_result.estimate))
        results.append(score(T_body_sensor=T))
        offsets_s.append(offset_ns / 1e9)
    plots: list[str] = []
    if arguments.plot is not None:
        from recorder.report.trajectory_plot import plot_trajectories

        picture = plot_trajectories(results, arguments.plot / PLOT, overwrite=arguments.force)
        plots = [str(picture)]
    maps, pictures = _judge_maps(arguments, results[0]) if arguments.map else ([], [])
    rows = zip(results, offsets_s, strict=True)
    return {
        "results": [{**result.to_mapping(), "time_offset_s": offset_s} for result, offset_s in rows],
        "maps": maps,
        "plots": plots + pictures,
    }


def _of_robots(truths: list[Trajectory], estimates: list[Trajectory], alignment: Alignment) -> dict[str, Any]:
    from recorder.evaluation.together import evaluate_together

    together = evaluate_together(truths, estimates, alignment=alignment).to_mapping()
    return {"results": [], "together": together, "maps": [], "plots": []}


def _judge_maps(
    arguments: argparse.Namespace, result: EvaluationResult
) -> tuple[list[dict[str, Any]], list[str]]:
    """Scores of maps as JSON values, and their pictures."""
    from recorder.cli.progress import Progress
    from recorder.laboratory.map_truth import MapJudge, MapTruthConfig, transform_of_map
    from recorder.laboratory.surface_cloud import read_map

    config = config_of(MapTruthConfig, arguments, map=arguments.town)
    clouds = [(path, read_map(path)) for path in arguments.map]
    stamps = result.truth.stamp_ns
    with Progress("visibility", unit="looks") as progress:
        judge = MapJudge(config, (int(stamps[0]), int(stamps[-1])), progress.update)
    judgements = [judge.judge(points, transform_of_map(result), name=str(path)) for path, points in clouds]
    pictures: list[str] = []
    if arguments.plot is not None:
        from recorder.report.map_plot import plot_map

        for judged, (path, _) in zip(judgements, clouds, strict=True):
            picture = arguments.plot / f"map_{path.stem}.png"
            title = f"{path.stem}: {judged.ghost_rate:.2%} of {len(judged.points_m):,} points are ghosts"
            points = (judged.points_m, judged.distance_m, judged.ghost)
            plot_map(*points, picture, title=title, overwrite=arguments.force)
            pictures.append(str(picture))
    return [judged.to_mapping() for judged in judgements], pictures


def body_transform(text: str) -> list[list[float]] | str:
    """Rows of the matrix that maps the estimate's body frame to the truth's, or the word `auto`."""
    if text == "auto":
        return text
    import numpy as np

    from carlaloc_env.core.transforms import from_rotation, quat_to_matrix, rpy_to_quat

    values = numbers(text)
    quat = rpy_to_quat(*np.radians(values)) if len(values) == 3 else np.array(values[3:])
    if len(values) not in (3, 7) or not 0.99 < np.linalg.norm(quat) < 1.01:
        raise argparse.ArgumentTypeError(f"{text} is not R,P,Y [deg], X,Y,Z,QX,QY,QZ,QW or auto")
    lever_m = values[:3] if len(values) == 7 else (0.0, 0.0, 0.0)
    rows: list[list[float]] = from_rotation(quat_to_matrix(quat / np.linalg.norm(quat)), lever_m).tolist()
    return rows


def _nanoseconds(time_s: float) -> int:
    if abs(time_s) > _SECONDS_MAX:
        raise ConfigError(f"{time_s:g} s is more than a century; give less")
    return round(time_s * 1e9)


def show(result: dict[str, Any]) -> None:
    """Print a table."""
    if "together" in result:
        _show_robots(result["together"])
    for row in result["results"]:
        print(f"{row['estimate']}  against {row['truth']}")
        rows = f"{row['matched']} of {row['expected']} poses ({row['coverage']:.1%})"
        scale = f", scale {row['transform']['scale']:.4g}" if row["alignment"].startswith("Sim") else ""
        print(f"  {rows}, {row['covered_time']['share']:.1%} of the time; {row['alignment']}{scale}")
        if row["time_offset_s"]:
            print(f"  {row['time_offset_s']:+.6f} s added to the estimate's stamps")
        for metric in row["metrics"].values():
            print(
                f"  {metric['label']:<58} rmse {metric['rmse']:.4f}  mean {metric['mean']:.4f}  "
                f"max {metric['max']:.4f} {metric['unit']}"
            )
        for finding in row["findings"]:
            print(f"  note: {finding}")
    if any(row["roll_from_attitudes"] for row in result["results"]):
        print("  APE, rotation: on this nearly straight path, after the roll that fits the attitudes best")
    for judged in result["maps"]:
        ghosts = f"{judged['ghosts']:,} ghosts ({judged['ghost_rate']:.2%})"
        print(f"{judged['map']}  {judged['points']:,} points, {ghosts}")
        heads = "accuracy [m]  completeness [m]  precision  recall  F-score"
        print(f"  {'part':<14} {'class':<14} {'d [m]':<6} {heads}")
        for row in judged["scores"]:
            print(
                f"  {row['part']:<14} {row['tag']:<14} {row['distance_m']:<6g} {row['accuracy_m']:>12.3f}  "
                f"{row['completeness_m']:>16.3f}  {row['precision']:>9.3f}  {row['recall']:>6.3f}  "
                f"{row['f_score']:>7.3f}"
            )
    for plot in result["plots"]:
        print(plot)


def _show_robots(together: dict[str, Any]) -> None:
    print(f"{len(together['robots'])} robots, one fit for all: {together['alignment']}")
    print(f"  all: APE, position rmse {together['joint_m']['rmse']:.4f} m")
    for robot in together["robots"]:
        joint, alone = robot["joint_m"]["rmse"], robot["alone_m"]["rmse"]
        print(f"  {robot['estimate']}: {joint:.4f} m; after a fit of its own {alone:.4f} m")
    for pair in together["between"]:
        a, b = (together["robots"][k]["estimate"] for k in pair["robots"])
        print(f"  {b} seen from {a}: {pair['m']['rmse']:.4f} m, {pair['deg']['rmse']:.4f} deg")
