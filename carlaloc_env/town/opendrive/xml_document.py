"""Opens an XML file safely and reads its attributes with errors that name element, id and line.

Text of a map file: unpacked, and decoded as its bytes say rather than as it declares.
"""

from __future__ import annotations

import codecs
import math
import re
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NoReturn, TypeVar
from xml.parsers import expat

from lxml import etree

from carlaloc_env.core.errors import MapError
from carlaloc_env.town.opendrive.records import Note, Severity

FILE_LIMIT_BYTES = 64 * 1024 * 1024
"""Larger files are refused, packed or unpacked."""
MAP_SUFFIXES = (".xodr", ".xodrz", ".xodr.gz")
"""Suffixes of map files; the last two are packed by gzip."""

_GZIP = b"\x1f\x8b"
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
"""Byte-order marks, the longer first."""
_BARE = {"1000": "utf-32-le", "0001": "utf-32-be", "1010": "utf-16-le", "0101": "utf-16-be"}
"""Wide encodings without a mark, by which of the first four bytes are not 0."""
_DECLARED = re.compile(rb"""<\?xml\s[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]{1,40})["']""")
_DECLARATION = re.compile(r"<\?xml\s[^>]*\?>")
_PAIRS = re.compile(rb"(?:[\xa1-\xf7][\xa1-\xfe])+")
_HIGH = re.compile(rb"[\x80-\xff]+")
_WIDER = {"gb2312": "gb18030", "gbk": "gb18030", "iso8859-1": "cp1252"}
"""Encodings that writers name when they mean a larger one."""
_NO_TEXT = frozenset({"idna", "punycode", "unicode_escape", "raw_unicode_escape", "undefined"})
"""Python's codecs that no file is written in."""


def read_bytes(source: Path) -> bytes:
    """Content of a map file, unpacked.

    Raises:
        MapError: The file cannot be read, is too large, or is packed and damaged.
    """
    try:
        with source.open("rb") as file:
            data = file.read(FILE_LIMIT_BYTES + 1)
    except OSError as error:
        raise MapError(f"cannot read {source}: {error.strerror or error}; check the path") from error
    return data


def decoded(data: bytes, name: str) -> tuple[str, str | None]:
    """Text of a map without mark and XML declaration, lines kept; and a remark where bytes contradict it.

    Args:
        data: The file, packed or not.
        name: Its name, for errors.

    Raises:
        MapError: It is too large, damaged, or no text.
    """
    data = _unpacked(data, name)
    if len(data) > FILE_LIMIT_BYTES:
        raise MapError(f"{name} is larger than {FILE_LIMIT_BYTES >> 20} MB; split the map")
    text, remark = _text(data)
    if "\0" in text:
        raise MapError(f"{name} is not text; save the map as UTF-8 XML")
    # What follows a declaration is UTF-8 from here on; its lines still count.
    text = _DECLARATION.sub(lambda found: "\n" * found[0].count("\n"), text, count=1)
    return text, remark


def _unpacked(data: bytes, name: str) -> bytes:
    if not data.startswith(_GZIP):
        return data
    unpack = zlib.decompressobj(wbits=31)
    try:
        unpacked = unpack.decompress(data, FILE_LIMIT_BYTES + 1)
    except zlib.error as error:
        raise MapError(f"{name} is a damaged gzip file: {error}; pack it again") from error
    if not unpack.eof and len(unpacked) <= FILE_LIMIT_BYTES:
        raise MapError(f"{name} is a gzip file that ends early; pack it again")
    return unpacked


def _text(data: bytes) -> tuple[str, str | None]:
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return data[len(mark) :].decode(encoding, "replace"), None
    wide = _BARE.get("".join("1" if byte else "0" for byte in data[:4]))
    if wide is not None:
        return data.decode(wide, "replace"), None
    declared = _DECLARED.search(data[:1024])
    stated = declared[1].decode() if declared else "UTF-8"
    try:
        codec = codecs.lookup(stated).name
        if codec in _NO_TEXT:
            raise LookupError(stated)
        return data.decode(_WIDER.get(codec, codec)), None
    except (LookupError, UnicodeError):
        encoding = _likeliest(data)
        stated_as = f"states encoding {stated}" if declared else "states no encoding and is not UTF-8"
        return data.decode(encoding, "replace"), f"{stated_as}; read as {encoding.upper()}"


def _likeliest(data: bytes) -> str:
    """UTF-8 if it is; Chinese where all bytes above 127 come in pairs; else Western European."""
    try:
        data.decode("utf-8")
    except UnicodeError:
        pairs = all(_PAIRS.fullmatch(run[0]) for run in _HIGH.finditer(data))
        return "gb18030" if pairs else "cp1252"
    return "utf-8"


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
            found = f"root element is <{str(root.tag)[:60]}>, not <OpenDRIVE>"
            if root.find("road/planView") is None:
                line = root.sourceline or 1
                raise MapError(f"{self.name}: line {line}: {found}; give an OpenDRIVE (.xodr) file")
            self._note_whole(f"its {found}")
        root.tag = "OpenDRIVE"
        return root

    def _mended(self, data: bytes, fault: str) -> Element:
        """Root of a file with a slip as libxml2 mends it, or of the part before an early end."""
        whole = re.search(rb"</(\w+:)?OpenDRIVE\s*>\s*$", data[-4096:]) is not None
        ends = [found.end() for found in re.finditer(rb"</(\w+:)?(road|junction)\s*>", data)]
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
        found = []
        for element in elements:
            try:
                found.append(read(element))
            except ElementError as error:
                inner = error.element is not element
                left_out = describe(element) if inner else "it"
                message = f"{error.problem}, so {left_out} is left out; {error.advice}"
                self.note(error.element, message, "error")
        return found

    def line(self, element: Element) -> int:
        """Line of an element in the file, from 1."""
        found = self._lines.get(element) if self._lines else None
        return found if found is not None else int(element.sourceline or 0)

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
