"""Do moving objects and weather hurt here what they hurt in the CARLA-Loc paper? Writes docs/findings.md.

python benchmarks/findings.py --work DIR         drives, replays, runs what is not done yet, then writes
python benchmarks/findings.py SCORES [SCORES …]  only writes, from folders that `carlaloc benchmark` wrote

Every step that is done is left alone by the next start, so that it may be ended at any time.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from carlaloc_env import TOWNS
from carlaloc_env.core.errors import CarlaLocError
from recorder.benchmark.findings import read_results, write_findings

PAGE = Path(__file__).resolve().parents[1] / "docs" / "findings.md"
LIDAR_METHODS = "kiss_icp,small_gicp,genz_icp,rko_lio"
CAMERA_METHODS = "stereo_vo"
"""ORB-SLAM3 wants a Python and a vocabulary of its own: name them with --camera-methods."""


def main() -> None:
    """Make what is missing and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scores", type=Path, nargs="*", help="folders of results")
    parser.add_argument("--work", type=Path, help="folder for drives, data and results")
    parser.add_argument("--lidar-s", type=float, default=60.0, help="length of a drive [s]")
    parser.add_argument("--camera-s", type=float, default=30.0, help="length of its pictures [s]; 0: none")
    parser.add_argument("--runs", type=int, default=1, help="repetitions of each run")
    parser.add_argument("--noise-seeds", type=int, default=3, help="seeds of sensor noise")
    parser.add_argument("--workers", type=int, default=1, help="runs at a time, on cores of their own")
    parser.add_argument("--lidar-methods", default=LIDAR_METHODS)
    parser.add_argument("--camera-methods", default=CAMERA_METHODS)
    parser.add_argument("--keep-data", action="store_true", help="keep sequences once they are scored")
    parser.add_argument("--page", type=Path, default=PAGE)
    arguments = parser.parse_args()
    folders = list(arguments.scores)
    if arguments.work is not None:
        for town in TOWNS:
            folders += _scored(town, arguments)
    if not folders:
        parser.error("give folders of results, or --work")
    try:
        write_findings(read_results([folder / "results.csv" for folder in folders]), arguments.page)
    except CarlaLocError as error:
        sys.exit(f"findings: {error}")
    print(arguments.page)


def _scored(town: str, arguments: argparse.Namespace) -> list[Path]:
    """Folders of results of one town, made where they are missing."""
    work: Path = arguments.work
    drive = work / f"{town}.mcap"
    if not drive.exists():
        _carlaloc("record", "--map", town, "--duration", f"{arguments.lidar_s}", "--out", str(drive))
    lidar = ["--rig", "lidar", "--weather", "ClearNoon", "--format", "rosbag1", "--topics", "standard"]
    found = [_benchmark(work, town, "lidar", lidar, arguments.lidar_methods, arguments)]
    if arguments.camera_s > 0:
        # Standing at the start would tell nothing; an IMU that starts later than the pictures neither.
        window = ["--start", "5", "--duration", f"{arguments.camera_s}"]
        camera = [
            "--rig",
            "flu",
            "--weather",
            "ClearNoon,FoggyNoon,RainyNight",
            "--format",
            "rosbag1,euroc",
            "--topics",
            "slam",
        ]
        found.append(_benchmark(work, town, "camera", camera + window, arguments.camera_methods, arguments))
    return found


def _benchmark(
    work: Path, town: str, kind: str, options: list[str], methods: str, arguments: argparse.Namespace
) -> Path:
    """Replay and score; a folder that is there is whole, since it gets its name at the end."""
    out, data, part = (work / f"{prefix}.{kind}.{town}" for prefix in ("scores", "data", "part"))
    if out.exists():
        return out
    if not (data / "whole").exists():
        drive = str(work / f"{town}.mcap")
        common = ["--traffic", "static,dynamic", "--no-preview", "--noise-seeds", f"{arguments.noise_seeds}"]
        _carlaloc("replay", drive, "--out", str(data), *options, *common)
        (data / "whole").touch()
    often = ["--runs", f"{arguments.runs}", "--workers", f"{arguments.workers}"]
    _carlaloc("benchmark", str(data), "--out", str(part), "--methods", methods, *often)
    part.rename(out)
    if not arguments.keep_data:
        shutil.rmtree(data)
    return out


def _carlaloc(*words: str) -> None:
    print("carlaloc", *words, flush=True)
    status = subprocess.run([sys.executable, "-m", "recorder.cli.main", *words], check=False).returncode
    if status:
        sys.exit(status)


if __name__ == "__main__":
    main()
