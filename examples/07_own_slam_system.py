"""Your own SLAM system in `carlaloc benchmark`: here one that matches all sweeps with the first one.

carlaloc benchmark data --out scores --methods examples/07_own_slam_system.py,kiss_icp
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorder import MIDDLE, BenchmarkConfig, FrameClock, Score, SlamSequence, System, run_benchmark

SYSTEM = System(
    name="first_sweep",
    title="First sweep",
    what="each sweep against the first one, by small_gicp",
    needs=("lidar",),
    runner="07_own_slam_system:run",
    frame="lidar",
    instant=MIDDLE,
    instant_source="sweeps are not compensated",
)


def run(sequence: SlamSequence, clock: FrameClock) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Stamps [ns] and poses of the LiDAR; good as long as the surfaces of the first sweep are in view."""
    import small_gicp

    first = None
    T = np.eye(4)
    for scan in sequence.scans():
        with clock.frame():
            cloud, tree = small_gicp.preprocess_points(scan.points_xyz_m, downsampling_resolution=0.25)
            if first is None:
                first = cloud, tree
            else:
                found = small_gicp.align(first[0], cloud, first[1], init_T_target_source=T)
                T = np.array(found.T_target_source)
        yield scan.stamp_ns, T.copy()


def main(data: Path, out: Path) -> list[Score]:
    """Score this system over all sequences of a folder, as the command does."""
    config = BenchmarkConfig(data=data, out=out, methods=(__file__,), clouds=("raw",))
    return run_benchmark(config).scores


if __name__ == "__main__":
    for score in main(Path(sys.argv[1]), Path(sys.argv[2])):
        print(score.title, score.town, score.traffic, score.failed or f"{score.ape_m:.3f} m")
