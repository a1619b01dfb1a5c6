"""Traffic tables kept on disk: working them out takes an eighth of the time of making an environment."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from carlaloc_env.core.files.array_cache import arrays_hash, cached
from carlaloc_env.town.build import KEPT_FILES
from carlaloc_env.town.lanes import network_arrays
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.tables import record_arrays
from carlaloc_env.traffic.traffic_tables import TownTables, TrafficTables


def kept_tables(town: Town, *, folder: Path | None = None) -> TrafficTables:
    """Tables of a town, from the cache when the same code made them of the same lanes and route before.

    Args:
        town: The town.
        folder: Where files lie; the default cache when left out.
    """
    made_of = network_arrays.to_arrays(town.network)
    if town.route is not None:
        made_of["route_m"] = town.route.position_m
    return TrafficTables(
        town.network,
        town.route,
        keep=lambda make: cached(
            town.name,
            "traffic",
            module=TrafficTables.__module__,
            make=make,
            to_arrays=record_arrays.to_arrays,
            from_arrays=partial(record_arrays.from_arrays, TownTables),
            content=arrays_hash(made_of),
            kept_files=KEPT_FILES,
            folder=folder,
        ),
    )
