"""Map files as bytes: packed, in any encoding, with any namespace and any name."""

import gzip
from pathlib import Path

import pytest
from shared_fixtures.worlds.ring_maps import joined_map, ring_map

from carlaloc_env.core.errors import MapError
from carlaloc_env.map import map_text
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.sources import identify_town

PLAIN = read_opendrive(ring_map().encode())


def declared(encoding: str) -> str:
    return f'<?xml version="1.0" encoding="{encoding}"?>\n'


@pytest.mark.parametrize(
    ("name", "stated", "written", "told"),
    [
        ("环路", "GB2312", "gb2312", None),
        ("环路", "UTF-8", "gb2312", "GB18030"),
        ("环路", "", "gbk", "GB18030"),
        ("环路", "UTF-8", "utf-8", None),
        ("环路", "", "utf-8-sig", None),
        ("环路", "UTF-16", "utf-16", None),
        ("环路", "UTF-16", "utf-16-le", None),
        ("环路", "", "utf-16-be", None),
        ("环路", "", "utf-32", None),
        ("Straße", "ISO-8859-1", "latin-1", None),
        ("Straße", "UTF-8", "latin-1", "CP1252"),
        ("Straße", "", "latin-1", "CP1252"),
        ("Straße", "no-such", "utf-8", "states encoding no-such; read as UTF-8"),
        ("Straße", "punycode", "utf-8", "states encoding punycode; read as UTF-8"),
        ("Straße", "us-ascii", "utf-8", "UTF-8"),
        ("道路", "Shift_JIS", "shift_jis", None),
    ],
)
def test_encodings(name: str, stated: str, written: str, told: str | None) -> None:
    text = (declared(stated) if stated else "\n\n") + ring_map(name=name)
    xodr = read_opendrive(text.encode(written))
    assert xodr.roads[0].name == name
    found = [note.message for note in xodr.notes if note.element == "OpenDRIVE"]
    assert len(found) == (told is not None)
    assert told is None or told in found[0]
    # The declaration is taken off, not its line.
    assert xodr.roads[0].line == text.count("\n", 0, text.index("<road")) + 1


@pytest.mark.parametrize(
    ("root", "space"),
    [
        ("OpenDRIVE", 'xmlns="http://www.opendrive.org"'),
        ("OpenDRIVE", 'xmlns="http://code.asam.net/simulation/standard/opendrive_schema" xmlns:x="urn:x"'),
        ("odr:OpenDRIVE", 'xmlns:odr="http://www.opendrive.org"'),
        ("openDrive", ""),
    ],
)
def test_roots(root: str, space: str) -> None:
    assert read_opendrive(ring_map(root=root, space=space).encode()).roads == PLAIN.roads


def test_a_comment_before_the_declaration() -> None:
    text = "<!-- made by hand -->\n" + declared("gb2312") + ring_map(name="环路")
    xodr = read_opendrive(text.encode("gb2312"))
    assert xodr.roads[0].name == "环路"
    assert [note.element for note in xodr.notes] == ["header"]


def test_a_root_of_another_name_with_roads_is_told() -> None:
    xodr = read_opendrive(ring_map(root="Roads").encode())
    assert xodr.roads == PLAIN.roads
    assert [n.severity for n in xodr.notes if "root element is <Roads>" in n.message] == ["error"]


def test_elements_of_other_schemas_are_no_roads() -> None:
    text = ring_map(space='xmlns="http://www.opendrive.org" xmlns:x="urn:x"', header="<x:offset x='nan'/>")
    assert len(read_opendrive(text.encode()).notes) == 1


def test_packed_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ring.xodrz", "ring.xodr.gz"):
        path = tmp_path / name
        path.write_bytes(gzip.compress(ring_map().encode()))
        assert read_opendrive(path).roads == PLAIN.roads
        assert identify_town(path).name == "ring"
    with pytest.raises(MapError, match="ends early"):
        read_opendrive(gzip.compress(ring_map().encode())[:-40])
    monkeypatch.setattr(map_text, "FILE_LIMIT_BYTES", 1 << 20)
    with pytest.raises(MapError, match="larger than 1 MB"):
        read_opendrive(gzip.compress(b" " * (1 << 24)))


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("a" * 150 + ".xodr", "a" * 80),
        ("My map (1).xodr", "My_map__1_"),
        ("地图.xodr", "__"),
        ("UPPER.XODR", "UPPER"),
        ("v1.2.xodr", "v1.2"),
        ("road.xml", "road"),
    ],
)
def test_names_of_files(tmp_path: Path, file: str, name: str) -> None:
    (tmp_path / file).write_text(ring_map(), encoding="utf-8")
    assert identify_town(tmp_path / file).name == name


def test_a_slip_inside_a_whole_file_is_told_and_the_rest_read() -> None:
    """A bare & in a name; of a file that ends early, the roads and junctions that are whole."""
    xodr = read_opendrive(joined_map().replace('name="J"', 'name="A & B"').encode())
    assert (len(xodr.roads), len(xodr.junctions)) == (3, 1)
    assert [n.severity for n in xodr.notes if "not well-formed" in n.message] == ["error"]
    cut = joined_map().encode()
    early = read_opendrive(cut[: cut.index(b'<road name="" length="20"') + 300])
    assert [road.id for road in early.roads] == ["1", "2"]
    assert [n.severity for n in early.notes if "not well-formed" in n.message] == ["error"]
    with pytest.raises(MapError, match="not well-formed"):
        read_opendrive(cut[:200])
