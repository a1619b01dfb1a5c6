"""Extracts: formats, boxes, places on the Earth, and files that are none."""

from __future__ import annotations

import bz2
import gzip
import re
from pathlib import Path
from typing import Any

import numpy as np
import osmium
import pytest
from osmium.osm.mutable import Node, Way
from shared_fixtures.worlds.street_sketches import OXFORD, Sketch, village

from carlaloc_env.core.errors import MapError
from carlaloc_env.openstreetmap.countries import country_of
from carlaloc_env.openstreetmap.driving_side import drives_left
from carlaloc_env.openstreetmap.extract import read_extract
from carlaloc_env.openstreetmap.import_town import import_town


@pytest.mark.parametrize("packer", [gzip, bz2])
def test_plain_and_packed_files_hold_the_same(packer: Any, tmp_path: Path) -> None:
    """Whatever their names."""
    plain_file = village().write(tmp_path / "a.osm")
    (tmp_path / "packed.osm").write_bytes(packer.compress(plain_file.read_bytes()))
    plain, packed = read_extract(plain_file), read_extract(tmp_path / "packed.osm")
    assert plain.xy_m == packed.xy_m
    assert {key: way.tags for key, way in plain.ways.items()} == {
        key: way.tags for key, way in packed.ways.items()
    }


def test_pbf_holds_the_same(tmp_path: Path) -> None:
    plain = village().write(tmp_path / "a.osm")
    with osmium.SimpleWriter(str(tmp_path / "a.osm.pbf")) as writer:
        for item in osmium.FileProcessor(str(plain)):
            writer.add(item)
    assert read_extract(tmp_path / "a.osm.pbf").xy_m == read_extract(plain).xy_m


@pytest.mark.parametrize("suffix", ["osm", "osm.gz", "osm.bz2", "osm.pbf"])
def test_deleted_elements_are_left_out(suffix: str, tmp_path: Path) -> None:
    """As in a file with history, whatever its format."""
    street = {"highway": "residential"}
    path = tmp_path / f"a.{suffix}"
    with osmium.SimpleWriter(osmium.io.File(str(path), f"{suffix},history=true")) as writer:
        for number, there in enumerate((True, False, True), 1):
            place = (8.4, 49.0 + 0.001 * number)
            writer.add_node(Node(id=number, location=place, version=1, visible=there))
        writer.add_way(Way(id=4, nodes=[1, 3, 2], tags=street, version=1))
        writer.add_way(Way(id=5, nodes=[3, 1], tags=street, version=1, visible=False))
    extract = read_extract(path.rename(tmp_path / "renamed"))
    assert sorted(extract.degrees) == [1, 3]
    assert [(way.id, way.tags) for way in extract.ways.values()] == [(4, street)]


def test_elements_deleted_in_an_editor_are_left_out_and_counted(tmp_path: Path) -> None:
    """As if they were not in the file; new elements, numbered from -1 down, keep their places in any box."""
    sketch = village()
    text = sketch.write(tmp_path / "a.osm").read_text()
    block = next(way for way in re.findall("<way.*?</way>", text, re.DOTALL) if "Back Lane" in way)
    new = "<node id='-1' lon='{}' lat='{}'/>".format(*sketch.degrees[1])
    (tmp_path / "b.osm").write_text(text.replace(block, "").replace("<way", f"{new}<way", 1))
    deleted = block.replace("<way", '<way action="delete"', 1)
    (tmp_path / "a.osm").write_text(text.replace(block, deleted).replace("<way", f"{new}<way", 1))
    box = (*(value - 1e-3 for value in sketch.degrees[1]), *(value + 1e-3 for value in sketch.degrees[1]))
    edited, right = (read_extract(tmp_path / file, box) for file in ("a.osm", "b.osm"))
    assert (edited.ways, edited.degrees) == (right.ways, right.degrees)
    assert edited.degrees[-1] == pytest.approx(sketch.degrees[1])
    assert list(import_town(tmp_path / "a.osm").report["left_out"].values()) == ["deleted in an editor"]


def test_nodes_lie_where_they_were_drawn(tmp_path: Path) -> None:
    """To 3 cm: seven decimals of a degree; the origin is the middle of the streets."""
    sketch = village()
    extract = read_extract(sketch.write(tmp_path / "a.osm"))
    drawn = np.array(list(sketch.nodes))
    found = np.array([extract.xy_m[number] for number in sketch.nodes.values()])
    assert np.abs((found - found[0]) - (drawn - drawn[0])).max() < 0.03
    lat, lon, _ = extract.geo.enu_to_geodetic([*extract.xy_m[1], 0.0])
    assert abs(lon - sketch.degrees[1][0]) < 1e-7
    assert abs(lat - sketch.degrees[1][1]) < 1e-7


def test_a_box_cuts_streets_where_they_cross_it(tmp_path: Path) -> None:
    sketch = village()
    path = sketch.write(tmp_path / "a.osm")
    (west, south, _), (east, north, _) = (
        sketch.geo.enu_to_geodetic([x, y, 0.0])[[1, 0, 2]] for x, y in ((-120, -100), (100, 100))
    )
    extract = read_extract(path, (float(west), float(south), float(east), float(north)))
    high = next(way for way in extract.ways.values() if way.tags.get("name") == "High Street")
    length = float(np.hypot(*np.diff(extract.line(high.nodes), axis=0).T).sum())
    assert abs(length - 220.0) < 0.5


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no whole .osm file"),
        (b"<osm version='0.6'><node id='1' lon='1' lat='2'/><way", "no whole .osm file"),
        (b"<osm></osm>", "no whole .osm file .*without version"),
        (b"\x1f\x8b\x08\x00cut", "cannot read"),
        (b"<osm version='0.6'></osm>", "no nodes"),
        (b"<osm version='0.6'><node id='x' lon='1' lat='2'/></osm>", "no number"),
        (b"<osm version='0.6'><node id='1' lon='east' lat='2'/></osm>", "no number"),
        (b"BZhcut", "cannot read"),
        (b"<osm version='0.6'><node id='1' lon='1' lat='2'/></osm>", "no street for cars"),
        (
            b"<osm version='0.6'><node id='1' lon='1' lat='2'/><way id='2'><nd ref='7'/><nd ref='8'/>"
            b"<tag k='highway' v='residential'/></way></osm>",
            "no street for cars",
        ),
        (b"PK\x03\x04rest", "unzip"),
        (b"\x28\xb5\x2f\xfdrest", "zstd -d"),
        (b"\xfd7zXZ\x00rest", "unxz"),
        (b'{"elements": []}', r"out:xml"),
        (b"<!DOCTYPE html><html/>", "a web page"),
        (b"<osmChange><modify/></osmChange>", "apply-changes"),
        (b"<OpenDRIVE/>", "an OpenDRIVE map"),
        (b"<osm><remark>runtime error: out of memory</remark></osm>", "not whole: runtime error"),
        (
            b"<osm version='0.6'><node id='1' lon='1' lat='2'/><way id='2'/><relation id='3'>"
            b"<tag k='type' v='lanelet'/></relation></osm>",
            "Lanelet2",
        ),
        (b"<osm version='0.6'><node id='1' lon='' lat=''><tag k='local_x' v='3'/></node></osm>", "Lanelet2"),
    ],
)
def test_what_is_no_extract_gives_one_line(content: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.osm"
    path.write_bytes(content)
    with pytest.raises(MapError, match=words) as error:
        import_town(path)
    assert "\n" not in str(error.value)


def test_boxes_that_hold_nothing_give_one_line(tmp_path: Path) -> None:
    path = village().write(tmp_path / "a.osm")
    with pytest.raises(MapError, match="covers --bbox 16"):
        import_town(path, box=(1.0, 1.0, 1.1, 1.1))
    with pytest.raises(MapError, match="W,S,E,N"):
        import_town(path, box=(2.0, 1.0, 1.0, 1.1))
    with pytest.raises(MapError, match="cannot read"):
        import_town(tmp_path / "none.osm")


@pytest.mark.parametrize("tags", [{}, {"oneway": "yes"}])
def test_a_single_short_dead_end_is_refused(tags: dict[str, str], tmp_path: Path) -> None:
    sketch = Sketch()
    sketch.way((0, 0), (30, 0), highway="residential", **tags)
    with pytest.raises(MapError, match="larger box"):
        import_town(sketch.write(tmp_path / "a.osm"))


def test_the_side_follows_from_rings_then_carriageways_then_the_place(tmp_path: Path) -> None:
    def side(sketch: Sketch) -> tuple[bool, str]:
        extract = read_extract(sketch.write(tmp_path / "a.osm"))
        return drives_left(extract, country_of(extract.geo.longitude_deg, extract.geo.latitude_deg))

    assert side(village(OXFORD)) == (True, "country GB")
    assert side(village()) == (False, "country AT")
    ring = village(OXFORD)
    corners = [(50, 50), (60, 50), (60, 60), (50, 60), (50, 50)]
    ring.way(*corners, highway="residential", junction="roundabout")  # anticlockwise
    assert side(ring) == (False, "roundabouts")
    pair = village()
    pair.way((0, 300), (300, 300), highway="primary", oneway="yes", ref="1")
    pair.way((300, 290), (0, 290), highway="primary", oneway="yes", ref="1")  # on the right
    assert side(pair) == (True, "dual carriageways")
