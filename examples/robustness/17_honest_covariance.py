"""Test whether a system's covariance is consistent, by many seeds of noise on one drive.

python examples/robustness/17_honest_covariance.py drive.mcap scatter small_gicp 20
"""

import sys
from pathlib import Path

from recorder import ConsistencyConfig, ConsistencyResult, DriveConfig, ReplayOptions, run_consistency


def main(
    drive: Path, out: Path, method: str, seeds: int, *, duration_s: float = 20.0, map: Path | None = None
) -> ConsistencyResult:
    """Run a system with every seed, and print the factor by which its variances are too small."""
    options = ReplayOptions(rig="lidar", weathers=("ClearNoon",), traffic=("static",))
    config = ConsistencyConfig(
        drive=DriveConfig(
            episodes=(drive,), options=options, noise_seeds=seeds, duration_s=duration_s, map=map
        ),
        out=out,
        methods=(method,),
    )
    result = run_consistency(config)
    for row in result.rows():
        print(f"{row['method']}, error {row['error']}: {row['runs']} runs")
        for part in ("position", "rotation"):
            if f"{part}_factor" in row:
                total, noise = row[f"{part}_factor"], row[f"{part}_noise_factor"]
                print(f"  variance of the {part} too small by {total:.3g}, of noise alone by {noise:.3g}")
    return result


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
