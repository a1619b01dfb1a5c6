"""Lights, signs and paint of junctions: by the nodes of the streets, else by their classes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from carlaloc_env.authoring.elements.junction_furniture import (
    STOP,
    YIELD,
    light_junction,
    mark_leg,
    paint_arrows,
    paint_crosswalk,
    sign_leg,
    speed_signs,
)
from carlaloc_env.authoring.elements.map_parts import leg_of
from carlaloc_env.openstreetmap.clusters import End
from carlaloc_env.openstreetmap.elements import Tags
from carlaloc_env.openstreetmap.road_graph import Chain
from carlaloc_env.openstreetmap.road_network import Junction, RoadNetwork
from carlaloc_env.openstreetmap.tags import signed_nodes

LIGHTS_M, SIGN_M, CROSSING_M = 30.0, 25.0, 9.0
"""Lights, signs and crossings so far before the end of a leg belong to the junction [m]."""
SHORTEST_M = 9.0
"""Legs that are shorter carry no crosswalk [m]."""
SPEED_SIGN_M = 70.0
"""Shorter streets carry no speed sign [m]."""


def furnish(
    network: RoadNetwork, chains: Sequence[Chain], node_tags: Mapping[int, Tags], town_kmh: float
) -> None:
    """Add lights, signs, crosswalks, stop lines and arrows to a network.

    Args:
        network: Roads and junctions.
        chains: Its streets.
        node_tags: Tags of their nodes.
        town_kmh: Limit that no sign says.
    """
    signs = {node: sign for node, tags in node_tags.items() if (sign := signed_nodes(tags))}
    painted: set[int] = set()
    for junction in network.junctions:
        if len(junction.legs) > 1:
            _furnish(junction, network, chains, signs, painted)
    for k, part in network.of_chain.items():
        for s, node in zip(chains[k].stations_m.tolist(), chains[k].nodes, strict=True):
            at = (s - chains[k].length_m / 2) * 0.96 + part.length / 2
            if "crossing" in signs.get(node, "") and node not in painted and 6.0 < at < part.length - 6.0:
                paint_crosswalk(leg_of(part, "start"), network.numbers, at)
        if part.length > SPEED_SIGN_M and abs(part.speed_kmh - town_kmh) > 1.0:
            speed_signs(part, network.numbers, 12.0)


def _near(end: End, chains: Sequence[Chain], reach_m: float) -> list[int]:
    """Nodes of a leg up to a distance beyond its end, at most up to its middle."""
    chain = chains[end.chain]
    limit = min(end.setback_m + reach_m, max(0.5 * chain.length_m, end.setback_m))
    s = chain.stations_m
    far = s if end.side == 0 else chain.length_m - s
    return [node for node, near in zip(chain.nodes, far <= limit, strict=True) if near]


def _furnish(
    junction: Junction,
    network: RoadNetwork,
    chains: Sequence[Chain],
    signs: Mapping[int, str],
    painted: set[int],
) -> None:
    ends, legs = junction.cluster.ends, junction.legs
    inside = {*junction.cluster.nodes, *(n for k in junction.cluster.inner for n in chains[k].nodes)}
    around = [_near(end, chains, LIGHTS_M) for end in ends]
    lit = any(signs.get(node) == "signals" for node in inside.union(*around))
    crossed = len(legs) > 2 and sum(leg.incoming != [] for leg in legs) > 1
    # A lit crossing between junctions lies on the first leg from which traffic comes.
    alone = next((i for i, e in enumerate(ends) if e.enters and e.node in chains[e.chain].lit), None)
    lights = (lit and crossed) or alone is not None
    minor = {} if lights or not crossed else _minor(junction, chains, signs)
    backs = []
    for i, (end, leg) in enumerate(zip(ends, legs, strict=True)):
        nodes = [n for n in _near(end, chains, CROSSING_M) if "crossing" in signs.get(n, "")]
        room = leg.road.length > SHORTEST_M
        walked = crossed and bool(nodes or (lights and max(end.street.walks) > 0))
        crosswalk = room and (walked or i == alone)
        if crosswalk:
            painted |= {*nodes, *junction.cluster.nodes}
        stops = (lights or i in minor) and leg.road.length > 3.0
        backs.append(mark_leg(leg, network.numbers, crosswalk=crosswalk, stop_line=stops))
    if lights:
        network.controllers += light_junction(junction.part, legs, backs, network.numbers, split=False)
    for i, code in minor.items():
        if legs[i].incoming:
            sign_leg(legs[i], network.numbers, backs[i], code)
    long = [leg for leg in legs if leg.road.length > 20.0]
    if len(long) == len(legs):
        paint_arrows(legs, junction.movements, network.numbers, 8.0)


def _minor(junction: Junction, chains: Sequence[Chain], signs: Mapping[int, str]) -> dict[int, str]:
    """Legs that give way, with the code of their sign: as tagged, else into rings and larger streets."""
    ends = junction.cluster.ends
    sign_of = {}
    for i, end in enumerate(ends):
        own = {signs.get(node) for node in _near(end, chains, SIGN_M)}
        if end.enters and own & {"stop", "give_way"}:
            sign_of[i] = STOP if "stop" in own else YIELD
    if sign_of and len(sign_of) < len(ends):
        return sign_of
    ring = [end.street.ring for end in ends]
    if any(ring) or any(chains[k].street.ring for k in junction.cluster.inner):
        return {i: YIELD for i, end in enumerate(ends) if end.enters and not ring[i]}
    top = max(end.street.rank for end in ends)
    if sum(end.street.rank == top for end in ends) < 2:
        return {}
    return {i: YIELD for i, end in enumerate(ends) if end.enters and end.street.rank < top}
