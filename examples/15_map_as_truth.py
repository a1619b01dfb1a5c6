"""Maps of a drive, built with movers, without, and without their points; the town itself counts the ghosts.

python examples/15_map_as_truth.py town06.mcap 10     10 s of it; writes out/ghosts/town06/
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np

from carlaloc_env.core.geometry import transforms
from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS
from recorder import ReplayConfig, Trajectory, evaluate, read_tum
from recorder.dataset.scans import Scan, ScanSource
from recorder.map_truth.evaluate_map import MapJudge, MapTruthConfig, build_map, transform_of_map
from recorder.report.map_plot import plot_map
from recorder.slam.runners import small_gicp
from recorder.slam.system import FrameClock
from recorder.streaming.drive import describe_drive
from recorder.streaming.frames import FrameMaker


def by_small_gicp(sweeps: list[Scan]) -> Trajectory:
    """Poses of the LiDAR by small_gicp, which are those of the middle of each sweep."""
    source = cast(ScanSource, SimpleNamespace(scans=lambda: iter(sweeps)))
    stamps, T = zip(*small_gicp.run(source, FrameClock()), strict=True)
    quat = np.array([transforms.matrix_to_quat(one[:3, :3]) for one in T])
    middle = np.array(stamps) + 25_000_000
    return Trajectory(stamp_ns=middle, position_m=np.array(T)[:, :3, 3], quat_xyzw=quat, name="small_gicp")


drive, seconds, out = Path(sys.argv[1]), float(sys.argv[2]), Path("out/ghosts") / Path(sys.argv[1]).stem
found: dict[str, list[Scan]] = {}
for level in ("static", "dynamic"):
    config = ReplayConfig(episode=drive, out=out / level, rig="lidar", traffic=(level,), duration_s=seconds)
    (stream,) = describe_drive(config)
    frames = FrameMaker(stream.frame_job("lidar", masks=False)).frames()
    found[level] = [scan for _, one in frames for scan in one.values() if isinstance(scan, Scan)]
found["seg(d)"] = [scan.take(~np.isin(np.asarray(scan.tag), [*DYNAMIC_TAGS])) for scan in found["dynamic"]]
truth = replace(read_tum(stream.plan.drive.truth("lidar")), name="truth")
span_ns = found["static"][0].stamp_ns, found["static"][-1].stamp_ns
judge = MapJudge(MapTruthConfig(drive=drive, rig="lidar", distances_m=(0.2,)), span_ns)
rows = ["town,seconds,cloud,poses,points,ghosts,ghost_rate,accuracy_m,precision_20cm,recall_20cm"]
for cloud, sweeps in found.items():
    estimate = by_small_gicp(sweeps)
    for poses, fit in ((truth, None), (estimate, transform_of_map(evaluate(truth, estimate)))):
        one = judge.judge(build_map(sweeps[1:-1], poses), fit)
        title = f"{drive.stem}, {cloud}, poses of {poses.name}: {one.ghost_rate:.2%} of the points are ghosts"
        file = out / f"{cloud}_{poses.name}.png"
        plot_map(one.points_m, one.distance_m, one.ghost, file, title=title, overwrite=True)
        points = f"{len(one.points_m)},{one.ghost.sum()},{one.ghost_rate:.5f}"
        scores = "{0.accuracy_m:.4f},{0.precision:.4f},{0.recall:.4f}".format(one.scores[0])
        rows.append(f"{drive.stem},{seconds:g},{cloud},{poses.name},{points},{scores}")
        print(rows[-1], flush=True)
(out / "ghosts.csv").write_text("\n".join(rows) + "\n")
