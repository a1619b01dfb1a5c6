"""Zones of maps that come without a `town.toml`."""

from dataclasses import replace
from pathlib import Path

import pytest
import shapely

from carlaloc_env.map.config import ZONE_KINDS, TownConfig
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.records import LaneRecord, LaneSection, SpeedRecord
from carlaloc_env.map.zones import choose_zones, road_kind
from carlaloc_env.scenery.ground.terrain import zone_areas

ROAD = """<road name="r" length="400" id="{id}" junction="-1"><link/>
<type s="0" type="{type}"><speed max="{limit}" unit="km/h"/></type>
<planView><geometry s="0" x="0" y="{y}" hdg="0" length="400"><line/></geometry></planView>
<lanes><laneSection s="0"><center><lane id="0" type="none" level="false"/></center>
<right>{lanes}</right></laneSection></lanes></road>"""
LANE = '<lane id="{id}" type="{type}" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
EXPECTED = (
    ("motorway", 120, 3, False, "highway"),
    ("town", 90, 2, True, "highway"),
    ("rural", 70, 2, False, "rural"),
    ("town", 60, 2, True, "rural"),
    ("town", 50, 6, True, "skyscraper"),
    ("town", 50, 4, True, "downtown"),
    ("town", 30, 2, True, "residential"),
    ("town", 50, 4, False, "industrial"),
    ("unknown", 50, 4, False, "industrial"),
    ("unknown", 70, 4, False, "highway"),
    ("rural", 60, 3, False, "highway"),
)
"""Type, limit [km/h], driving lanes, sidewalk, and the zone that such a road asks for."""


def _map(folder: Path, rows: tuple[tuple[str, int, int, bool, str], ...]) -> LaneNetwork:
    roads = []
    for number, (kind, limit, lanes, walk, _) in enumerate(rows):
        parts = [LANE.format(id=-k - 1, type="driving") for k in range(lanes)]
        parts += [LANE.format(id=-lanes - 1, type="sidewalk")] if walk else []
        roads.append(
            ROAD.format(id=number + 1, type=kind, limit=limit, y=400.0 * number, lanes="".join(parts))
        )
    path = folder / "map.xodr"
    path.write_text(
        '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="7"/>'
        + "".join(roads)
        + "</OpenDRIVE>"
    )
    return build_network(path)


@pytest.mark.parametrize("row", EXPECTED)
def test_a_road_asks_for_its_kind_of_zone(tmp_path: Path, row: tuple[str, int, int, bool, str]) -> None:
    assert road_kind(_map(tmp_path, (row,)).xodr.roads[0]) == row[4]


def test_every_road_lies_in_the_zone_that_it_asks_for(tmp_path: Path) -> None:
    """Straight roads 400 m apart: each is the nearest one to its own surroundings."""
    network = _map(tmp_path, EXPECTED)
    config = choose_zones(network, TownConfig())
    areas = zone_areas(config, shapely.box(-500.0, -500.0, 1000.0, 6000.0))
    for number, row in enumerate(EXPECTED):
        middle = shapely.Point(200.0, 400.0 * number)
        (kind,) = {kind for kind, area in areas if shapely.contains(area, middle)}
        assert kind == row[4]


def test_zones_do_not_overlap_and_cover_everything(tmp_path: Path) -> None:
    config = choose_zones(_map(tmp_path, EXPECTED), TownConfig())
    box = shapely.box(-100.0, -100.0, 500.0, 3000.0)
    areas = [area for _, area in zone_areas(config, box)]
    assert sum(area.area for area in areas) == pytest.approx(box.area)
    assert shapely.union_all(areas).area == pytest.approx(box.area)
    assert {config.default_zone, *(zone.kind for zone in config.zones)} <= set(ZONE_KINDS)


def test_unknown_limits_count_as_a_street(tmp_path: Path) -> None:
    road = _map(tmp_path, (("town", 50, 2, True, ""),)).xodr.roads[0]
    bare = replace(road, speeds=(), type="unknown")
    assert road_kind(bare) == "small_town"
    fast = replace(road, speeds=(SpeedRecord(s_m=0.0, limit_mps=10.0), SpeedRecord(s_m=9.0, limit_mps=30.0)))
    assert road_kind(fast) == "highway"
    empty = LaneSection(s_m=0.0, end_m=road.length_m, lanes=(LaneRecord(id=-1, type="sidewalk"),))
    assert road_kind(replace(bare, sections=(empty,))) == "small_town"


@pytest.mark.parametrize("stop", [False, True])
def test_silent_roads_are_told_by_their_lanes(tmp_path: Path, stop: bool) -> None:
    """Without type and limit, wide roads without sidewalks are motorways, and so are hard shoulders."""
    road = _map(tmp_path, (("unknown", 50, 2 if stop else 4, False, ""),)).xodr.roads[0]
    (section,) = road.sections
    silent = replace(road, type="unknown", speeds=())
    shoulder = (LaneRecord(id=-9, type="stop"),) if stop else ()
    assert (
        road_kind(replace(silent, sections=(replace(section, lanes=section.lanes + shoulder),))) == "highway"
    )
