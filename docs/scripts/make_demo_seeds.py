"""Make recorder/demo/seeds.csv, errors over ten seeds: `python docs/scripts/make_demo_seeds.py SCORES`."""

import csv
import sys
from pathlib import Path

from carlaloc_env.core.files.atomic_files import atomic_write
from recorder.benchmark.run import BenchmarkConfig, run_benchmark
from recorder.cli.progress import Progress
from recorder.demo.answers import SEEDS
from recorder.demo.story import METHODS, DemoConfig, drive_of

COUNT = 10


def main(scores: Path) -> Path:
    """Run the demo's systems over ten seeds; runs in the folder are kept."""
    with Progress("runs", unit="runs") as progress:
        drive = drive_of(DemoConfig(out=scores), noise_seeds=COUNT)
        config = BenchmarkConfig(data=drive, out=scores, methods=METHODS, workers=2)
        result = run_benchmark(config, progress.pieces)
    with atomic_write(SEEDS) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("title", "weather", "traffic", "cloud", "seed", "ape_m"))
        for job, score in zip(result.jobs, result.scores, strict=True):
            seed = score.dataset.rpartition("seed")[2]
            row = (job.system.title, score.weather, score.traffic, score.cloud, seed, f"{score.ape_m:.4f}")
            writer.writerow(row)
    return SEEDS


if __name__ == "__main__":
    main(Path(sys.argv[1]))
