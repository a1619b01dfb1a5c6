"""The sheet about a town: what it marks lies where the camera's geometry says."""

import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.assets.catalog import VEHICLES, WALKERS
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import from_rotation
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.standing_traffic import standing_traffic
from recorder.report.town_map import ROUTE, SPAWN, MapView

DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


def test_map_is_to_scale_with_north_up() -> None:
    """Looking straight down from 500 m, a metre on the ground is f/500 px, east right and north up."""
    camera = Pinhole(width_px=800, height_px=600, fx_px=900.0, fy_px=900.0, cx_px=399.5, cy_px=299.5)
    view = MapView(camera=camera, T_world_camera=from_rotation(DOWN, (10.0, 20.0, 500.0)))
    assert view.px_per_m(0.0) == pytest.approx(1.8)
    points = np.array([[10.0, 20.0, 0.0], [110.0, 20.0, 0.0], [10.0, 120.0, 0.0], [900.0, 20.0, 0.0]])
    (middle, east, north, _), inside = view.pixels(points)
    assert middle in ((399, 299), (400, 300), (400, 299), (399, 300))
    assert east[0] - middle[0] == pytest.approx(180, abs=1)
    assert middle[1] - north[1] == pytest.approx(180, abs=1)
    assert inside.tolist() == [True, True, True, False]


@pytest.mark.soak
def test_sheet_marks_route_and_spawn_points() -> None:
    need_opengl()
    from recorder.report.town_preview import STREET_PX, STREET_VIEWS, town_sheet

    town = load_town("Town03")
    sheet = town_sheet(town, quality="low")
    assert sheet.shape == (STREET_VIEWS * STREET_PX[1], 1360 + STREET_PX[0], 3)
    for colour in (ROUTE, SPAWN):
        assert np.all(sheet[200:, :1360] == colour, axis=-1).sum() > 200
    views = sheet[:, 1360:].reshape(STREET_VIEWS, STREET_PX[1], STREET_PX[0], 3)
    assert views.std(axis=(1, 2)).min() > 15.0


@pytest.mark.soak
def test_standing_traffic_stands_on_its_lanes() -> None:
    network = load_town("Town03").network
    catalog, frame = standing_traffic(network, 50)
    vehicles = np.array([name in VEHICLES for name in catalog.model])
    assert vehicles.sum() == 50
    assert all(name in WALKERS for name in np.array(catalog.model)[~vehicles])
    for who, types in ((vehicles, ("driving",)), (~vehicles, ("sidewalk",))):
        found = network.nearest(frame.position_m[who].astype(np.float64), types)
        assert np.abs(found.offset_m).max() < 0.1
