"""Where maps lie, which one a name means, and the text of their files: unpacked, and decoded by its bytes.

Light, so that mistakes are reported before anything is built.
"""

import codecs
import importlib.resources
import os
import re
import zlib
from dataclasses import dataclass
from pathlib import Path

from carlaloc_env.core.errors import MapError, is_name, unknown_name
from carlaloc_env.core.files.array_cache import content_hash

NAME_LIMIT = 80
"""Longest name of a town that is called after its file; names of kept files hold more than it."""
_SUFFIX = re.compile(r"\.[^.]+(\.gz)?$")
FEATURES = "features.geojson"
"""File beside a `town.xodr` that says what stands beside its roads."""
ALIASES = {"Town10HD": "Town10"}
"""Other names of towns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TownId:
    """A town that has not been built."""

    name: str
    """Name of the town."""
    source_hash: str
    """Hash of its map, `town.toml` and features, which names its files in the cache, not the built town."""
    source: Path
    """Its OpenDRIVE file."""
    toml: Path | None
    """Its settings, if it has some."""
    features: Path | None = None
    """Things beside its roads, if they are known."""


def find_town(name: str) -> Path:
    """OpenDRIVE file of a town in `$CARLALOC_MAPS` or among the installed maps.

    Raises:
        MapError: There is no such town; the message names the nearest one.
    """
    wanted = ALIASES.get(name, name)
    known = known_towns()
    for town, path in known.items():
        if town.lower() == wanted.lower():
            return path
    raise MapError(unknown_name("town", name, known))


def known_towns() -> dict[str, Path]:
    """OpenDRIVE files of all towns in `$CARLALOC_MAPS` and among the installed maps, by name."""
    found: dict[str, Path] = {}
    for folder in _map_folders():
        for town in sorted(folder.iterdir()):
            if (town / "town.xodr").is_file():
                found.setdefault(town.name, town / "town.xodr")
    return found


def identify_town(name_or_path: str | Path) -> TownId:
    """A town by name or OpenDRIVE file.

    Args:
        name_or_path: Name of a folder in `maps`, or an .xodr file, beside which a `town.toml` may lie.

    Raises:
        MapError: The town is unknown or its file cannot be read.
    """
    source = _source(name_or_path)
    beside = source.with_name("town.toml")
    toml = beside if source.name == "town.xodr" and beside.is_file() else None
    mapped = source.with_name(FEATURES)
    features = mapped if source.name == "town.xodr" and mapped.is_file() else None
    try:
        parts = [source.read_bytes(), b"" if toml is None else toml.read_bytes()]
        if features is not None:
            parts.append(features.read_bytes())
    except OSError as error:
        raise MapError(f"cannot read {error.filename}: {error.strerror}; give another map") from error
    return TownId(
        name=_name_of(source),
        source_hash=content_hash(*parts),
        source=source,
        toml=toml,
        features=features,
    )


def _source(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.name.lower().endswith(MAP_SUFFIXES) or (path.suffix and path.is_file()):
        if not path.is_file():
            raise MapError(
                f"there is no file {path}; give the path of an OpenDRIVE file or the name of a town"
            )
        return path
    if path.is_dir() and (path / "town.xodr").is_file():
        return path / "town.xodr"
    return find_town(str(name_or_path))


def _name_of(source: Path) -> str:
    """A town's name by that of its folder or file: other characters become ``_``, what is too long is cut."""
    stem = source.absolute().parent.name if source.name == "town.xodr" else _SUFFIX.sub("", source.name)
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", stem)[:NAME_LIMIT]
    return name if is_name(name) else "map"


def _map_folders() -> list[Path]:
    folders = [Path(entry) for entry in os.environ.get("CARLALOC_MAPS", "").split(os.pathsep) if entry]
    folders.append(Path(str(importlib.resources.files("carlaloc_env.maps"))))
    return [folder for folder in folders if folder.is_dir()]


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
