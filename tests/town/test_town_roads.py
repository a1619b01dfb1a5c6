"""Roads that come from the cache are those that are made anew of the map, to the last bit."""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.worlds.equality import assert_same
from shared_fixtures.worlds.small_towns import KERBSIDE, MOTORWAY, climb, straight_road

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.files.array_files import load, save
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.opendrive.records import OpenDrive
from carlaloc_env.map.roads import TownRoads, build_roads
from carlaloc_env.map.sources import find_town
from carlaloc_env.town.build import load_town

SEED = 20
HEAD = '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="7" name="small"/>'
SMALL = {
    "street": straight_road(1, (0.0, 0.0, 0.3), 120.0, (climb(0, 0, 3, 120),), KERBSIDE),
    "motorway": straight_road(1, (-200.0, 0.0, 0.0), 400.0, ((0, 0, 0, 0, 0),), MOTORWAY, kmh=120),
}
NAMES = ("lanes", "signals", "static_signs", "crosswalks", "tables", "bank", "forward", "start_s_m")


def made(name: str, roughness: float | None = None) -> tuple[TownRoads, OpenDrive]:
    """Roads of a packaged town or of a small map, made anew, and their map."""
    if name in SMALL:
        xodr = read_opendrive(f"{HEAD}{SMALL[name]}</OpenDRIVE>".encode())
        config = TownConfig(name=name, road_roughness=1.0 if roughness is None else roughness)
        return build_roads(xodr, config, SEED), xodr
    source = find_town(name)
    xodr = read_opendrive(source)
    return build_roads(xodr, TownConfig.from_toml(source.with_name("town.toml")), SEED), xodr


def kept(roads: TownRoads, xodr: OpenDrive | None, file: Path) -> TownRoads:
    """The same roads through a file; without a map, nobody may ask for it."""

    def read() -> OpenDrive:
        assert xodr is not None, "the map was read"
        return xodr

    save(file, roads.to_arrays())
    arrays = load(file)
    assert arrays is not None
    return TownRoads.from_arrays(arrays, read, SEED)


@pytest.mark.parametrize(
    ("name", "roughness"), [("Town03", None), *((name, None) for name in SMALL), ("street", 0.0)]
)
def test_kept_roads_are_those_made_anew(name: str, roughness: float | None, tmp_path: Path) -> None:
    """Neither asks for the map but for the relief under its surfaces, which is drawn again."""
    anew, xodr = made(name, roughness)
    again = kept(anew, None, tmp_path / "roads.lanes")
    for part in NAMES:
        assert_same(getattr(again.network, part), getattr(anew.network, part), part)
    assert_same(again.route, anew.route, "route")
    assert_same(again.geo, anew.geo, "geo")
    assert_same(again.levels and again.levels.table, anew.levels and anew.levels.table, "levels")
    assert (anew.levels is None) == (roughness == 0.0)
    assert again.network.sidewalks == anew.network.sidewalks
    again = kept(anew, xodr, tmp_path / "roads.lanes")
    lanes = np.repeat(np.arange(len(anew.network.lanes)), 3)
    station = anew.network.tables.length_m[lanes] * np.tile([0.1, 0.5, 0.9], len(anew.network.lanes))
    assert_same(again.network.exact_pose(lanes, station), anew.network.exact_pose(lanes, station))
    assert again.network.road_index == anew.network.road_index
    assert again.network.broken_links == anew.network.broken_links


def test_kept_roads_know_their_projection(tmp_path: Path) -> None:
    reference = "<geoReference>EPSG:32632</geoReference><offset x='691000' y='5336000' z='520' hdg='0.1'/>"
    head = HEAD.replace("/>", f">{reference}</header>")
    xodr = read_opendrive(f"{head}{SMALL['street']}</OpenDRIVE>".encode())
    anew = build_roads(xodr, TownConfig(), SEED)
    again = kept(anew, None, tmp_path / "roads.lanes")
    assert again.geo == anew.geo == xodr.geo
    point = [[10.0, 20.0, 3.0]]
    assert np.array_equal(again.geo.enu_to_geodetic(point), anew.geo.enu_to_geodetic(point))
    assert again.geo.enu_to_geodetic(point)[0, 2] == 523.0


def test_a_map_that_changed_after_loading_is_not_taken_for_the_old_one(tmp_path: Path) -> None:
    """What the cache gave back belongs to the old map."""
    folder = tmp_path / "small"
    folder.mkdir()
    (folder / "town.toml").write_text("[town]\n")
    (folder / "town.xodr").write_text(f"{HEAD}{SMALL['street']}</OpenDRIVE>")
    load_town(folder, cache_dir=tmp_path / "cache")
    town = load_town(folder, cache_dir=tmp_path / "cache")
    assert len(town.network.xodr.roads) == 1
    town = load_town(folder, cache_dir=tmp_path / "cache")
    (folder / "town.xodr").write_text(f"{HEAD}{SMALL['motorway']}</OpenDRIVE>")
    with pytest.raises(MapError, match="has changed since the town was loaded; load it again"):
        _ = town.network.surface
