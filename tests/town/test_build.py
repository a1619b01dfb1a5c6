"""Finding, building and caching of towns, on a map small enough to build in a second."""

import os
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.worlds.maps import VILLAGE

from carlaloc_env.core.errors import MapError, OutputError
from carlaloc_env.core.files.array_files import arrays_hash, load, save
from carlaloc_env.map.sources import find_town, identify_town
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.build import kept_town_hash, load_town
from carlaloc_env.town.town import Town, town_hash

ROAD = """<?xml version="1.0"?>
<OpenDRIVE><header revMajor="1" revMinor="7" name="small"/>
<road name="Main" length="90.0" id="1" junction="-1"><link/>
<planView>
<geometry s="0" x="0" y="0" hdg="0" length="50"><line/></geometry>
<geometry s="50" x="50" y="0" hdg="0" length="40"><arc curvature="0.03"/></geometry>
</planView>
<elevationProfile><elevation s="0" a="1" b="0.02" c="0.0002" d="0"/></elevationProfile>
<lanes><laneSection s="0">
<left>
<lane id="2" type="sidewalk" level="false"><width sOffset="0" a="2.5" b="0" c="0" d="0"/></lane>
<lane id="1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
</left>
<center><lane id="0" type="none" level="false">
<roadMark sOffset="0" type="broken" weight="standard" color="yellow" width="0.12"/></lane></center>
<right>
<lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/>
<roadMark sOffset="0" type="solid" weight="standard" color="white" width="0.12"/></lane>
<lane id="-2" type="sidewalk" level="false"><width sOffset="0" a="2.5" b="0" c="0" d="0"/></lane>
</right>
</laneSection></lanes>
</road></OpenDRIVE>
"""
KINDS = "town", "scenery", "lanes", "hash"
"""What is kept of a town: its outline, its meshes, its roads, and its hash."""
TOML = '[town]\nname = "small"\ndefault_zone = "downtown"\n[traffic]\nvehicles = 7\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A maps folder with one town."""
    town = tmp_path / "maps" / "Small"
    town.mkdir(parents=True)
    (town / "town.xodr").write_text(ROAD)
    (town / "town.toml").write_text(TOML)
    return town


def _bytes(town: Town) -> str:
    arrays = {"collision": town.outline.collision_vertices_m, "triangles": town.outline.collision_triangles}
    tables = town.network.tables
    arrays |= {field.name: getattr(tables, field.name) for field in fields(tables)}
    for number, chunk in enumerate(town.chunks):
        for name in ("vertices_m", "triangles", "normals", "uv_m", "colour", "material", "tag", "instance"):
            arrays[f"{number}/{name}"] = getattr(chunk, name)
    return arrays_hash(arrays)


def test_builds_are_equal_byte_for_byte(folder: Path, tmp_path: Path) -> None:
    first = load_town(folder / "town.xodr", cache_dir=tmp_path / "a")
    second = load_town(folder / "town.xodr", cache_dir=tmp_path / "b")
    cached = load_town(folder / "town.xodr", cache_dir=tmp_path / "a")
    assert len(first.chunks) > 1
    assert _bytes(first) == _bytes(second) == _bytes(cached)
    assert first.town_hash == second.town_hash == cached.town_hash
    assert town_hash(cached.roads, cached.outline) == first.town_hash
    assert kept_town_hash(identify_town(folder), cache_dir=tmp_path / "a") == first.town_hash
    assert kept_town_hash(identify_town(folder), cache_dir=tmp_path / "c") is None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.999])
@pytest.mark.long
def test_a_truncated_cache_is_built_again(folder: Path, tmp_path: Path, share: float, kind: str) -> None:
    first = load_town(folder, cache_dir=tmp_path / "cache")
    (stored,) = (tmp_path / "cache").glob(f"*.{kind}")
    content = stored.read_bytes()
    stored.write_bytes(content[: int(len(content) * share)])
    again = load_town(folder, cache_dir=tmp_path / "cache")
    assert _bytes(again) == _bytes(first)
    assert load(stored) is not None


def test_what_is_odd_about_a_map_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A map in absolute coordinates is moved, in a line; what is odd below is counted in another."""
    reference = "<geoReference>EPSG:32632</geoReference>"
    text = ROAD.replace('name="small"/>', f'name="small">{reference}</header>').replace('id="2"', 'id="two"')
    text = text.replace('x="0" y="0"', 'x="691000" y="5336000"').replace(
        'x="50" y="0"', 'x="691050" y="5336000"'
    )
    (tmp_path / "far.xodr").write_text(text)
    town = load_town(tmp_path / "far.xodr", cache_dir=tmp_path / "cache")
    told = [record.getMessage() for record in caplog.records if "far.xodr" in record.getMessage()]
    assert len(told) == 2
    assert "x=691000, y=5336000" in told[0]
    assert "1 places are odd" in told[1]
    found = town.geo.enu_to_geodetic([0.0, 0.0, 1.0])
    np.testing.assert_allclose(found, [48.1485463, 11.5679498, 1.0], atol=1e-7)
    assert np.abs(town.network.tables.position_m[:, :2]).max() < 200.0


def test_a_map_that_no_car_can_drive_on_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bus.xodr").write_text(ROAD.replace('"driving"', '"restricted"'))
    with pytest.raises(MapError, match=r"no lane is of type driving.*restricted"):
        load_town(tmp_path / "bus.xodr", cache_dir=tmp_path / "cache")


def test_meshes_are_read_when_somebody_looks(folder: Path, tmp_path: Path) -> None:
    """And made again where their file has been damaged since the town was loaded."""
    first = load_town(folder, cache_dir=tmp_path / "cache")
    again = load_town(folder, cache_dir=tmp_path / "cache")
    (stored,) = (tmp_path / "cache").glob("*.scenery")
    content = bytearray(stored.read_bytes())
    content[len(content) // 2] ^= 0x40
    stored.write_bytes(content)
    assert _bytes(again) == _bytes(first)
    assert load(stored) is not None


def test_meshes_that_went_do_not_go_unnoticed(folder: Path, tmp_path: Path) -> None:
    """A town whose outline is made again has its meshes kept beside it, before anybody looks."""
    first = load_town(folder, cache_dir=tmp_path / "cache")
    for stored in (tmp_path / "cache").glob("*"):
        stored.unlink()
    load_town(folder, cache_dir=tmp_path / "cache")
    assert [len(list((tmp_path / "cache").glob(f"*.{kind}"))) for kind in KINDS] == [1] * 4
    assert _bytes(load_town(folder, cache_dir=tmp_path / "cache")) == _bytes(first)


def test_kept_arrays_come_back_as_they_were(tmp_path: Path) -> None:
    """Of every type and shape, also without values; aligned, so that they can be used where they lie."""
    kept = {
        "plain": np.arange(6, dtype=np.float32).reshape(2, 3),
        "none": np.zeros((0, 4), dtype=np.uint16),
        "bytes": np.arange(5, dtype=np.uint8),
        "turned": np.arange(12.0).reshape(3, 4).T,
        "number": np.array(7, dtype=np.int64),
    }
    save(tmp_path / "kept.town", kept)
    found = load(tmp_path / "kept.town")
    assert found is not None
    assert list(found) == list(kept)
    for name, value in kept.items():
        assert found[name].dtype == value.dtype
        assert found[name].shape == value.shape
        assert (found[name] == value).all()
        assert found[name].flags.aligned


def test_no_flipped_bit_of_a_kept_file_goes_unnoticed(tmp_path: Path) -> None:
    save(tmp_path / "kept.town", {"a": np.arange(16, dtype=np.float32)})
    content = (tmp_path / "kept.town").read_bytes()
    table_bytes = content.rindex(b"}") + 1
    for place in (*range(table_bytes), *range(len(content) - 64, len(content))):
        broken = bytearray(content)
        broken[place] ^= 0x04
        (tmp_path / "broken.town").write_bytes(broken)
        found = load(tmp_path / "broken.town")
        assert found is None or (found["a"] == np.arange(16)).all(), place


def test_another_toml_gives_another_town(folder: Path, tmp_path: Path) -> None:
    first = load_town(folder, cache_dir=tmp_path / "cache")
    (folder / "town.toml").write_text(TOML.replace("downtown", "rural"))
    second = load_town(folder, cache_dir=tmp_path / "cache")
    assert first.town_hash != second.town_hash
    assert _bytes(first) != _bytes(second)
    assert [len(list((tmp_path / "cache").glob(f"*.{kind}"))) for kind in KINDS] == [2] * 4


def test_nothing_half_written_stands_under_the_final_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OutputError, match="disk full"):
        save(tmp_path / "kept.town", {"a": np.zeros(3)})
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_does_not_stop_a_town(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert load_town(folder, cache_dir=tmp_path / "file" / "cache").chunks


def test_towns_are_found_by_name(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CARLALOC_MAPS", str(folder.parent))
    assert find_town("small") == folder / "town.xodr"
    assert find_town("Town03").parent.name == "Town03"
    with pytest.raises(MapError, match=r"no town 'Twon03'; did you mean 'Town03'\?"):
        find_town("Twon03")
    with pytest.raises(MapError, match="there is no file"):
        load_town("missing.xodr")


def test_instance_ids_have_no_gaps(folder: Path, tmp_path: Path) -> None:
    """Every single thing has one, from 1 up; the ground and its like have 0."""
    town = load_town(folder, cache_dir=tmp_path / "cache")
    found = np.unique(np.concatenate([chunk.instance for chunk in town.chunks]))
    assert (found == np.arange(len(found))).all()
    assert len(found) > 50


def test_any_map_without_a_toml_becomes_a_town(tmp_path: Path) -> None:
    """It gets a route of a kilometre, more than its streets are long; the South's three legs have lights."""
    town = load_town(VILLAGE, cache_dir=tmp_path)
    assert town.name == "village"
    assert town.route is not None
    assert 950.0 < town.route.length_m < 1050.0
    assert len(town.network.signals) == 3
    tags = np.concatenate([chunk.tag for chunk in town.chunks])
    assert {Tag.ROAD, Tag.SIDEWALK, Tag.BUILDING, Tag.TRAFFIC_LIGHT} <= {Tag(tag) for tag in np.unique(tags)}
