"""The main job from end to end: drive, replay, write datasets, run SLAM systems, score them.

Records a drive through Town03 among all of its traffic, replays it as ClearNoon and FoggyNoon, static and
dynamic, runs KISS-ICP and GICP over the LiDAR and stereo-vo over the cameras of both traffic levels, and
draws what the traffic does to them: story.png.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from carlaloc_env import CarlaLocError
from carlaloc_env.scene.semantic_tags import Tag
from recorder import (
    EvaluationResult,
    Metric,
    RecordConfig,
    ReplayConfig,
    ReplayResult,
    evaluate,
    gicp_odometry,
    kiss_icp_odometry,
    read_tum,
    record,
    replay,
    write_tum,
)
from recorder.benchmark.page import lanes_of
from recorder.cli.progress import Progress
from recorder.episode.episode import open_episode
from recorder.evaluation.associate import Association
from recorder.report.condition_plot import plot_conditions
from recorder.slam.isolated_run import run_isolated

WEATHERS = ("ClearNoon", "FoggyNoon")
TRAFFIC = ("static", "dynamic")
SWEEP_S = 0.05
SYSTEMS = {"KISS-ICP": kiss_icp_odometry, "GICP": gicp_odometry}
if find_spec("kiss_icp") is None and sys.version_info >= (3, 14):
    del SYSTEMS["KISS-ICP"]  # no wheels for this Python yet


def main(out: Path, duration_s: float = 40.0, camera_start_s: float = 12.0, camera_s: float = 6.0) -> Path:
    """Run the demo and return the folder that holds its results."""
    began = time.monotonic()
    out = _free(out)
    drive = _record(out / "drive.mcap", duration_s)
    result = _replay(drive, out / "data", camera_start_s, camera_s)
    scores = {name: {level: _score(result, name, level, out) for level in TRAFFIC} for name in SYSTEMS}
    scores["stereo-vo"] = {level: _score_stereo(result, level, out) for level in TRAFFIC}
    plot = plot_conditions(scores, out / "story.png", lanes_m=lanes_of("Town03"), title=_title(drive, result))
    mosaic = _mosaic(result, out / "mosaic.png")
    _report(out, drive, result, scores, [plot, mosaic], time.monotonic() - began)
    return out


def _free(out: Path) -> Path:
    """The folder itself, or the first of its name with a number that does not exist yet."""
    candidate, number = out, 2
    while candidate.exists():
        candidate, number = out.with_name(f"{out.name}-{number}"), number + 1
    candidate.mkdir(parents=True)
    return candidate


def _record(path: Path, duration_s: float) -> Path:
    with Progress("1/3 driving through Town03") as progress:

        def tell(driven_s: float, route_m: float) -> None:
            progress.update(driven_s, duration_s, f"{route_m:.0f} m")

        config = RecordConfig(map="Town03", out=path, device="scripted", duration_s=duration_s, seed=9)
        return record(config, progress=tell).path


def _replay(drive: Path, out: Path, camera_start_s: float, camera_s: float) -> ReplayResult:
    with Progress("2/3 replaying 2 weathers × 2 traffic levels") as progress:
        config = ReplayConfig(
            episode=drive,
            out=out,
            weathers=WEATHERS,
            traffic=TRAFFIC,
            rig="flu",
            formats=("rosbag1", "euroc"),
            topics="slam",
            camera_start_s=camera_start_s,
            camera_duration_s=camera_s,
        )
        return replay(config, progress.update)


def _score(result: ReplayResult, system: str, level: str, out: Path) -> EvaluationResult:
    folder = next(path for path in result.sequences if path.name == f"{WEATHERS[0]}_{level}")
    name = f"{system} {level}"
    with Progress(f"3/3 {name}") as progress:

        def tell(done: int, total: int) -> None:
            progress.update(done * SWEEP_S, total * SWEEP_S)

        bag = folder / f"{folder.name}.bag"
        estimate = SYSTEMS[system](bag, "/lidar/points", SWEEP_S, name=name, progress=tell)
    write_tum(out / f"{name.lower().replace(' ', '_').replace('-', '_')}.tum", estimate)
    return evaluate(read_tum(result.ground_truth / "lidar.tum"), estimate)


def _score_stereo(result: ReplayResult, level: str, out: Path) -> EvaluationResult:
    folder = next(path for path in result.sequences if path.name == f"{WEATHERS[0]}_{level}")
    work = out / f"stereo_vo_{level}"
    print(f"3/3 stereo-vo {level}", flush=True)
    ended = run_isolated("stereo_vo", folder, work, cloud="raw", limit_s=600.0)
    if ended.error is not None:
        raise CarlaLocError(f"stereo-vo: {ended.error}")
    truth, estimate = read_tum(result.ground_truth / "camera_left.tum"), read_tum(work / "estimate.tum")
    named = replace(estimate, name=f"stereo-vo {level}")
    return evaluate(truth, named, association=Association.INTERPOLATED)


def _title(drive: Path, result: ReplayResult) -> str:
    """What is compared: the same drive, and among how many it was driven."""
    tag = open_episode(drive).header.catalog.tag
    walkers = int((tag == Tag.PEDESTRIAN).sum())
    length_m = read_tum(result.ground_truth / "base_link.tum").length_m
    return (
        f"The same {length_m:.0f} m through Town03: empty of movers (static), and among "
        f"{len(tag) - walkers} vehicles and {walkers} walkers (dynamic)"
    )


def _mosaic(result: ReplayResult, path: Path) -> Path:
    stills = [np.asarray(cv2.imread(str(folder / "preview.png"))) for folder in result.sequences]
    rows = [np.hstack(stills[k : k + 2]) for k in range(0, len(stills), 2)]
    picture = np.vstack(rows)
    cv2.imwrite(str(path), cv2.resize(picture, None, fx=0.75, fy=0.75, interpolation=cv2.INTER_AREA))
    return path


def _report(
    out: Path,
    drive: Path,
    result: ReplayResult,
    scores: dict[str, dict[str, EvaluationResult]],
    pictures: list[Path],
    took_s: float,
) -> None:
    print("\nOdometry against the true motion of its own sensor:")
    for score in (score for levels in scores.values() for score in levels.values()):
        print(f"  {score.estimate.name}: {score.matched} of {score.expected} poses")
        for metric in (Metric.APE_TRANSLATION, Metric.RPE_PAPER, Metric.RPE_TRANSLATION):
            statistics = score.statistics[metric]
            print(f"    {metric.value:<60} rmse {statistics.rmse:.3f} {metric.unit}")
    print(f"\nThe drive      {drive}")
    for folder in result.sequences:
        print(f"A sequence     {folder}   (bag, EuRoC mav0/, preview.mp4)")
    print(f"Calibration    {result.ground_truth.parent / 'calibration'}")
    print(f"Ground truth   {result.ground_truth}")
    for picture in pictures:
        print(f"A picture      {picture}")
    print(f"Everything     {out}   in {took_s / 60:.1f} min")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/demo"), help="folder for the results")
    parser.add_argument("--duration", type=float, default=40.0, help="length of the drive [s]")
    parser.add_argument("--camera-start", type=float, default=12.0, help="pictures begin here [s]")
    parser.add_argument("--camera-duration", type=float, default=6.0, help="length of the pictures [s]")
    arguments = parser.parse_args()
    try:
        main(arguments.out, arguments.duration, arguments.camera_start, arguments.camera_duration)
    except CarlaLocError as error:
        sys.exit(f"demo: {error}")
