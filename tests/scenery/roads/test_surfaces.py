"""Kerbs drop at crosswalks; gravel bears no paint; wedges at exits are hatched."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.small_towns import STREET, build_small, cast, straight_road
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.core.areas import strip_polygon
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.lane_strips import Strip, road_strips
from carlaloc_env.scenery.roads.hatching import gore_bars


def test_kerbs_drop_at_crosswalks(tmp_path: Path) -> None:
    """Two centimetres are left before a crosswalk, a whole kerb two metres beside it, and no steps."""
    outline = "".join(
        f'<cornerLocal u="{u}" v="{v}" z="0"/>' for u, v in ((-2, -7), (2, -7), (2, 7), (-2, 7))
    )
    walk = (
        '<objects><object id="9" type="crosswalk" name="Crosswalk" s="40" t="0" zOffset="0" hdg="0" '
        f'orientation="none" length="4" width="14" height="0"><outline>{outline}</outline></object></objects>'
    )
    road = straight_road(1, (0.0, 0.0, 0.0), 80.0, ((0, 0.5, 0, 0, 0),), STREET).replace(
        "</road>", walk + "</road>"
    )
    built = build_small(tmp_path, [road], '[town]\ndefault_zone = "residential"\n')
    scene = built.scene(Tag.SIDEWALK)
    for side in (1.0, -1.0):
        x = np.arange(30.0, 50.01, 0.25)
        above = np.column_stack([x, np.full(len(x), side * 7.05), np.full(len(x), 3.0)])
        height = 2.5 - cast(scene, above, (0.0, 0.0, -1.0))
        beside = np.abs(x - 40.0)
        np.testing.assert_allclose(height[beside < 1.9], 0.02, atol=0.006)
        np.testing.assert_allclose(height[beside > 3.0], 0.15, atol=0.002)
        above[:, 1] = side * 8.6
        np.testing.assert_allclose(2.5 - cast(scene, above, (0.0, 0.0, -1.0)), 0.15, atol=0.002)


def test_gravel_is_drawn_and_bears_no_paint(tmp_path: Path) -> None:
    """Lanes whose material is gravel have no asphalt, and lines only where asphalt is."""
    material = '<material sOffset="0" surface="gravel" friction="0.5" roughness="0.05"/></lane>'
    mark = '<roadMark sOffset="0" type="solid" weight="standard" color="standard" width="0.12"/></lane>'
    lanes = (("driving", 3.5), ("shoulder", 0.6))
    roads = [
        straight_road(1, (0.0, 0.0, 0.0), 80.0, ((0, 0, 0, 0, 0),), lanes).replace("</lane>", mark),
        straight_road(2, (0.0, 40.0, 0.0), 80.0, ((0, 0, 0, 0, 0),), lanes).replace("</lane>", mark),
    ]
    roads[1] = roads[1].replace("</lane>", material).replace(mark, mark.replace("</lane>", "") + material)
    mesh = build_small(tmp_path, roads, '[town]\ndefault_zone = "rural"\n').mesh
    material_of, y = mesh.material[mesh.triangles[:, 0]], mesh.vertices_m[mesh.triangles[:, 0], 1]
    x = mesh.vertices_m[mesh.triangles[:, 0], 0]
    asphalt = np.isin(material_of, (Material.ASPHALT, Material.ASPHALT_OLD))
    track = (np.abs(y - 40.0) < 4.0) & (x > -1.0) & (x < 81.0)
    road = (np.abs(y) < 4.0) & (x > -1.0) & (x < 81.0)
    assert asphalt[road].any()
    assert not asphalt[track].any()
    assert (material_of[track] == Material.GRAVEL).sum() > 50
    paint = material_of == Material.ROAD_PAINT_WHITE
    assert paint[road].any()
    assert not paint[track].any()


@pytest.mark.parametrize(("name", "exits"), [("Town04", 8), ("Town06", 3)])
def test_wedges_at_exits_are_hatched_and_lanes_are_not(name: str, exits: int) -> None:
    network = town_network(name)
    strips = road_strips(network.xodr.roads, network.surface)
    driven = shapely.union_all([shapely.union_all(_driving(strip)) for strip in strips])
    found = gore_bars(strips, network.xodr.roads)
    assert len(found) >= exits
    for _, bars in found:
        assert bars.area > 3.0
        assert shapely.distance(bars, driven) > 0.05


def _driving(strip: Strip) -> list[shapely.Geometry]:
    return [
        strip_polygon(*strip.lane_edges(lane))
        for lane in range(len(strip.lanes))
        if strip.lanes[lane].type == "driving"
    ]
