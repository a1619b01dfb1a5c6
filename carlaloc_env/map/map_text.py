"""The text of map files: unpacked, and decoded by its bytes."""

import codecs
import re
import zlib
from pathlib import Path

from carlaloc_env.core.errors import MapError

FILE_LIMIT_BYTES = 64 * 1024 * 1024
"""Larger files are refused, packed or unpacked."""
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
    text = _DECLARATION.sub(lambda declaration: "\n" * declaration[0].count("\n"), text, count=1)
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
