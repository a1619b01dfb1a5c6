"""Drives of the scripted driver over towns' routes: stops, traffic near the ego, standard drives.

``python -m benchmarks.traffic_near_ego OUT Town03 Town05`` records the drives of ten seeds among the
paper's counts to `OUT`, or reads those that are there, and prints a row for each. Then follow their mean and
the seed of the town's standard drive (`recorder.factory.median_seed`).
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.episode.messages import actor_states
from recorder.episode.summary import EpisodeSummary, summarise
from recorder.factory import ROUTE_M, median_seed

SEEDS = range(10)
"""Seeds of the drives of each town."""
MOVES_MPS = 0.5
"""Slower actors wait [m/s]."""
_SAME_LEVEL_M = 8.0
"""Actors farther above or below are on another road [m]."""


class Drive(NamedTuple):
    """Figures of a drive."""

    summary: EpisodeSummary
    """Those that `carlaloc info` prints."""
    moving_50: float
    """Mean number of actors within 50 m that move."""
    moving_25: float
    """The same within 25 m."""

    @property
    def is_sound(self) -> bool:
        """Whether nothing was hit and no rule broken."""
        return self.summary.collisions == 0 and not self.summary.violations


def drive(folder: Path, town: str, seed: int = 0, duration_s: float | None = None) -> Drive:
    """The drive of a seed over a town's route, recorded to a folder if it is not there."""
    file = folder / f"{town}_{seed}.mcap"
    if not file.exists():
        record(RecordConfig(map=town, out=file, seed=seed, duration_s=duration_s))
    episode = Episode.load(file)
    others = actor_states(episode.steps)
    away = others.position_m - episode.ego_at_steps["position_m"][:, None]
    distance_m = np.hypot(away[..., 0], away[..., 1])
    moving = (np.abs(away[..., 2]) < _SAME_LEVEL_M) & (others.speed_mps > MOVES_MPS)
    near = [float((moving & (distance_m < reach_m)).sum(axis=1).mean()) for reach_m in (50.0, 25.0)]
    return Drive(summarise(episode), *near)


def _show(name: str, which: str, drives: list[Drive]) -> None:
    """Print the means of some drives in one line."""
    rows = [d.summary for d in drives]
    faults = sorted({kind for one in rows for kind in one.violations})
    print(
        f"{name:8} {which:>4} {np.mean([r.duration_s for r in rows]):5.0f} "
        f"{np.mean([r.driven_m / r.duration_s for r in rows]):5.1f} "
        f"{100 * np.mean([r.standing for r in rows]):6.0f} % {np.mean([r.stops for r in rows]):5.1f} "
        f"{np.mean([r.mover_close_s for r in rows]):7.0f} {np.mean([d.moving_50 for d in drives]):11.1f} "
        f"{np.mean([d.moving_25 for d in drives]):5.1f} {sum(r.collisions for r in rows):10}  "
        f"{', '.join(faults) or 'none'}",
        flush=True,
    )


if __name__ == "__main__":
    print(
        f"{'town':8} {'seed':>4} {'s':>5} {'m/s':>5} {'standing':>8} {'stops':>5} {'close s':>7} "
        f"{'moving 50 m':>11} {'25 m':>5} {'collisions':>10}  violations"
    )
    for name in sys.argv[2:] or ROUTE_M:
        drives = {}
        for number in SEEDS:
            drives[number] = drive(Path(sys.argv[1]), name, number)
            _show(name, str(number), [drives[number]])
        _show(name, "mean", list(drives.values()))
        sound = {number: one.summary.duration_s for number, one in drives.items() if one.is_sound}
        print(f"{name:8} standard drive: seed {median_seed(sound)}", flush=True)
