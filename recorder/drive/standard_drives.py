"""The standard drives of the paper's seven towns, recorded by the scripted driver."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from carlaloc_env.core.ego import DEFAULT_RIDE
from carlaloc_env.map.sources import ALIASES

ROUTE_M = {
    "Town01": 678, "Town03": 970, "Town04": 2108, "Town05": 473, "Town06": 266, "Town07": 747, "Town10": 1115,
}  # fmt: skip
"""Lengths of the paper's seven routes [m] (Table III), by town."""
STANDARD_SEEDS = {
    "Town01": 2, "Town03": 6, "Town04": 7, "Town05": 3, "Town06": 3, "Town07": 7, "Town10": 1,
}  # fmt: skip
"""Seeds of the standard drives: those of median length among seeds 0 to 9 in the paper's traffic."""
HAND_DRIVEN = ("Town05", "Town07")
"""Towns whose drives go through wheel, window and recorder, as a person's do; the window is not seen."""
PACE_MPS = 5.0
"""Pace of a drive, waiting included, by which its length is guessed before it is driven [m/s]."""
TownProgress = Callable[[float, float, str], None]
"""Called with the number of towns done (fractions included), of towns, and the present step."""
_LOG = logging.getLogger(__name__)


def expected_drive_s(town: str) -> float:
    """Length of a drive over a town's whole route [s], by the pace of the scripted driver."""
    return ROUTE_M.get(ALIASES.get(town, town), 800) / PACE_MPS


def standard_drives(
    out: Path, progress: TownProgress, *, towns: Sequence[str] = tuple(ROUTE_M)
) -> tuple[Path, ...]:
    """The standard drives of some towns, whole routes, as ``OUT/TOWN.mcap``; existing files are kept.

    Args:
        out: Folder of the drives.
        progress: Called with the progress.
        towns: Names of towns; else the paper's seven.

    Raises:
        EpisodeError: a drive cannot be written.
    """
    drives = []
    for number, town in enumerate(towns):
        target = out / f"{town}.mcap"

        def driving(_: float, route_m: float, number: int = number, town: str = town) -> None:
            share = min(route_m / ROUTE_M.get(town, max(route_m, 1.0)), 1.0)
            progress(number + share, len(towns), f"driving through {town}, {route_m:.0f} m")

        if not target.exists():
            record_drive(town, target, seed=STANDARD_SEEDS.get(town, 0), progress=driving)
        drives.append(target)
    return tuple(drives)


def record_drive(
    town: str,
    target: Path,
    *,
    seed: int,
    duration_s: float | None = None,
    ride: str = DEFAULT_RIDE,
    progress: Callable[[float, float], None] | None = None,
) -> None:
    """Record a drive by the scripted driver; remains of an interrupted recording are deleted.

    Args:
        town: Name of the town.
        target: New episode.
        seed: Seed of traffic and driver.
        duration_s: Length [s]; None: to the end of the route.
        ride: How the body answers to the road.
        progress: Called with seconds and metres driven.

    Raises:
        EpisodeError: it cannot be written.
    """
    # Imported here: it imports physics and traffic.
    from recorder.drive.record import RecordConfig, record

    _LOG.info("driving through %s", town)
    target.parent.mkdir(parents=True, exist_ok=True)
    for rest in target.parent.glob(f"{target.name}.*"):
        rest.unlink()
    if by_hand := town in HAND_DRIVEN:
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    config = RecordConfig(
        map=town, out=target, device="hand" if by_hand else "scripted", window=by_hand, seed=seed,
        duration_s=duration_s, ride=ride,
    )  # fmt: skip
    record(config, progress=progress)
