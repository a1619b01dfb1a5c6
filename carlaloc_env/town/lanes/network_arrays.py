"""A lane network as named arrays, for files of the cache."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

from carlaloc_env.core.files import config_files
from carlaloc_env.core.files.array_cache import Arrays
from carlaloc_env.town.lanes.build_lanes import LaneRecords, RoadMap
from carlaloc_env.town.lanes.centre_lines import LaneTables
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.lanes.records import Crosswalk, Lane, SignalHead, StaticSign

_TABLES = tuple(field.name for field in fields(LaneTables))


def to_arrays(network: LaneNetwork) -> Arrays:
    """Everything that a network holds besides its map."""
    return {
        "forward": network.forward,
        "start_s_m": network.start_s_m,
        "bank": network.bank,
        "lanes": config_files.to_bytes(network.lanes),
        "signals": config_files.to_bytes(network.signals),
        "static_signs": config_files.to_bytes(network.static_signs),
        "crosswalks": config_files.to_bytes(network.crosswalks),
        **{f"tables/{name}": getattr(network.tables, name) for name in _TABLES},
    }


def from_arrays(arrays: Arrays, read: Callable[[], RoadMap]) -> LaneNetwork:
    """The network again.

    Args:
        arrays: What `to_arrays` made of it.
        read: Reads its map when it is asked for.
    """
    # Copies: compiled functions take arrays of a file, which are read-only, for another type.
    copied = {name: value.copy() for name, value in arrays.items()}
    lanes = LaneRecords(
        forward=copied["forward"],
        start_s_m=copied["start_s_m"],
        tables=LaneTables(**{name: copied[f"tables/{name}"] for name in _TABLES}),
        lanes=config_files.from_bytes(Lane, copied["lanes"]),
    )
    network = LaneNetwork(read, lanes)
    network.bank = copied["bank"]
    network.signals = config_files.from_bytes(SignalHead, copied["signals"])
    network.static_signs = config_files.from_bytes(StaticSign, copied["static_signs"])
    network.crosswalks = config_files.from_bytes(Crosswalk, copied["crosswalks"])
    return network
