"""Identifiers of a map: disjoint ranges per kind, never 0."""

from dataclasses import dataclass, field

ROAD, JUNCTION, SIGNAL, CONTROLLER, OBJECT = "road", "junction", "signal", "controller", "object"
"""Kinds of things that are numbered."""
_FIRST = {ROAD: 1, JUNCTION: 100_001, SIGNAL: 200_001, CONTROLLER: 300_001, OBJECT: 400_001}


@dataclass(slots=True)
class Numbers:
    """Counts identifiers up; connecting roads of junction j are 1000·j + 1, 1000·j + 2 and so on."""

    used: dict[str, int] = field(default_factory=dict)

    def next(self, kind: str) -> int:
        """Next free identifier of a kind."""
        self.used[kind] = self.used.get(kind, _FIRST[kind] - 1) + 1
        return self.used[kind]

    def connecting_road(self, junction_id: int) -> int:
        """Next connecting road of a junction."""
        key = f"junction {junction_id}"
        self.used[key] = self.used.get(key, 0) + 1
        index = junction_id - 100_000
        # Those of the hundredth junction would be ids of junctions.
        return 1000 * (index if index < 100 else index + 900) + self.used[key]
