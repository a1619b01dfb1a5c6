"""Identifiers of a map: disjoint ranges per kind, never 0."""

from dataclasses import dataclass, field

ROAD, JUNCTION, SIGNAL, CONTROLLER, OBJECT = "road", "junction", "signal", "controller", "object"
"""Kinds of things that are numbered."""
_FIRST = {ROAD: 1, JUNCTION: 100_001, SIGNAL: 200_001, CONTROLLER: 300_001, OBJECT: 400_001}


@dataclass(slots=True)
class Numbers:
    """Counts identifiers up, each kind in its range; connecting roads have ranges of their own."""

    used: dict[str, int] = field(default_factory=dict)

    def next(self, kind: str) -> int:
        """Next free identifier of a kind."""
        self.used[kind] = self.used.get(kind, _FIRST[kind] - 1) + 1
        return self.used[kind]

    def connecting_road(self, junction_id: int) -> int:
        """Next connecting road of a junction.

        Junction j below 100 counts from 1000·j + 1 on, a later one from 1000·(j + 900) + 1 on: what lies
        between is ids of other kinds.
        """
        key = f"junction {junction_id}"
        self.used[key] = self.used.get(key, 0) + 1
        index = junction_id - 100_000
        return 1000 * (index if index < 100 else index + 900) + self.used[key]
