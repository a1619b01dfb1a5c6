"""Reflections by walls: detours, places and losses by mirror geometry; blocked ones; movers."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.raw_gnss import MOUNT, OFF, config, measured

from carlaloc_env.samples.gnss_signals import BLOCKED, IN_SIGHT, REFLECTED
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.raw_gnss.reception import ANTENNA_DB, receive, reflection_db

ANTENNA_M = np.array(MOUNT.position_m)


def towards(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    azimuth, up = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.sin(azimuth) * np.cos(up), np.cos(azimuth) * np.cos(up), np.sin(up)])


def ways(scenery: Any, meshes: list[Any], to: np.ndarray) -> Any:
    drive = scenery.drive(scenery.straight(0.0), 1.0)
    return receive(scenery.world(meshes).rays(), drive, 0, ANTENNA_M, np.atleast_2d(to))


def test_a_wall_opposite_reflects_what_a_wall_hides(scenery: Any) -> None:
    """2·D·cos(el)·cos(angle to the normal), at the mirror's point; D is 8 m."""
    south, north = scenery.box([-300, -16, 0], [300, -6, 20]), scenery.box([-300, 8.1, 0], [300, 18, 40])
    for azimuth, up in ((180.0, 42.0), (205.0, 50.0), (150.0, 40.0)):
        to = towards(azimuth, up)
        got = ways(scenery, [south, north], to)
        assert got.state.tolist() == [REFLECTED]
        distance = 8.1 - ANTENNA_M[1]
        extra = 2 * distance * np.cos(np.radians(up)) * np.cos(np.radians(azimuth - 180))
        assert got.extra_m[0] == pytest.approx(extra, abs=1e-4)
        image = np.array([ANTENNA_M[0], 2 * 8.1 - ANTENNA_M[1], ANTENNA_M[2]])
        expected = image + to * (8.1 - image[1]) / to[1]
        assert got.wall_m[0] == pytest.approx(expected, abs=1e-3)
        assert got.normal[0] == pytest.approx([0, -1, 0], abs=1e-6)
        assert got.wall_tag.tolist() == [Tag.BUILDING]
        assert got.loss_db[0] == pytest.approx(
            reflection_db(np.array([Material.CONCRETE]), np.array([-to[1]]))[0], rel=1e-6
        )


def test_what_no_mirror_shows_is_blocked_and_what_is_free_is_in_sight(scenery: Any) -> None:
    """A low wall, a mirrored ray that the hiding wall stops, and no wall at all opposite."""
    south, to = scenery.box([-300, -16, 0], [300, -6, 20]), towards(180.0, 42.0)
    assert ways(scenery, [south], to).state.tolist() == [BLOCKED]
    low = scenery.box([-300, 8, 0], [300, 18, 5])
    assert ways(scenery, [south, low], to).state.tolist() == [BLOCKED]
    tall, north = scenery.box([-300, -16, 0], [300, -6, 90]), scenery.box([-300, 8, 0], [300, 18, 90])
    assert ways(scenery, [tall, north], to).state.tolist() == [BLOCKED]
    free = ways(scenery, [south, north], towards(180.0, 80.0))
    assert free.state.tolist() == [IN_SIGHT]
    assert free.extra_m.tolist() == [0.0]
    assert np.isnan(free.wall_m).all()


def test_leaves_dim_and_do_not_reflect(scenery: Any) -> None:
    leaves = scenery.box([-300, -16, 0], [300, -6, 20], tag=Tag.VEGETATION)
    got = ways(scenery, [leaves], towards(180.0, 42.0))
    assert got.state.tolist() == [IN_SIGHT]
    assert got.loss_db.tolist() == [6.0]
    south = scenery.box([-300, -16, 0], [300, -6, 20])
    hedge = scenery.box([-300, 8, 0], [300, 18, 40], tag=Tag.VEGETATION)
    assert ways(scenery, [south, hedge], towards(180.0, 42.0)).state.tolist() == [BLOCKED]


def test_a_passing_truck_blocks(scenery: Any) -> None:
    """A truck of 4 m beside the antenna hides a low satellite while it is there."""
    truck = scenery.box([-6, -1.3, 0], [6, 1.3, 4.0], tag=Tag.TRUCK)
    drive = scenery.drive(
        scenery.straight(0.0), 3.0, scenery.catalog(["lorry"], tag=Tag.TRUCK),
        lambda t: scenery.frame([[0.0, 4.0 if t < 1.0 else 60.0, 0.0]]),
    )  # fmt: skip
    rays = scenery.world([], {"lorry": truck}).rays()
    to = np.stack([towards(0.0, 30.0), towards(180.0, 30.0)])
    assert receive(rays, drive, 500_000_000, ANTENNA_M, to).state.tolist() == [BLOCKED, IN_SIGHT]
    assert receive(rays, drive, 2_000_000_000, ANTENNA_M, to).state.tolist() == [IN_SIGHT, IN_SIGHT]


def test_loss_is_fresnels(scenery: Any) -> None:
    """Straight on: ((1 − n)/(1 + n))², n = √ε; metal loses nothing but the antenna's; at grazing, neither."""
    concrete, metal = np.array([Material.CONCRETE]), np.array([Material.SHEET_METAL])
    n = np.sqrt(5.24)
    assert reflection_db(concrete, np.ones(1))[0] - ANTENNA_DB == pytest.approx(
        -20 * np.log10((n - 1) / (n + 1))
    )
    assert reflection_db(metal, np.ones(1))[0] == pytest.approx(ANTENNA_DB, abs=0.05)
    assert reflection_db(concrete, np.full(1, 1e-4))[0] == pytest.approx(ANTENNA_DB, abs=0.05)
    assert 5.0 < reflection_db(concrete, np.full(1, 0.7))[0] < 15.0


def test_measurements_in_a_street_carry_detours_and_labels(scenery: Any) -> None:
    """Without other errors, code less straight range is the detour of the label: positive, or 0 in sight."""
    walls = [scenery.box([-400, s * 15 - 5, 0], [400, s * 15 + 5, 25]) for s in (-1, 1)]
    drive = scenery.drive(scenery.straight(10.0), 12.0)
    errors = dataclasses.replace(OFF, town=True)
    street = measured(scenery.world(walls), drive, config(errors), 10.0)["gnss_raw"]
    open_sky = measured(scenery.world(), drive, config(OFF), 10.0)["gnss_raw"]
    reflected = 0
    for raw, clear in zip(street, open_sky, strict=True):
        straight = dict(zip(zip(clear.satellite, clear.code, strict=True), clear.pseudorange_m, strict=True))
        extra = dict(zip(raw.sky_satellite, raw.sky_extra_m, strict=True))
        weaker = dict(zip(zip(clear.satellite, clear.code, strict=True), clear.cn0_dbhz, strict=True))
        for k, way in enumerate(raw.way()):
            key = raw.satellite[k], raw.code[k]
            assert raw.pseudorange_m[k] - straight[key] == pytest.approx(extra[key[0]], abs=1e-5)
            assert (extra[key[0]] > 0.1) == (way == REFLECTED) == (raw.cn0_dbhz[k] < weaker[key] - 3.0)
            reflected += way == REFLECTED
        assert set(raw.satellite) == set(raw.sky_satellite[raw.sky_way != BLOCKED])
    assert reflected > 50
