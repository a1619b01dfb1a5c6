"""Towns on land whose heights a raster has: streets, junctions, bridges, ground and houses."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import Transformer
from shared_fixtures.worlds.imported_towns import made
from shared_fixtures.worlds.street_sketches import OXFORD, VIENNA, Sketch, bridge, village

from carlaloc_env.core.errors import CarlaLocError
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.openstreetmap.extract import read_extract
from carlaloc_env.openstreetmap.import_town import import_town
from carlaloc_env.scenery.buildings.footprints import Houses
from carlaloc_env.scenery.ground.ground_plan import Groundwork, lay_groundwork
from carlaloc_env.scenery.mapped import land_points, of_kind, read_mapped
from recorder.cli.main import main

BASE_M = 210.0
"""Height of the land at the origin [m]."""


def slope_and_hill(xy: np.ndarray) -> np.ndarray:
    """Heights of a plane of 5 % and a hill of 4 m on it, at points (..., 2) [m]."""
    x, y = xy[..., 0], xy[..., 1]
    hill = 4.0 * np.exp(-((x - 50.0) ** 2 + y**2) / (2.0 * 120.0**2))
    result: np.ndarray = BASE_M + 0.04 * x - 0.03 * y + hill - 4.0 * np.exp(-(50.0**2) / (2.0 * 120.0**2))
    return result


def raster(
    path: Path,
    sketch: Sketch,
    system: str,
    heights: Any = slope_and_hill,
    *,
    half_m: float = 900.0,
    east_m: float = 0.0,
    holes: float = 0.0,
    named: bool = True,
    declared: bool = True,
) -> Path:
    """A GeoTIFF of 6 m a cell round the middle of a sketch's streets, moved to the east."""
    rasterio = pytest.importorskip("rasterio")
    geo = read_extract(sketch.write(path.with_suffix(".osm"))).geo
    to_degrees = Transformer.from_crs(system, "EPSG:4326", always_xy=True)
    corners = geo.enu_to_geodetic([[east_m - half_m, half_m, 0.0], [east_m + half_m, -half_m, 0.0]])
    (x0, x1), (y0, y1) = to_degrees.transform(corners[:, 1], corners[:, 0], direction="INVERSE")
    count = int(half_m / 3.0)
    x = x0 + (x1 - x0) * (np.arange(count) + 0.5) / count
    y = y0 + (y1 - y0) * (np.arange(count) + 0.5) / count
    longitude, latitude = to_degrees.transform(*np.meshgrid(x, y))
    z = heights(geo.geodetic_to_enu(np.stack([latitude, longitude, 0.0 * latitude], axis=-1))[..., :2])
    z = np.where(np.random.default_rng(1).random(z.shape) < holes, -9999.0, z).astype(np.float32)
    place = rasterio.transform.from_bounds(x0, y1, x1, y0, count, count)
    with rasterio.open(
        path, "w", driver="GTiff", width=count, height=count, count=1, dtype="float32",
        crs=system if named else None, nodata=-9999.0 if declared else None, transform=place,
        compress="deflate", predictor=3,
    ) as file:  # fmt: skip
        file.write(z, 1)
    return path


def driven(network: LaneNetwork) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) on the middles of all driving lanes, every metre, and their grades (N,)."""
    points, grades = [], []
    for lane in network.lanes:
        if lane.type == "driving":
            s = np.linspace(0.0, lane.length_m, max(3, int(lane.length_m)))
            pose = network.exact_pose(np.full(len(s), lane.index), s)
            points.append(np.asarray(pose[0]))
            grades.append(np.asarray(pose[2]))
    return np.concatenate(points), np.concatenate(grades)


@pytest.mark.parametrize(
    ("system", "place"), [("EPSG:4326", VIENNA), ("EPSG:32633", VIENNA), ("EPSG:27700", OXFORD)]
)
def test_streets_follow_the_land(system: str, place: tuple[float, float], tmp_path: Path) -> None:
    """Degrees, UTM and a grid of a country; on the left, the world is mirrored while it is built.

    Streets are level across, so that a lane 3 m aside may lie 0.15 m off a cross slope of 5 %.
    """
    sketch = village(place)
    town, network = made(sketch, tmp_path, raster(tmp_path / "a.tif", sketch, system))
    points, grades = driven(network)
    off = np.abs(points[:, 2] + BASE_M - slope_and_hill(points[:, :2]))
    assert np.median(off) < 0.06
    assert off.max() < 0.25
    assert np.abs(grades).max() < 0.1
    assert np.ptp(points[:, 2]) > 8.0
    geo = TownConfig.from_toml(tmp_path / "town.toml").geo
    assert geo is not None
    assert geo.height_m == pytest.approx(BASE_M, abs=0.05)
    assert town.report["heights"]["filled_from_neighbours"] == 0.0


def test_bridges_on_a_slope_clear_the_street_below(tmp_path: Path) -> None:
    sketch = bridge()
    town, network = made(sketch, tmp_path, raster(tmp_path / "a.tif", sketch, "EPSG:32633"))
    points, grades = driven(network)
    at = points[np.hypot(*points[:, :2].T) < 4.0, 2]
    assert np.ptp(at) >= 5.0
    assert np.abs(grades).max() < 0.1
    assert [line for line in town.report["changed"] if "off the land" in line]


def test_streets_are_no_steeper_than_a_tenth_on_steep_land(tmp_path: Path) -> None:
    """A slope of 20 %: cuts and banks, reported; joints are those of flat towns."""
    sketch = village()
    path = raster(tmp_path / "a.tif", sketch, "EPSG:32633", lambda xy: 300.0 + 0.2 * xy[..., 0])
    town, network = made(sketch, tmp_path, path)
    points, grades = driven(network)
    assert np.abs(grades).max() < 0.11
    assert np.ptp(points[:, 2]) > 15.0
    assert [line for line in town.report["changed"] if "off the land" in line]


@pytest.mark.parametrize("declared", [True, False])
def test_cells_without_height_are_filled_from_their_neighbours(declared: bool, tmp_path: Path) -> None:
    sketch = village()
    path = raster(tmp_path / "a.tif", sketch, "EPSG:32633", holes=0.01, declared=declared)
    town, network = made(sketch, tmp_path, path)
    points, _ = driven(network)
    assert np.abs(points[:, 2] + BASE_M - slope_and_hill(points[:, :2])).max() < 0.6
    # Places in a hole; those beside it have heights of the other cells round them.
    assert 0.01 < town.report["heights"]["filled_from_neighbours"] < 0.08


def test_ground_and_houses_stand_on_the_land(tmp_path: Path) -> None:
    sketch = village()
    sketch.block(-90, 40, 30, 14)
    _, network = made(sketch, tmp_path, raster(tmp_path / "a.tif", sketch, "EPSG:4326"))
    config = TownConfig.from_toml(tmp_path / "town.toml")
    assert config.geo is not None
    features = read_mapped(tmp_path / "features.geojson", config.geo)
    work = lay_groundwork(network, config, land_points(features))
    low, high = np.reshape(work.bounds.bounds, (2, 2))
    xy = np.random.default_rng(0).uniform(low + 20.0, high - 20.0, (4000, 2))
    off = np.abs(work.ground.height(xy) + BASE_M - slope_and_hill(xy))
    apart = work.ground.edge.nearest(xy)[1]
    assert off[apart > 20.0].max() < 0.15
    pond = shapely.union_all([water.area for water in work.levels.waters])
    assert off[~shapely.dwithin(shapely.points(xy), pond, 20.0)].max() < 0.6
    check_houses(work, features)


def check_houses(work: Groundwork, features: list[Any]) -> None:
    """Floors lie with the highest ground, at most 1.5 m above the lowest; walls go down to it."""
    outlines = of_kind(features, "building")
    houses = Houses(outlines, work.zones, work.areas.roadway, work.areas.paved, work.ground, 1)
    assert len(houses.all) > 3
    for house in houses.all:
        corners = np.concatenate([np.asarray(part.exterior.coords) for part in house.whole.geoms])
        ground = work.ground.height(corners)
        assert house.base_m == pytest.approx(min(ground.max(), ground.min() + 1.5), abs=1e-3)
        assert house.base_m - house.foot_m == pytest.approx(ground.min(), abs=1e-3)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"east_m": 5000.0}, "has heights for 0 % of the streets"),
        ({"east_m": 880.0}, "give a raster that covers them all"),
        ({"named": False}, "names no reference system"),
    ],
)
def test_rasters_that_do_not_fit_give_one_line(how: dict[str, Any], words: str, tmp_path: Path) -> None:
    path = raster(tmp_path / "a.tif", village(), "EPSG:32633", **how)
    with pytest.raises(CarlaLocError, match=words) as error:
        import_town(tmp_path / "a.osm", heights=path)
    assert "\n" not in str(error.value)


def test_the_command_takes_a_raster(tmp_path: Path) -> None:
    path = raster(tmp_path / "a.tif", village(), "EPSG:32633")
    out = tmp_path / "town"
    command = ["maps", "import", str(tmp_path / "a.osm"), "--heights", str(path), "--out", str(out)]
    assert main([*command, "--no-preview"]) == 0
    assert json.loads((out / "report.json").read_text())["heights"]["raster"] == "a.tif"


def test_what_is_no_raster_gives_one_line(tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    (tmp_path / "a.tif").write_text(json.dumps({}))
    with pytest.raises(CarlaLocError, match="give a GeoTIFF of heights") as error:
        import_town(village().write(tmp_path / "a.osm"), heights=tmp_path / "a.tif")
    assert "\n" not in str(error.value)


def test_without_rasterio_the_error_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(CarlaLocError, match=r"pip install 'carlaloc\[heights\]'"):
        import_town(village().write(tmp_path / "a.osm"), heights=tmp_path / "a.tif")
