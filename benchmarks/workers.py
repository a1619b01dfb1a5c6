"""Speed of one replay over 1, 2 and 4 workers: wall clock and CPU time, as a figure.

The same stretch of a drive is replayed anew for each number of workers, with cameras and LiDAR. The dotted
line is the speed of cores that share nothing.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from scenario import SEED

from carlaloc_env.core.cores import usable_cores
from recorder.drive.record import RecordConfig, record
from recorder.replaying.replay import ReplayConfig, replay

WORKERS = (1, 2, 4)
START_S = 2.0


def main(town: str, length_s: float, unit_s: float, out: Path) -> None:
    """Measure, print a table and draw the figure."""
    print(f"{'workers':>8}{'wall clock':>14}{'CPU time':>18}")
    times = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drive = folder / "drive.mcap"
        record(RecordConfig(map=town, out=drive, duration_s=START_S + length_s, seed=SEED, traffic="dynamic"))
        # Fills the caches.
        _timed(drive, folder / "first", 1, 0.1, 0.1)
        for workers in WORKERS:
            times[workers] = _timed(drive, folder / str(workers), workers, length_s, unit_s)
            print(f"{workers:>8}{times[workers][0]:>12.1f} s{times[workers][1]:>16.1f} s", flush=True)
    draw(times, f"{town}, {length_s:g} s in units of {unit_s:g} s, {len(usable_cores())} cores", out)


def _timed(drive: Path, out: Path, workers: int, length_s: float, unit_s: float) -> tuple[float, float]:
    """Wall clock and CPU time, workers' included, of a replay [s]."""
    config = ReplayConfig(
        episode=drive,
        out=out,
        formats=("rosbag1",),
        topics="slam",
        start_s=START_S,
        duration_s=length_s,
        unit_s=unit_s,
        workers=workers,
        preview=False,
    )
    began, cpu_began = time.perf_counter(), _cpu_s()
    replay(config)
    return time.perf_counter() - began, _cpu_s() - cpu_began


def _cpu_s() -> float:
    """CPU time of this process and of all its children that have ended [s]."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def draw(times: dict[int, tuple[float, float]], what: str, out: Path) -> None:
    """Speed over workers, relative to one."""
    mpl.use("Agg")
    figure, axes = plt.subplots(figsize=(5.2, 3.4), layout="constrained")
    counts = list(times)
    alone_s = times[counts[0]][0]
    axes.plot(counts, counts, ":", color="0.5", label="cores that share nothing")
    axes.plot(counts, [alone_s / times[n][0] for n in counts], "o-", label="measured")
    axes.axvline(len(usable_cores()), color="0.85", zorder=0)
    axes.set(xlabel="workers", ylabel="speed, 1 worker = 1", xticks=counts, ylim=(0, max(counts) + 0.2))
    axes.set_title(what, fontsize=10)
    axes.legend(frameon=False)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=130)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--town", default="Town10")
    parser.add_argument("--length", type=float, default=8.0, metavar="S", help="stretch that is replayed [s]")
    parser.add_argument("--unit", type=float, default=1.0, metavar="S", help="length of a unit of work [s]")
    parser.add_argument("--out", type=Path, required=True, metavar="PNG", help="the figure")
    options = parser.parse_args()
    main(options.town, options.length, options.unit, options.out)
