"""Parts of extracts: what crosses the box, regions that are too large, seas and open waters."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.street_sketches import OXFORD, VIENNA, Sketch, village

from carlaloc_env.core.errors import MapError
from carlaloc_env.map.config import TownConfig
from carlaloc_env.openstreetmap.extract import Box, Extract, read_extract
from carlaloc_env.openstreetmap.import_town import import_town
from carlaloc_env.openstreetmap.read_features import read_features
from carlaloc_env.openstreetmap.shores import FAR_M
from recorder.cli.main import main

BAY = [(20, -200), (20, -40), (180, -40), (180, -200)]
"""Where the coast of `bay` leads into the village."""
MIDDLE = np.array([10.0, 15.0])
"""Middle of the village's streets, which is the world's origin."""


def box_of(sketch: Sketch, west: float, south: float, east: float, north: float) -> Box:
    """The box round a rectangle in metres."""
    low, high = sketch.geo.enu_to_geodetic([[west, south, 0.0], [east, north, 0.0]])
    return float(low[1]), float(low[0]), float(high[1]), float(high[0])


def streets_m(extract: Extract) -> float:
    return sum(
        float(np.hypot(*np.diff(extract.line(way.nodes), axis=0).T).sum())
        for way in extract.ways.values()
        if "highway" in way.tags
    )


def bay(place: tuple[float, float] = VIENNA, reach_m: float = 4000.0, *, turned: bool = False) -> Sketch:
    """The village at a sea with a square bay; a coast has the land on its left."""
    sketch = village(place)
    coast = [(-reach_m, -200), *BAY, (reach_m, -200)]
    sketch.way(*(coast[::-1] if turned else coast), natural="coastline")
    return sketch


def frame() -> shapely.Polygon:
    """The village's streets and what is seen round them, in its own metres."""
    return shapely.box(-200 - FAR_M, -150 - FAR_M, 220 + FAR_M, 180 + FAR_M)


def sea() -> shapely.Polygon:
    west, south, east, _ = frame().bounds
    return shapely.union(shapely.box(west, south, east, -200), shapely.Polygon(BAY))


def waters(sketch: Sketch, folder: Path, box: Box | None = None) -> shapely.Geometry:
    """All waters but the pond, in the sketch's metres."""
    features = read_features(read_extract(sketch.write(folder / "a.osm"), box)).of("water")
    shapes = [feature.shape for feature in features if not feature.id.startswith("way/")]
    return shapely.transform(shapely.union_all(shapes), lambda xy: xy + MIDDLE)


def alike(a: shapely.Geometry, b: shapely.Geometry) -> bool:
    """To 10 cm along their border."""
    return bool(shapely.symmetric_difference(a, b).area < 0.1 * shapely.length(b))


def test_streets_that_cross_a_box_without_a_node_in_it_are_cut(tmp_path: Path) -> None:
    sketch = village()
    box = box_of(sketch, -150, -100, -80, 100)
    assert streets_m(read_extract(sketch.write(tmp_path / "a.osm"), box)) == pytest.approx(70.0, abs=0.1)


def test_long_lines_across_a_box_do_not_widen_it(tmp_path: Path) -> None:
    """A power line of 120 km, and a wood whose outline lies in the box with one of its ways alone."""
    sketch = village()
    sketch.way((-60e3, 30), (60e3, 30), power="line")
    outline = [sketch.way((-30, -30), (-30, 2000)), sketch.way((-30, 2000), (2000, 2000), (-30, -30))]
    sketch.relation(*(("w", way, "outer") for way in outline), type="multipolygon", natural="wood")
    path = sketch.write(tmp_path / "a.osm")
    extract = read_extract(path, box_of(sketch, -120, -100, 100, 20))
    (wood,) = read_features(extract).of("wood")
    assert wood.shape.area == pytest.approx(2030 * 2030 / 2, rel=1e-3)
    with pytest.raises(
        MapError, match="no street for cars in the box; give one with streets such as"
    ) as error:
        read_extract(path, box_of(sketch, 700, -10, 900, 60))
    assert streets_m(read_extract(path, proposed(error.value))) > 500.0


def proposed(error: MapError) -> Box:
    """The box that a message proposes."""
    match = re.search(r"--bbox ([-\d.,]+)", str(error))
    assert match
    west, south, east, north = map(float, match[1].split(","))
    return west, south, east, north


def test_a_region_that_is_too_large_is_refused_with_a_box_that_would_do(tmp_path: Path) -> None:
    """Forty streets of 6 km; six more lie between them in one place, in which the box lies."""
    sketch = Sketch()
    for k in range(20):
        sketch.way(*((300 * k, 300 * n) for n in range(20)), highway="residential")
        sketch.way(*((300 * n, 300 * k) for n in range(20)), highway="residential")
    for k in range(6):
        sketch.way(*((3030 + 30 * k, 4000 + 30 * n) for n in range(30)), highway="residential")
    path = sketch.write(tmp_path / "a.osm")
    with pytest.raises(MapError, match=r"233 km of streets .* 100 km go at once") as error:
        import_town(path)
    extract = read_extract(path, proposed(error.value))
    assert streets_m(extract) < 50e3
    nodes = [sketch.nodes[3030 + 30 * k, 4000 + 30 * n] for k in range(6) for n in range(30)]
    assert np.isin(nodes, list(extract.degrees)).mean() > 0.9


@pytest.mark.parametrize("reach_m", [4000.0, 700.0])
def test_the_sea_lies_on_the_right_of_its_coast(reach_m: float, tmp_path: Path) -> None:
    """Also where the coast ends at the border of the file: it goes on to the nearest side."""
    assert alike(waters(bay(reach_m=reach_m), tmp_path), sea())
    assert alike(waters(bay(reach_m=reach_m, turned=True), tmp_path), shapely.difference(frame(), sea()))


def test_islands_and_their_streets_stay_dry(tmp_path: Path) -> None:
    sketch = bay()
    island = [(60, -160), (140, -160), (140, -80), (60, -80), (60, -160)]
    sketch.way(*island, natural="coastline")
    assert alike(waters(sketch, tmp_path), shapely.difference(sea(), shapely.Polygon(island)))


def test_a_coast_that_leaves_the_box_stays_a_coast(tmp_path: Path) -> None:
    sketch = bay(reach_m=1500.0)
    box = box_of(sketch, -201, -151, 221, 181)
    assert alike(waters(sketch, tmp_path, box), sea())


def test_a_river_whose_ends_are_not_in_the_file_is_no_meadow(tmp_path: Path) -> None:
    """Two banks and an island of a relation, of which the third way is missing."""
    sketch = village()
    banks = [sketch.way((x, y), (-x, y)) for x, y in ((4000, -300), (-4000, -400))]
    island = sketch.way((0, -380), (40, -380), (40, -340), (0, -340), (0, -380))
    members = [
        ("w", banks[0], "outer"),
        ("w", banks[1], "outer"),
        ("w", 999, "outer"),
        ("w", island, "inner"),
    ]
    sketch.relation(*members, type="multipolygon", natural="water")
    west, _, east, _ = frame().bounds
    river = shapely.difference(shapely.box(west, -400, east, -300), shapely.box(0, -380, 40, -340))
    assert alike(waters(sketch, tmp_path), river)


@pytest.mark.parametrize("place", [VIENNA, OXFORD])
def test_a_bay_becomes_zones_of_water_round_its_island(place: tuple[float, float], tmp_path: Path) -> None:
    sketch = bay(place)
    sketch.way((60, -160), (140, -160), (140, -80), (60, -80), (60, -160), natural="coastline")
    (tmp_path / "town.toml").write_text(import_town(sketch.write(tmp_path / "a.osm")).toml)
    zones = TownConfig.from_toml(tmp_path / "town.toml").zones
    wet = shapely.union_all([shapely.Polygon(zone.polygon) for zone in zones if zone.kind == "water"])

    def is_wet(x: float, y: float) -> bool:
        return bool(shapely.contains_xy(wet, x - MIDDLE[0], y - MIDDLE[1]))

    assert all(is_wet(*at) for at in ((40, -60), (100, -60), (160, -180), (100, -260), (-900, -1500)))
    assert not any(is_wet(*at) for at in ((100, -120), (70, -90), (0, -100), (-100, -100), (100, -20)))


def test_the_default_route_passes_houses(tmp_path: Path) -> None:
    """Of two blocks of streets only the smaller one has houses."""
    sketch = Sketch()
    for low, high, step in ((-900, 0, 300), (0, 400, 200)):
        lines = range(low, high + 1, step)
        for at in lines:
            sketch.way(*((at, y - low) for y in lines), highway="residential")
            sketch.way(*((x, at - low) for x in lines), highway="residential")
    for k in range(20):
        for y in (12, 212, 412):
            sketch.block(10 + 20 * k, y, 12, 10)
    town = import_town(sketch.write(tmp_path / "a.osm"))
    (tmp_path / "town.toml").write_text(town.toml)
    route = TownConfig.from_toml(tmp_path / "town.toml").route
    extract = read_extract(tmp_path / "a.osm")
    west = extract.xy_m[sketch.nodes[0, 0]][0]
    assert route is not None
    assert min(x for x, _ in route.points) > west - 30.0


def test_an_import_shows_its_steps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = village().write(tmp_path / "a.osm")
    assert main(["maps", "import", str(path), "--out", str(tmp_path / "town"), "--no-preview"]) == 0
    steps = re.findall(r"^import: (\d) of 4, (.+)$", capsys.readouterr().err, re.MULTILINE)
    assert [int(number) for number, _ in steps] == [1, 2, 3, 4]
