"""Maps of 10 s of a drive, and ghosts: `python examples/robustness/15_map_as_truth.py town06.mcap 10`."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import recorder
from carlaloc_env import DYNAMIC_TAGS, matrix_to_quat
from recorder import MapTruthConfig, ReplayConfig, Scan, Trajectory, evaluate, read_tum


def by_small_gicp(sweeps: list[Scan]) -> Trajectory:
    """Poses of the LiDAR by small_gicp, which are those of the middle of each sweep."""
    source: Any = SimpleNamespace(scans=lambda: iter(sweeps))
    stamps, T = zip(*recorder.run_small_gicp(source, recorder.FrameClock()), strict=True)
    quat = np.array([matrix_to_quat(one[:3, :3]) for one in T])
    middle, xyz_m = np.array(stamps) + 25_000_000, np.array(T)[:, :3, 3]
    return Trajectory(stamp_ns=middle, position_m=xyz_m, quat_xyzw=quat, name="small_gicp")


def main(drive: Path, seconds: float, out: Path) -> None:
    """Build maps of the static and the dynamic twin, draw them, and print a table (CSV)."""
    sweeps_of: dict[str, list[Scan]] = {}
    for level in ("static", "dynamic"):
        twin = ReplayConfig(episode=drive, out=out / level, rig="lidar", traffic=(level,), duration_s=seconds)
        (stream,) = recorder.describe_drive(twin)
        frames = recorder.FrameMaker(stream.frame_job("lidar", masks=False)).frames()
        sweeps_of[level] = [scan for _, one in frames for scan in one.values() if isinstance(scan, Scan)]
    sweeps_of["seg(d)"] = [s.take(~np.isin(np.asarray(s.tag), [*DYNAMIC_TAGS])) for s in sweeps_of["dynamic"]]
    truth = replace(read_tum(stream.plan.drive.truth("lidar")), name="truth")
    first, last = (sweeps_of["static"][k].stamp_ns for k in (0, -1))
    judge = recorder.MapJudge(MapTruthConfig(drive=drive, rig="lidar", distances_m=(0.2,)), (first, last))
    print("town,seconds,cloud,poses,points,ghosts,ghost_rate,accuracy_m,precision_20cm,recall_20cm")
    for cloud, sweeps in sweeps_of.items():
        for poses in (truth, by_small_gicp(sweeps)):
            fit = None if poses is truth else recorder.transform_of_map(evaluate(truth, poses))
            m = judge.judge(recorder.build_map(sweeps[1:-1], poses), fit)
            file = out / f"{cloud}_{poses.name}.png"
            title = f"{drive.stem}, {cloud}, poses of {poses.name}: ghosts {m.ghost_rate:.2%}"
            recorder.plot_map(m.points_m, m.distance_m, m.ghost, file, title=title, overwrite=True)
            s = m.scores[0]
            row = (len(m.points_m), m.ghost.sum(), m.ghost_rate, s.accuracy_m, s.precision, s.recall)
            print(drive.stem, seconds, cloud, poses.name, *row, sep=",")


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]), Path("out/ghosts") / Path(sys.argv[1]).stem)
