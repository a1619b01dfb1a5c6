"""Opens an XML file safely and reads its attributes with errors that name element, id and line."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NoReturn, TypeVar
from xml.parsers import expat

from lxml import etree

from carlaloc_env.core.errors import MapError
from carlaloc_env.map.map_text import decoded, read_bytes
from carlaloc_env.map.opendrive.records import Note, Severity

VALUE_LIMIT = 1.0e6
"""Coordinates and lengths beyond this are refused [m]."""

Element = Any
"""An ``lxml.etree._Element``; lxml has no types of its own."""
T = TypeVar("T")
"""A record."""


class ElementError(MapError):
    """One element of a map cannot be used; the rest of the map may be."""

    def __init__(self, document: Document, element: Element, problem: str, advice: str) -> None:
        self.element, self.problem, self.advice = element, problem, advice
        where = f"{document.name}: line {document.line(element)}: {describe(element)}"
        super().__init__(f"{where} {problem}; {advice}")


class Document:
    """A parsed XML file, the reading of its attributes, and notes on what was odd."""

    def __init__(self, source: Path | bytes) -> None:
        """Parses a file or its bytes.

        Raises:
            MapError: The file cannot be read, is too large, holds a DTD, or is not well-formed.
        """
        self.name = source.name if isinstance(source, Path) else "<bytes>"
        self.notes: list[Note] = []
        text, remark = decoded(read_bytes(source) if isinstance(source, Path) else source, self.name)
        self.written_by_sumo = "SUMO netconvert" in text[:4096]
        data = text.encode("utf-8", "replace")
        self.root: Element = self._parse(data)
        self._lines = _far_lines(data, self.root)
        if remark is not None:
            self.note(self.root, remark)

    def _parse(self, data: bytes) -> Element:
        # libxml2 expands entities in attributes even when set not to resolve them, so none may exist.
        at = max(data.find(b"<!DOCTYPE"), data.find(b"<!ENTITY"))
        if at >= 0:
            line = data.count(b"\n", 0, at) + 1
            raise MapError(f"{self.name}: line {line}: a DTD or entity is not allowed in a map; remove it")
        try:
            root = etree.fromstring(data, _parser())
        except (etree.XMLSyntaxError, ValueError) as error:
            root = self._mended(data, " ".join(str(error).split()) or "empty")
        if root.getroottree().docinfo.internalDTD is not None:
            raise MapError(f"{self.name}: line 1: a DTD is not allowed in a map; remove it")
        _without_namespace(root)
        if str(root.tag).lower() != "opendrive":
            mistake = f"root element is <{str(root.tag)[:60]}>, not <OpenDRIVE>"
            if root.find("road/planView") is None:
                line = root.sourceline or 1
                raise MapError(f"{self.name}: line {line}: {mistake}; give an OpenDRIVE (.xodr) file")
            self._note_whole(f"its {mistake}")
        root.tag = "OpenDRIVE"
        return root

    def _mended(self, data: bytes, fault: str) -> Element:
        """Root of a file with a slip as libxml2 mends it, or of the part before an early end."""
        whole = re.search(rb"</(\w+:)?OpenDRIVE\s*>\s*$", data[-4096:]) is not None
        ends = [tag.end() for tag in re.finditer(rb"</(\w+:)?(road|junction)\s*>", data)]
        root = etree.fromstring(data if whole else data[: ends[-1]], _parser(recover=True)) if ends else None
        if root is None:
            raise MapError(f"{self.name} is not well-formed XML: {fault}; repair or export it again")
        self._note_whole(f"is not well-formed XML: {fault}; the rest is read")
        return root

    def _note_whole(self, message: str) -> None:
        self.notes.append(Note(severity="error", element="OpenDRIVE", id="", line=1, message=message))

    def note(self, element: Element, message: str, severity: Severity = "warning") -> None:
        """Remembers what is odd about an element."""
        label = element.get("id")
        places = [label[:40]] if label is not None else []
        self.notes.append(
            Note(
                severity=severity,
                element=str(element.tag),
                id=" of ".join([*places, *_places(element)]),
                line=self.line(element),
                message=message,
            )
        )

    def each(self, elements: Iterable[Element], read: Callable[[Element], T]) -> list[T]:
        """Records of all elements that can be read, in their order; a note on each of the others."""
        records = []
        for element in elements:
            try:
                records.append(read(element))
            except ElementError as error:
                inner = error.element is not element
                left_out = describe(element) if inner else "it"
                message = f"{error.problem}, so {left_out} is left out; {error.advice}"
                self.note(error.element, message, "error")
        return records

    def line(self, element: Element) -> int:
        """Line of an element in the file, from 1."""
        mended_line = self._lines.get(element) if self._lines else None
        return mended_line if mended_line is not None else int(element.sourceline or 0)

    def fail(self, element: Element, problem: str, advice: str) -> NoReturn:
        """Raises the one-line error for an element."""
        raise ElementError(self, element, problem, advice)

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


def _parser(*, recover: bool = False) -> Any:
    return etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
        recover=recover,
    )


def _without_namespace(root: Element) -> None:
    """Takes the root's namespace off all elements that share it; those of other schemas keep theirs."""
    prefix = str(root.tag).rpartition("}")[0] + "}"
    if prefix != "}":
        for element in root.iter(etree.Element):
            element.tag = str(element.tag).removeprefix(prefix)


def describe(element: Element) -> str:
    """``<tag id="7"> of road 12``: an element and where it stands."""
    label = element.get("id")
    own = f'<{element.tag} id="{label[:40]}">' if label is not None else f"<{element.tag}>"
    return " of ".join([own, *_places(element)])


def _places(element: Element) -> list[str]:
    parent = element.getparent()
    places = []
    while parent is not None and parent.tag != "OpenDRIVE":
        name = parent.get("id")
        if name is not None and parent.tag in ("road", "junction", "lane", "controller", "object", "signal"):
            places.append(f"{parent.tag} {name[:40]}")
        parent = parent.getparent()
    return places
