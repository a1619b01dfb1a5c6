"""Opens an XML file safely and reads its attributes with errors that name element, id and line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NoReturn
from xml.parsers import expat

from lxml import etree

from carlaloc_env.core.errors import MapError

FILE_LIMIT_BYTES = 64 * 1024 * 1024
"""Larger files are refused."""
VALUE_LIMIT = 1.0e6
"""Coordinates and lengths beyond this are refused [m]."""

Element = Any
"""An ``lxml.etree._Element``; lxml has no types of its own."""


class Document:
    """A parsed XML file and the reading of its attributes."""

    def __init__(self, source: Path | bytes) -> None:
        """Parses a file or its bytes.

        Raises:
            MapError: The file cannot be read, is too large, holds a DTD, or is not well-formed.
        """
        self.name = source.name if isinstance(source, Path) else "<bytes>"
        data = self._load(source)
        self.root: Element = self._parse(data)
        self._lines = _far_lines(data, self.root)

    def _load(self, source: Path | bytes) -> bytes:
        if isinstance(source, bytes):
            data = source
        else:
            try:
                with source.open("rb") as file:
                    data = file.read(FILE_LIMIT_BYTES + 1)
            except OSError as error:
                raise MapError(f"cannot read {source}: {error.strerror or error}; check the path") from error
        if len(data) > FILE_LIMIT_BYTES:
            raise MapError(f"{self.name} is larger than {FILE_LIMIT_BYTES >> 20} MB; split the map")
        return data

    def _parse(self, data: bytes) -> Element:
        if b"\0" in data:
            raise MapError(f"{self.name} is not UTF-8 text; save the map as UTF-8 XML")
        # libxml2 expands entities in attributes even when told not to resolve them, so none may exist.
        at = max(data.find(b"<!DOCTYPE"), data.find(b"<!ENTITY"))
        if at >= 0:
            line = data.count(b"\n", 0, at) + 1
            raise MapError(f"{self.name}: line {line}: a DTD or entity is not allowed in a map; remove it")
        parser = etree.XMLParser(
            resolve_entities=False,
            no_network=True,
            load_dtd=False,
            huge_tree=False,
            remove_comments=True,
            remove_pis=True,
        )
        try:
            root = etree.fromstring(data, parser)
        except (etree.XMLSyntaxError, ValueError, LookupError) as error:
            text = " ".join(str(error).split()) or "empty"
            raise MapError(
                f"{self.name} is not well-formed XML: {text}; repair or export it again"
            ) from error
        if root.getroottree().docinfo.internalDTD is not None:
            raise MapError(f"{self.name}: line 1: a DTD is not allowed in a map; remove it")
        if root.tag != "OpenDRIVE":
            line = root.sourceline or 1
            raise MapError(
                f"{self.name}: line {line}: root element is <{str(root.tag)[:60]}>, not <OpenDRIVE>; "
                "give an OpenDRIVE (.xodr) file"
            )
        return root

    def line(self, element: Element) -> int:
        """Line of an element in the file, from 1."""
        found = self._lines.get(element) if self._lines else None
        return found if found is not None else int(element.sourceline or 0)

    def fail(self, element: Element, problem: str, advice: str) -> NoReturn:
        """Raises the one-line MapError for an element."""
        raise MapError(f"{self.name}: line {self.line(element)}: {describe(element)} {problem}; {advice}")

    def text(self, element: Element, name: str, default: str | None = None) -> str:
        """A string attribute; without default it must exist and not be empty."""
        value = element.get(name)
        if value is None or (value == "" and default is None):
            if default is None:
                self.fail(element, f"has no attribute '{name}'", f'add {name}="…"')
            return default
        return str(value)

    def number(
        self,
        element: Element,
        name: str,
        default: float | None = None,
        *,
        limit: float = VALUE_LIMIT,
    ) -> float:
        """A finite number; |value| may not exceed `limit`."""
        raw = element.get(name)
        if raw is None or raw == "":
            if default is None:
                self.fail(element, f"has no attribute '{name}'", f'add {name}="…"')
            return default
        try:
            value = float(raw)
        except ValueError:
            self.fail(element, f"has {name}='{raw[:40]}'", "write a number")
        if not math.isfinite(value):
            self.fail(element, f"has {name}='{raw[:40]}'", "write a finite number")
        if abs(value) > limit:
            self.fail(element, f"has {name}={value:g}", f"keep it within ±{limit:g}")
        return value

    def length(self, element: Element, name: str, default: float | None = None) -> float:
        """A number that is not negative."""
        value = self.number(element, name, default)
        if value < 0.0:
            self.fail(element, f"has {name}={value:g}", "write a length of 0 or more")
        return value

    def integer(self, element: Element, name: str, default: int | None = None, *, limit: int = 10**9) -> int:
        """A whole number; |value| may not exceed `limit`."""
        value = self.number(element, name, default, limit=float(limit))
        if value != math.floor(value):
            self.fail(element, f"has {name}={value:g}", "write a whole number")
        return int(value)


def _far_lines(data: bytes, root: Element) -> dict[Element, int]:
    """Lines of all elements of a file that has more lines than libxml2 counts (65535)."""
    if data.count(b"\n") < 65_534:
        return {}
    lines: list[int] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda *_: lines.append(parser.CurrentLineNumber)
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError):
        return {}
    elements = list(root.iter(etree.Element))
    return dict(zip(elements, lines, strict=True)) if len(elements) == len(lines) else {}


def describe(element: Element) -> str:
    """``<tag id="7"> in road 12``: an element and where it stands."""
    label = element.get("id")
    own = f'<{element.tag} id="{label[:40]}">' if label is not None else f"<{element.tag}>"
    parent = element.getparent()
    places = []
    while parent is not None and parent.tag != "OpenDRIVE":
        name = parent.get("id")
        if name is not None and parent.tag in ("road", "junction", "lane", "controller", "object", "signal"):
            places.append(f"{parent.tag} {name[:40]}")
        parent = parent.getparent()
    return " of ".join([own, *places])
