"""Drives by the scripted driver: the standard drive of each town, or another of its length and seed."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from recorder.factory.plan import ROUTE_M, STANDARD_SEEDS

_log = logging.getLogger(__name__)

Progress = Callable[[float, float, str], None]
"""Called with the number of towns done (fractions included), the number of towns, and the present step."""


def standard_drives(
    out: Path, progress: Progress, *, towns: Sequence[str] = tuple(ROUTE_M)
) -> tuple[Path, ...]:
    """The standard drives of some towns, whole routes, as ``OUT/TOWN.mcap``; existing files are kept.

    Args:
        out: Folder of the drives.
        progress: Called with their progress.
        towns: Names of towns; else the paper's seven.

    Raises:
        EpisodeError: a drive cannot be written.
    """
    found = []
    for number, town in enumerate(towns):
        target = out / f"{town}.mcap"

        def driving(_: float, route_m: float, number: int = number, town: str = town) -> None:
            share = min(route_m / ROUTE_M.get(town, max(route_m, 1.0)), 1.0)
            progress(number + share, len(towns), f"driving through {town}, {route_m:.0f} m")

        if not target.exists():
            record_drive(town, target, seed=STANDARD_SEEDS.get(town, 0), progress=driving)
        found.append(target)
    return tuple(found)


def record_drive(
    town: str,
    target: Path,
    *,
    seed: int,
    duration_s: float | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> None:
    """Record a drive by the scripted driver; remains of an interrupted recording are deleted.

    Args:
        town: Name of the town.
        target: New episode.
        seed: Seed of traffic and driver.
        duration_s: Length [s]; None: to the end of the route.
        progress: Called with seconds and metres driven.

    Raises:
        EpisodeError: it cannot be written.
    """
    # Imported here: it imports physics and traffic.
    from recorder.drive.record import RecordConfig, record

    _log.info("driving through %s", town)
    target.parent.mkdir(parents=True, exist_ok=True)
    for rest in target.parent.glob(f"{target.name}.*"):
        rest.unlink()
    record(RecordConfig(map=town, out=target, duration_s=duration_s, seed=seed), progress=progress)
