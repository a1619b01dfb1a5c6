"""Streets as a network that drives: turns are made wide, and roads that cannot be reached are left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import shapely

from carlaloc_env.core.errors import MapError
from carlaloc_env.openstreetmap.clusters import Cluster, find_clusters
from carlaloc_env.openstreetmap.road_graph import Chain
from carlaloc_env.openstreetmap.road_network import Heights, Memo, RoadNetwork, Turn, build_network
from carlaloc_env.openstreetmap.turning_places import parts

ROUNDS = 8
"""How often legs are moved away from junctions at most."""


def settle(
    chains: Sequence[Chain],
    heights_of: Callable[[Sequence[Chain], Sequence[Cluster]], Heights],
    banned: Mapping[tuple[int, int], frozenset[int]],
    solid: shapely.STRtree,
    *,
    yellow: bool,
) -> tuple[RoadNetwork, list[Chain], list[Chain]]:
    """The network whose turns are all wide enough and whose roads can all be reached from each other.

    Legs of turns that are too tight move away from their junction; roads that stay unreachable are left out.

    Args:
        chains: Streets.
        heights_of: Makes heights of streets and junctions.
        banned: As `build_network` has it.
        solid: The same.
        yellow: The same.

    Returns:
        The network, the chains that it holds, and those that were left out.

    Raises:
        MapError: Nothing is left.
    """
    kept = list(chains)
    dropped: list[Chain] = []
    memo: Memo = ({}, {})
    needed: set[Turn] = set()
    while kept:
        more: Counter[tuple[int, int]] = Counter()
        for _ in range(ROUNDS):
            clusters = find_clusters(kept, more)
            network = build_network(kept, clusters, Heights(), banned, solid, memo, needed, yellow=yellow)
            narrow = [t for t in network.tight if not (t.sharp and t.spare) or t.turn in needed]
            if not narrow:
                break
            for end in {(e.chain, e.side) for t in narrow for e in (t.source, t.target)}:
                more[end] = min(more[end] + 3, 30)
        lost = unreachable(network)
        if not lost:
            heights = heights_of(kept, clusters)
            network = build_network(kept, clusters, heights, banned, solid, memo, needed, yellow=yellow)
            return network, kept, dropped
        # Turns that were left out may be those that lead on.
        ways_on = {t.turn for t in network.tight if not t.built and {t.source.chain, t.target.chain} & lost}
        if not ways_on <= needed:
            needed |= ways_on
            continue
        dropped += [kept[k] for k in sorted(lost)]
        kept = [chain for k, chain in enumerate(kept) if k not in lost]
        memo = ({}, {})
        needed.clear()
    raise MapError("no street is left on which one could drive for ever; give a larger box")


def unreachable(network: RoadNetwork) -> set[int]:
    """Chains with a direction from which not all others can be reached, or which cannot be reached."""
    edges: list[tuple[tuple[int, bool], tuple[int, bool]]] = []
    places: set[tuple[int, bool]] = set()
    for junction in network.junctions:
        ends = junction.cluster.ends
        for i, j in {(m.source, m.target) for m in junction.movements}:
            edges.append(((ends[i].chain, ends[i].side == 1), (ends[j].chain, ends[j].side == 0)))
        for end in ends:
            for ahead, goes in ((end.side == 1, end.enters), (end.side == 0, end.leaves)):
                if goes:
                    places.add((end.chain, ahead))
    sources, targets = {a for a, _ in edges}, {b for _, b in edges}
    stuck = {place[0] for place in places if place not in sources or place not in targets}
    if stuck:
        return stuck
    part = parts(edges, "strong")
    length: Counter[int] = Counter()
    for (chain, _), k in part.items():
        length[k] += round(network.of_chain[chain].length)
    best = max(length, key=lambda k: (length[k], -k))
    return {chain for (chain, _), k in part.items() if k != best}
