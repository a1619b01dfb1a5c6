"""A lane network as named arrays, for files of the cache."""

from collections.abc import Callable
from dataclasses import fields

from carlaloc_env.core.files import record_bytes
from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.map.lanes.build_lanes import LaneRecords, RoadMap
from carlaloc_env.map.lanes.centre_lines import LaneTables
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Crosswalk, Lane, SignalHead, StaticSign

_TABLES = tuple(field.name for field in fields(LaneTables))


def to_arrays(network: LaneNetwork) -> Arrays:
    """Arrays of a network, without its map."""
    return {
        "forward": network.forward,
        "start_s_m": network.start_s_m,
        "bank": network.bank,
        "lanes": record_bytes.to_bytes(network.lanes),
        "signals": record_bytes.to_bytes(network.signals),
        "static_signs": record_bytes.to_bytes(network.static_signs),
        "crosswalks": record_bytes.to_bytes(network.crosswalks),
        **{f"tables/{name}": getattr(network.tables, name) for name in _TABLES},
    }


def from_arrays(arrays: Arrays, read: Callable[[], RoadMap]) -> LaneNetwork:
    """Restores a network from its arrays.

    Args:
        arrays: Those of `to_arrays`.
        read: Reads its map when it is asked for.
    """
    # Copies: compiled functions take arrays of a file, which are read-only, for another type.
    copied = {name: value.copy() for name, value in arrays.items()}
    lanes = LaneRecords(
        forward=copied["forward"],
        start_s_m=copied["start_s_m"],
        tables=LaneTables(**{name: copied[f"tables/{name}"] for name in _TABLES}),
        lanes=record_bytes.from_bytes(Lane, copied["lanes"]),
    )
    network = LaneNetwork(read, lanes)
    network.bank = copied["bank"]
    network.signals = record_bytes.from_bytes(SignalHead, copied["signals"])
    network.static_signs = record_bytes.from_bytes(StaticSign, copied["static_signs"])
    network.crosswalks = record_bytes.from_bytes(Crosswalk, copied["crosswalks"])
    return network
