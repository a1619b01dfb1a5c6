"""Notes on elements and attributes that are not read, by the table in `elements.toml`."""

import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from carlaloc_env.map.opendrive.xml_document import Document, Element

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ELEMENTS = Path(__file__).with_name("elements.toml")
"""All elements and attributes of the standard: which are read, and what is missing without the others."""
_FREE = frozenset({"userData", "dataQuality"})
"""Elements whose content the standard leaves open."""
_NOTHING = ("", "none", "false", "no", "unknown", "undefined", "-1")
_ZERO = re.compile(r"[-+]?0*\.?0*(?:[eE][-+]?\d+)?")
"""Values that change nothing."""


@cache
def element_table() -> dict[str, dict[str, Any]]:
    """The table: an entry for each element, by its name or by ``parent/name``."""
    return tomllib.loads(ELEMENTS.read_text(encoding="utf-8"))


def note_unread(document: Document) -> None:
    """Notes what is not read: once in each road or junction, unknown names once in the file."""
    noted: set[tuple[str, str, int | None]] = set()
    for number, top in enumerate(document.root.iterchildren("*")):
        for element, message, standard in _unread(top):
            kind = (element.tag, message, number if standard else None)
            if kind not in noted:
                noted.add(kind)
                document.note(element, message)


def _unread(element: Element) -> Iterator[tuple[Element, str, bool]]:
    """What is not read of an element and those in it: where, what is missing, whether the standard has it."""
    if element.tag in _FREE or "{" in element.tag:
        return
    table, parent = element_table(), element.getparent().tag
    entry = table.get(f"{parent}/{element.tag}") or table.get(element.tag)
    if not len(element) and not element.attrib and not (element.text or "").strip():
        return
    if entry is not None and "missing" in entry:
        yield element, f"is not read: {entry['missing']}", True
    elif entry is None or parent not in entry.get("in", "").split():
        yield element, f"is no element of <{parent}> in OpenDRIVE 1.4 to 1.8, so it is not read", False
    else:
        yield from _unread_attributes(element, entry)
        for child in element.iterchildren("*"):
            yield from _unread(child)


def _unread_attributes(element: Element, entry: dict[str, Any]) -> Iterator[tuple[Element, str, bool]]:
    unread = {**element_table()["any"]["unread"], **entry.get("unread", {})}
    listed = f"{entry.get('read', '')} {entry.get('other', '')}".split()
    values = entry.get("values", {})
    for name, value in element.attrib.items():
        if name in values and value not in ("", *values[name]):
            yield element, f"{name}='{value[:40]}' is none of the standard's; the usual one is taken", True
        if name in listed or "{" in name:
            continue
        if name not in unread:
            yield element, f"has '{name[:40]}', no attribute of it in OpenDRIVE 1.4 to 1.8, not read", False
            continue
        missing, *usual = [unread[name]] if isinstance(unread[name], str) else unread[name]
        if value not in (*usual, *_NOTHING) and not _ZERO.fullmatch(value):
            yield element, f"attribute '{name}' is not read: {missing}", True
