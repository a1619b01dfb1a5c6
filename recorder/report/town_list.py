"""Lists towns by name, with the length of their lanes and their routes."""

from dataclasses import dataclass

import numpy as np

from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.sources import known_towns


@dataclass(frozen=True, slots=True, kw_only=True)
class TownEntry:
    """One town of the list."""

    name: str
    """Name of its folder."""
    description: str
    """Its description in `town.toml`."""
    lane_km: float
    """Length of all driving lanes, those in junctions included [km]."""
    junctions: int
    """Junctions."""
    route_m: float
    """Length of the ego's route [m]; 0 where none is given."""
    path: str
    """OpenDRIVE file."""


def list_towns() -> tuple[TownEntry, ...]:
    """All towns in `$CARLALOC_MAPS` and among the installed maps; none is checked or built.

    Raises:
        MapError: a map cannot be read.
        ConfigError: a `town.toml` is not valid.
    """
    towns = []
    for name, path in known_towns().items():
        toml = path.with_name("town.toml")
        config = TownConfig.from_toml(toml) if toml.exists() else TownConfig(name=name)
        xodr = read_opendrive(path)
        network = build_network(xodr)
        driving = np.array([lane.type == "driving" for lane in network.lanes], dtype=bool)
        towns.append(
            TownEntry(
                name=name,
                description=config.description,
                lane_km=float(network.tables.length_m[driving].sum()) / 1e3,
                junctions=len(xodr.junctions),
                route_m=config.route.length_m or 0.0,
                path=str(path),
            )
        )
    return tuple(towns)
