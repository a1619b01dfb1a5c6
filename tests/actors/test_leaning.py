"""Vehicles stand on leaning roads with all four wheels: against the road's own surface."""

from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.towns import town_network

from benchmarks.traffic_audit import NOBODY
from carlaloc_env.actors.instances import ground_poses
from carlaloc_env.assets.catalog import VEHICLES
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.world import TrafficWorld

TILT_RAD = 0.08

ROUND = """<?xml version="1.0"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="7" name="leaning"/>
  <road id="1" length="{length}" junction="-1">
    <link>
      <predecessor elementType="road" elementId="1" contactPoint="end"/>
      <successor elementType="road" elementId="1" contactPoint="start"/>
    </link>
    <planView>
      <geometry s="0" x="0" y="0" hdg="0" length="{length}"><arc curvature="{k}"/></geometry>
    </planView>
    <elevationProfile><elevation s="0" a="0" b="0" c="0" d="0"/></elevationProfile>
    <lateralProfile><superelevation s="0" a="{tilt}" b="0" c="0" d="0"/></lateralProfile>
    <lanes><laneSection s="0">
      <left>
        <lane id="1" type="driving" level="false">
          <link><predecessor id="1"/><successor id="1"/></link>
          <width sOffset="0" a="3.5" b="0" c="0" d="0"/>
        </lane>
      </left>
      <center><lane id="0" type="none" level="false"/></center>
      <right>
        <lane id="-1" type="driving" level="false">
          <link><predecessor id="-1"/><successor id="-1"/></link>
          <width sOffset="0" a="3.5" b="0" c="0" d="0"/>
        </lane>
      </right>
    </laneSection></lanes>
  </road>
</OpenDRIVE>
"""


@pytest.fixture(scope="module")
def circle() -> LaneNetwork:
    """A round road of 60 m radius that falls by 0.08 rad to its outside."""
    radius = 60.0
    text = ROUND.format(length=2 * np.pi * radius, k=1.0 / radius, tilt=TILT_RAD)
    return build_network(text.encode())


def test_vehicles_lean_as_a_banked_circle_does(circle: LaneNetwork) -> None:
    """The road lies on a cone about (0, 60): wheels of cars both ways touch it within a millimetre."""
    world = TrafficWorld(circle, TrafficConfig(vehicles=12, walkers=0, seed=4))
    world.reset()
    frame = [world.step(NOBODY) for _ in range(200)][-1]
    ways = np.unique(np.sign(frame.roll_rad))
    assert ways.tolist() == [-1.0, 1.0]
    assert np.abs(np.abs(frame.roll_rad) - TILT_RAD).max() < 2e-3
    wheels = wheel_points(world.catalog, frame)
    out = np.hypot(wheels[..., 0], wheels[..., 1] - 60.0)
    height = (60.0 - out) * np.tan(TILT_RAD)
    # Wheels stand off the straight line between the axles' middles: the cone curves away below them.
    assert np.abs(wheels[..., 2] - height).max() < 4e-3


def wheel_points(catalog: Any, frame: Any) -> np.ndarray:
    """Where four wheels touch the ground [m], (N, 4, 3)."""
    T = ground_poses(frame.position_m, frame.heading_rad, frame.pitch_rad, frame.roll_rad)
    size = np.array([VEHICLES[name].size_m for name in catalog.model])
    corners = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) * np.array([0.3, 0.42])
    local = np.concatenate([corners[None] * size[:, None, :2], np.zeros((len(size), 4, 1))], axis=-1)
    points: np.ndarray = np.sum(T[:, None, :3, :3] * local[:, :, None, :], axis=-1) + T[:, None, :3, 3]
    return points


def test_wheels_touch_the_roads_of_town07() -> None:
    """Outside junctions, wheels lie within 2 cm of the lanes' own surface; level cars were 3.7 cm off."""
    network = town_network("Town07")
    world = TrafficWorld(network, TrafficConfig(vehicles=60, walkers=0, seed=2))
    world.reset()
    worst, leaning = [], 0
    for _ in range(15):
        for _ in range(40):
            frame = world.step(NOBODY)
        wheels = wheel_points(world.catalog, frame)
        leaning += int((np.abs(frame.roll_rad) > 0.01).sum())
        worst.append(_off_road(network, wheels))
    off = np.concatenate(worst)
    assert leaning > 100
    assert len(off) > 1000
    assert np.quantile(off, 0.99) < 0.01
    assert off.max() < 0.02


def _off_road(network: LaneNetwork, points_m: np.ndarray) -> np.ndarray:
    """Distances [m] in height of points to the surface of the plain road that they lie on."""
    flat = points_m.reshape(-1, 3)
    roads = [n for n, road in enumerate(network.xodr.roads) if road.junction_id is None]
    best = np.full(len(flat), np.nan)
    for number in roads:
        length = network.xodr.roads[number].length_m
        s = np.arange(0.0, length, 0.5)
        line = network.surface.plan_view.evaluate(np.full(len(s), number), s)
        gap = np.hypot(flat[:, :1] - line.x_m, flat[:, 1:2] - line.y_m)
        near = np.argmin(gap, axis=1)
        rows = np.flatnonzero((gap[np.arange(len(flat)), near] < 4.0) & (near > 8) & (near < len(s) - 9))
        if not len(rows):
            continue
        k = near[rows]
        cos, sin = np.cos(line.heading_rad[k]), np.sin(line.heading_rad[k])
        dx, dy = flat[rows, 0] - line.x_m[k], flat[rows, 1] - line.y_m[k]
        t, along = cos * dy - sin * dx, cos * dx + sin * dy
        at = s[k] + along / (1.0 - line.curvature_radpm[k] * t)
        best[rows] = np.abs(network.surface.position(np.full(len(rows), number), at, t)[:, 2] - flat[rows, 2])
    found: np.ndarray = best[np.isfinite(best)]
    return found
