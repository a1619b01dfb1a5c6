"""One fault of a map, as all checks give it."""

from __future__ import annotations

from carlaloc_env.town.opendrive.records import Note, Severity

Problem = Note
"""One fault of a map."""
Row = tuple[Severity, str, str, int, str]
"""Values of a `Problem`, in the order of its fields."""
