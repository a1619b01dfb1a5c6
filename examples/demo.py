"""The main job from end to end: drive, replay, write datasets, run SLAM systems, score them.

Records a drive through Town03 among all of its traffic, replays it as ClearNoon and FoggyNoon, static and
dynamic, runs GICP and RKO-LIO over the LiDAR and stereo-vo over the cameras, two of them at a time, and
draws what the traffic does to them: story.png.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np
from condition_plot import plot_conditions

from carlaloc_env import CarlaLocError
from carlaloc_env.scene.semantic_tags import Tag
from recorder import (
    Metric,
    RecordConfig,
    ReplayConfig,
    ReplayResult,
    read_tum,
    record,
    replay,
)
from recorder.benchmark.page import write_page
from recorder.benchmark.run import BenchmarkConfig, run_benchmark
from recorder.benchmark.score import Score
from recorder.cli.progress import Progress
from recorder.dataset.sequence import RAW
from recorder.episode.episode import open_episode
from recorder.evaluation.path_errors import PathErrors
from recorder.report.lane_lines import lane_lines_of
from recorder.slam.systems import SYSTEMS

WEATHERS = ("ClearNoon", "FoggyNoon")
TRAFFIC = ("static", "dynamic")
METHODS = ("small_gicp", "rko_lio", "stereo_vo")
"""Of these, what is installed: RKO-LIO has no wheels for Python 3.14 yet."""
Scores = dict[str, dict[str, tuple[Score, PathErrors]]]
"""Score and errors by title of a system and level of traffic."""


def main(out: Path, duration_s: float = 40.0, camera_start_s: float = 12.0, camera_s: float = 6.0) -> Path:
    """Run the demo and return the folder that holds its results."""
    began = time.monotonic()
    out = _free(out)
    drive = _record(out / "drive.mcap", duration_s)
    result = _replay(drive, out / "data", camera_start_s, camera_s)
    scores, page = _scores(out / "data", out / "benchmark")
    errors = {title: {level: of[level][1] for level in TRAFFIC} for title, of in scores.items()}
    plot = plot_conditions(errors, out / "story.png", lane_lines_of("Town03"), _title(drive, result))
    mosaic = _mosaic(result, out / "mosaic.png")
    _report(out, drive, result, scores, [plot, mosaic], page, time.monotonic() - began)
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


def _scores(data: Path, out: Path) -> tuple[Scores, Path]:
    """Scores in ClearNoon, and the page that shows all runs."""
    methods = tuple(name for name in METHODS if SYSTEMS[name].is_installed)
    workers = min(2, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1)
    config = BenchmarkConfig(data=data, out=out, methods=methods, workers=workers, clouds=(RAW,))
    with Progress("3/3 SLAM systems", unit="runs") as progress:
        found = run_benchmark(config, progress.pieces)
    if any(score.coverage == 0.0 for score in found.scores):
        raise CarlaLocError(found.failures[0])
    scores: Scores = {SYSTEMS[name].title: {} for name in methods}
    for score, (job, errors) in zip(found.scores, found.errors(), strict=True):
        if job.sequence.weather == WEATHERS[0]:
            scores[score.title][score.traffic] = score, errors
    return scores, write_page(found)


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
    scores: Scores,
    pictures: list[Path],
    page: Path,
    took_s: float,
) -> None:
    print("\nOdometry against the true motion of its own sensor:")
    for system, by_level in scores.items():
        for level, (score, errors) in by_level.items():
            print(f"  {system}, {level}: {len(errors.error_m)} poses")
            for metric, rmse_m in (
                (Metric.APE_TRANSLATION, score.ape_m),
                (Metric.RPE_PAPER, score.rpe_paper_m),
                (Metric.RPE_TRANSLATION, score.rpe_m),
            ):
                print(f"    {metric.value:<60} rmse {rmse_m:.3f} m")
    print(f"\nThe drive      {drive}")
    for folder in result.sequences:
        print(f"A sequence     {folder}   (bag, EuRoC mav0/, preview.mp4)")
    print(f"Calibration    {result.ground_truth.parent / 'calibration'}")
    print(f"Ground truth   {result.ground_truth}")
    for picture in pictures:
        print(f"A picture      {picture}")
    print(f"All runs       {page}")
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
