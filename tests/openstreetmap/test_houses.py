"""Houses where they stand: heights, outlines, courtyards, passages, parts, roofs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.street_sketches import Sketch, village

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.openstreetmap.extract import read_extract
from carlaloc_env.openstreetmap.features import geojson
from carlaloc_env.openstreetmap.houses import colour
from carlaloc_env.openstreetmap.import_town import import_town, write_town
from carlaloc_env.openstreetmap.read_features import read_features
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.buildings.footprint_roofs import (
    BOARD_M,
    EAVES_M,
    add_footprint_roof,
    downhill,
    roof_rise,
)
from carlaloc_env.scenery.buildings.footprints import Houses
from carlaloc_env.scenery.buildings.shell import Appearance, Shell
from carlaloc_env.scenery.buildings.styles import STYLES
from carlaloc_env.scenery.ground.terrain import Zones
from carlaloc_env.scenery.mapped import MappedFeature, read_mapped
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import InstanceIds
from carlaloc_env.town.build import load_town

FLAT = type("Flat", (), {"height": staticmethod(lambda xy: np.zeros(len(xy))), "sloping": False})()
DOWNTOWN = Zones([("downtown", shapely.box(-500, -500, 500, 500))])
NOTHING = shapely.Polygon()


def house(
    outline: shapely.Polygon, number: int = 1, kind: str = "building", **known: object
) -> MappedFeature:
    properties = {"height_m": 10.0, "levels": 3, "roof": "flat", **known}
    return MappedFeature(kind=kind, id=f"way/{number}", shape=outline, properties=properties)


def houses(*features: MappedFeature, roadway: shapely.Polygon = NOTHING) -> Houses:
    return Houses(features, DOWNTOWN, roadway, roadway, FLAT, 7)


def upright_outline(mesh: Mesh, z: float) -> shapely.Polygon:
    """Area that the walls of a mesh enclose at a height, by its triangles that cross it."""
    corners = mesh.vertices_m[mesh.triangles].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    steep = np.abs(normals[:, 2]) < 1e-3 * np.linalg.norm(normals, axis=1)
    across = (corners[:, :, 2].min(axis=1) < z) & (corners[:, :, 2].max(axis=1) > z) & steep
    lines = []
    for triangle in corners[across]:
        points = []
        for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
            if (a[2] - z) * (b[2] - z) < 0:
                points.append((a + (b - a) * (z - a[2]) / (b[2] - a[2]))[:2].round(2))
        if len(points) == 2:
            lines.append(shapely.LineString(points))
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(lines, grid_size=0.02)]))
    return shapely.union_all(faces)


def overlap(a: shapely.Polygon, b: shapely.Polygon) -> float:
    return a.intersection(b).area / a.union(b).area


COURTYARD = shapely.Polygon([(0, 0), (40, 0), (40, 30), (0, 30)], [[(12, 10), (12, 20), (28, 20), (28, 10)]])
ANGLED = shapely.Polygon([(0, 0), (22, 0), (22, 9), (9, 14), (9, 25), (0, 25)])


@pytest.mark.parametrize("outline", [COURTYARD, ANGLED])
def test_walls_stand_on_their_outline(outline: shapely.Polygon) -> None:
    """With the courtyard: the walls below the windows, where nothing is recessed, enclose it."""
    (mesh,) = houses(house(outline)).meshes(InstanceIds())
    enclosed = shapely.union_all([shapely.Polygon(outline.exterior)])
    assert overlap(upright_outline(mesh, 9.9), enclosed) > 0.95
    assert mesh.vertices_m[:, 2].max() == pytest.approx(10.6, abs=0.05)  # the parapet


def test_houses_are_cut_where_a_carriageway_clips_them() -> None:
    found = houses(house(shapely.box(0, 0, 20, 10)), roadway=shapely.box(-50, 9.5, 50, 20))
    (footprint,) = found.footprints()
    assert footprint.intersection(shapely.box(-50, 9.5, 50, 20)).area == 0.0
    assert overlap(footprint, shapely.box(0, 0, 20, 10)) > 0.92


def test_no_house_keeps_a_sliver_on_a_carriageway() -> None:
    """A corner of a few square centimetres, too."""
    corner = shapely.Polygon([(-50, 11), (50, 9.995), (50, 30), (-50, 30)])
    (footprint,) = houses(house(shapely.box(0, 0, 50, 10)), roadway=corner).footprints()
    assert 0.0 < shapely.box(0, 0, 50, 10).intersection(corner).area < 0.02
    assert footprint.intersection(corner).area == 0.0


def test_more_houses_than_go_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("carlaloc_env.openstreetmap.import_town.MOST_BUILDINGS", 15)
    path = village().write(tmp_path / "a.osm")
    with pytest.raises(MapError, match="16 houses; 15 go at once: cut it by --bbox"):
        import_town(path)


def test_a_street_through_a_house_gets_a_passage() -> None:
    road = shapely.box(8, -50, 13, 60)
    found = houses(house(shapely.box(0, 0, 20, 10), height_m=14.0, levels=4), roadway=road)
    (one,) = found.all
    assert one.open_m > 4.5
    assert one.ground.intersection(road).area == 0.0
    assert one.whole.equals(shapely.MultiPolygon([shapely.box(0, 0, 20, 10)]))
    low = [quad for quad in found.boxes() if quad[:, 2].min() < 1.0]
    inside = [quad for quad in low if 8.3 < quad[:, 0].mean() < 12.7 and quad[:, 0].std() < 2.0]
    assert not inside, "nothing to hit in the passage"


def test_a_house_on_a_street_altogether_is_left_out() -> None:
    found = houses(house(shapely.box(0, 0, 3, 3), height_m=3.0), roadway=shapely.box(-9, -9, 9, 9))
    assert found.left_out == ["way/1"]
    assert not found.all


def test_a_wall_between_two_houses_is_built_above_the_lower_one_only() -> None:
    """The taller house has all its other walls; the wall of the lower one is not seen."""
    tall, low = (
        house(shapely.box(0, 0, 10, 10), 1, height_m=15.0, levels=5),
        house(shapely.box(10, 0, 20, 10), 2),
    )
    first, second = houses(tall, low).meshes(InstanceIds())
    shared = [np.abs(m.vertices_m[m.triangles].mean(axis=1)[:, 0] - 10.0) < 0.05 for m in (first, second)]
    heights = first.vertices_m[first.triangles].mean(axis=1)[shared[0], 2]
    assert heights[heights > 0].min() > 9.0
    second_heights = second.vertices_m[second.triangles].mean(axis=1)[shared[1], 2]
    assert ((second_heights < 0.5) | (second_heights > 9.0)).all()


def test_parts_stand_on_the_house_below(tmp_path: Path) -> None:
    sketch = village()
    sketch.block(-40, 40, 30, 30, building="yes", height="30")
    sketch.block(-40, 40, 30, 28, building__part="yes", height="12")
    sketch.block(-30, 50, 8, 8, building__part="yes", height="30", min_height="12", roof__shape="pyramidal")
    found = read_features(read_extract(sketch.write(tmp_path / "a.osm")))
    outline = max(found.of("building"), key=lambda f: f.shape.area)
    assert outline.properties["height_m"] == 12.0
    tower = next(f for f in found.of("part") if "min_height_m" in f.properties)
    assert tower.properties["min_height_m"] == 12.0


def test_heights_are_tagged_or_those_of_neighbours(tmp_path: Path) -> None:
    sketch = Sketch()
    sketch.way((-200, 0), (200, 0), highway="residential")
    sketch.block(0, 20, 12, 12, building="yes", building__levels="4")
    sketch.block(14, 20, 12, 12, building="yes", height="16 m")
    sketch.block(28, 20, 12, 12, building="yes")
    sketch.block(42, 20, 5, 5, building="yes")
    sketch.block(50, 20, 12, 12, building="yes", building__levels="900")
    sketch.block(70, 20, 12, 12, building="yes", location="underground")
    sketch.block(90, 20, 12, 12, building="roof")
    found = read_features(read_extract(sketch.write(tmp_path / "a.osm")))
    known = {f.id: f.properties for f in found.of("building")}
    levels = [p["levels"] for p in known.values()]
    assert levels == [4, 5, 5, 1, 5]
    assert [bool(p.get("guessed")) for p in known.values()] == [False, False, True, True, True]
    assert sorted(found.left_out.values()) == ["a roof, which has no walls", "below the ground"]


def test_multipolygons_have_courtyards(tmp_path: Path) -> None:
    sketch = Sketch()
    sketch.way((-200, 0), (200, 0), highway="residential")
    outer = sketch.block(0, 20, 40, 30, note="outer")
    inner = sketch.block(10, 28, 20, 14, note="inner")
    sketch.relation(("way", outer, "outer"), ("way", inner, "inner"), type="multipolygon", building="yes")
    (building,) = read_features(read_extract(sketch.write(tmp_path / "a.osm"))).of("building")
    assert building.shape.area == pytest.approx(40 * 30 - 20 * 14, rel=1e-3)


def test_features_keep_their_place_in_the_file(tmp_path: Path) -> None:
    """From the world to degrees and back: to 2 mm."""
    extract = read_extract(village().write(tmp_path / "a.osm"))
    found = read_features(extract).all
    (tmp_path / "features.geojson").write_text(geojson(found, extract))
    back = read_mapped(tmp_path / "features.geojson", extract.geo)
    assert [f.id for f in back] == [f.id for f in found]
    for a, b in zip(found, back, strict=True):
        gap = shapely.get_coordinates(a.shape) - shapely.get_coordinates(b.shape)
        assert np.abs(gap).max() < 2e-3
    entry = json.loads((tmp_path / "features.geojson").read_text())["features"][0]
    lon, lat = entry["geometry"]["coordinates"][0][0]
    assert (round(lon, 1), round(lat, 1)) == (16.4, 48.2)


@pytest.mark.parametrize("text", ["{", "{}", '{"features": [{"properties": {}, "geometry": null}]}'])
def test_a_bad_file_of_features_gives_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "features.geojson").write_text(text)
    with pytest.raises(MapError, match="import the town again"):
        read_mapped(tmp_path / "features.geojson", GeoReference(latitude_deg=0.0, longitude_deg=0.0))


def roofed(outline: shapely.Polygon, shape: str) -> Mesh:
    style = STYLES["house"]
    look = Appearance(style=style, material=style.walls[0][0], tint=(9, 9, 9), trim=(9, 9, 9), sign=(9, 9, 9))
    shell = Shell(out=MeshBuilder(), look=look)
    rise, south = roof_rise(outline, shape, 0.0), downhill(outline, 180.0)
    add_footprint_roof(shell, outline, 10.0, shape, rise, np.random.default_rng(1), south)
    return shell.out.build()


@pytest.mark.parametrize("outline", [COURTYARD, ANGLED, shapely.box(0, 0, 20, 10)])
@pytest.mark.parametrize("shape", ["flat", "hip", "gable", "pyramidal", "dome", "skillion"])
def test_roofs_cover_their_outline(outline: shapely.Polygon, shape: str) -> None:
    """Seen from above, the faces that look up cover the outline, and nothing rises above the ridge."""
    mesh = roofed(outline, shape)
    corners = mesh.vertices_m[mesh.triangles].astype(float)
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 1e-6
    cover = shapely.union_all(shapely.polygons(corners[up][:, :, :2]), grid_size=1e-3)
    assert outline.difference(shapely.buffer(cover, 0.02)).area < 0.02 * outline.area
    assert mesh.vertices_m[:, 2].max() <= 10.0 + max(roof_rise(outline, shape, 0.0), 0.6) + 1.5


def test_a_hip_rises_as_far_from_every_edge() -> None:
    """On a square it is a pyramid: its height is the slope times half the side, the eaves included."""
    mesh = roofed(shapely.box(0, 0, 10, 10), "hip")
    assert mesh.vertices_m[:, 2].max() == pytest.approx(10.0 + 5.0 * 0.65, abs=0.15)


@pytest.mark.parametrize("outline", [COURTYARD, ANGLED, shapely.box(0, 0, 20, 10)])
def test_a_roof_of_one_slope_is_closed(outline: shapely.Polygon) -> None:
    """Its faces sum up to the outline seen from above; they enclose a prism under a plane, and the eaves."""
    rise = roof_rise(outline, "skillion", 0.0)
    mesh = roofed(outline, "skillion")
    a, b, c = (mesh.vertices_m[corner].astype(float) - (0.0, 0.0, 10.0) for corner in mesh.triangles.T)
    assert np.sum(np.cross(b - a, c - a) / 2, axis=0) == pytest.approx([0, 0, outline.area], abs=1e-3)
    depth, middle = outline.bounds[3] - outline.bounds[1], outline.centroid.y - outline.bounds[1]
    ring = outline.buffer(EAVES_M, join_style="mitre").area - outline.area
    volume = float(np.sum(a * np.cross(b, c)) / 6)
    boards = BOARD_M * (outline.area + ring)
    assert volume == pytest.approx(outline.area * rise * middle / depth + boards, rel=1e-4)


@pytest.mark.parametrize(
    ("direction", "fall"), [("S", (0, -1)), ("90", (1, 0)), ("WSW", (-0.924, -0.383)), ("up", (0, -1))]
)
def test_a_roof_of_one_slope_falls_as_tagged(
    direction: str, fall: tuple[float, float], tmp_path: Path
) -> None:
    """Else off the longest wall; its top is the house's height, its foot lower by depth and angle."""
    sketch = Sketch()
    tags = {"roof:shape": "skillion", "roof:direction": direction, "roof:angle": "15", "height": "9"}
    sketch.block(0, 0, 20, 10, building="yes", **tags)
    (feature,) = read_features(read_extract(sketch.write(tmp_path / "a.osm"))).of("building")
    built = houses(
        MappedFeature(kind="building", id="way/1", shape=feature.shape, properties=feature.properties)
    )
    (mesh,) = built.meshes(InstanceIds())
    down = mesh.vertices_m[:, :2] @ np.array(fall)
    depth = float(np.ptp(shapely.get_coordinates(feature.shape) @ np.array(fall)))
    high, foot = down < down.min() + 0.01, down > down.max() - 0.01
    grade = np.tan(np.radians(15.0))
    assert mesh.vertices_m[high, 2].max() == pytest.approx(9.0 + EAVES_M * grade + BOARD_M, abs=0.05)
    lowest = max(9.0 - depth * grade, 0.4 * 9.0)
    assert mesh.vertices_m[foot, 2].max() == pytest.approx(lowest - EAVES_M * grade + BOARD_M, abs=0.05)


def test_colours() -> None:
    assert colour("#AABBCC") == "aabbcc"
    assert colour("Light Grey") is None or colour("lightgrey") == "c4c4c0"
    assert colour("as the neighbour") is None


@pytest.mark.long
def test_a_village_is_built_with_its_houses(tmp_path: Path) -> None:
    """It loads as any town does; GNSS finds a drawn node; other features make another town."""
    sketch = village()
    town = import_town(sketch.write(tmp_path / "a.osm"))
    write_town(town, tmp_path / "village")
    built = load_town(tmp_path / "village" / "town.xodr", cache_dir=tmp_path / "cache")
    assert len(built.chunks) > 0
    assert built.roads.route is not None
    extract = read_extract(tmp_path / "a.osm")
    number = sketch.nodes[0, 0]
    lat, lon, _ = built.roads.geo.enu_to_geodetic([*extract.xy_m[number], 0.0])
    metre = 1 / 111_000
    assert abs(lon - sketch.degrees[number][0]) < 0.1 * metre
    assert abs(lat - sketch.degrees[number][1]) < 0.1 * metre
    file = tmp_path / "village" / "features.geojson"
    file.write_text(file.read_text().replace('"levels": 2', '"levels": 3'))
    assert load_town(tmp_path / "village" / "town.xodr", cache_dir=tmp_path / "cache").town_hash


def test_a_house_outside_every_zone_has_a_style() -> None:
    """Beside the ground on which the streets lie."""
    far = shapely.transform(ANGLED, lambda xy: xy + 900.0)
    (made,) = houses(house(far)).all
    assert made.top_m > 2.0
