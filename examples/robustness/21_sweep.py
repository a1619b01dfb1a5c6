"""Error of two LiDAR odometries against lost points: ``python examples/robustness/21_sweep.py drive.mcap``.

Ten seconds of a drive, four shares of lost points, three seeds; needs the extras `slam` and `report`.
"""

import argparse
from pathlib import Path

from recorder import (
    Axis,
    BenchmarkConfig,
    DriveConfig,
    ReplayOptions,
    SweepConfig,
    areas_of,
    curves_of,
    run_sweep,
    write_sweep_report,
)


def main() -> None:
    """Sweep, print the curve and the area under it, and write figures and a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drive", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/robustness"))
    arguments = parser.parse_args()
    drives = DriveConfig(
        episodes=(arguments.drive,), options=ReplayOptions(rig="lidar"), start_s=10.0, duration_s=10.0
    )
    axes = (Axis.parse("fault.lidar.point_drop_share=0,0.5,0.9,0.98"),)
    sweep = SweepConfig(drives=drives, out=arguments.out, axes=axes, seeds=3)
    systems = BenchmarkConfig(
        data=drives, out=arguments.out, methods=("kiss_icp", "small_gicp"), clouds=("raw",)
    )
    result = run_sweep(sweep, systems)
    curves = curves_of(result.runs, axes)
    print(curves[["series", "value", "ape_m", "ape_m_low", "ape_m_high", "fail_share"]].to_string())
    print(areas_of(curves, axes).to_string())
    print(*write_sweep_report(result), sep="\n")


if __name__ == "__main__":
    main()
