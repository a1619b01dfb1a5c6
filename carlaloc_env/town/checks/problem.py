"""One fault of a map, as all checks give it."""

from __future__ import annotations

from dataclasses import dataclass

from carlaloc_env.town.opendrive.records import Severity

Row = tuple[Severity, str, str, int, str]
"""Values of a `Problem`, in the order of its fields."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One fault of a map."""

    severity: Severity
    """How bad it is."""
    element: str
    """XML element, e.g. ``lane``."""
    id: str
    """Its id, with the road it belongs to."""
    line: int
    """Line in the file."""
    message: str

    def __str__(self) -> str:
        """One line: where, what."""
        return f"{self.severity}: line {self.line}: <{self.element}> {self.id}: {self.message}"
