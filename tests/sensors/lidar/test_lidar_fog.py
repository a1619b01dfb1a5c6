"""Fog in LiDAR scans: range, fog echoes and intensity against published curves and integrals."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from shared_fixtures.readings.lidar_weather import POWER_MIN, model, ranges, semantic

from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.lidar.atmosphere import (
    BACKSCATTER_PER_MOR,
    FOCUS_M,
    PULSE_S,
    Atmosphere,
    FogEcho,
    atmosphere_at,
)
from carlaloc_env.sensors.lidar.intensity import SURFACE, SolidEchoes, strongest_echoes
from carlaloc_env.weather.parameters import WeatherParameters

pytest.importorskip("open3d", reason="open3d is not installed")

lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")


def fog_of(extinction_per_m: float, **changes: float) -> WeatherParameters:
    """A weather whose extinction at every height is the given one [1/m], haze included."""
    density = 80.0 * ((extinction_per_m - 1e-4) / 0.0375) ** (2 / 3)
    return WeatherParameters(fog_density=density, fog_falloff=0.0, **changes)


@pytest.mark.parametrize(
    ("alpha", "material"),
    [(0.01, Material.PLASTER), (0.03, Material.PLASTER), (0.05, Material.PLASTER), (0.01, Material.RUBBER)],
)
def test_walls_vanish_in_fog_where_theory_says(scenery: Any, alpha: float, material: Material) -> None:
    """ρ·exp(−2αR)/R² = 0.9/R_max²: a wall 4 % nearer is seen face on, one 4 % farther is not."""
    rho = MATERIALS[material].reflectance
    reach = brentq(lambda r: rho * math.exp(-2 * alpha * r) / r**2 - POWER_MIN, 1.0, 120.0)
    for share, seen in ((0.96, True), (1.04, False)):
        x = 1.2 + share * reach
        world = scenery.world([scenery.box([x, -30, -30], [x + 1, 30, 30], material)])
        cloud = semantic(world, scenery.drive(scenery.straight(), 0.2), model(), fog_of(alpha))
        wall = cloud.tag == Tag.BUILDING
        face_on = wall & np.all(np.abs(cloud.points_xyz_m[:, 1:]) < 1.0, axis=-1)
        assert bool(np.any(face_on)) == seen


REACH_IN_FOG = {
    (0.01, 0.1): 30.0, (0.01, 0.9): 64.0, (0.03, 0.1): 21.0, (0.03, 0.9): 38.0, (0.06, 0.1): 16.0,
    (0.06, 0.9): 26.0,
}  # fmt: skip
"""Longest range [m] of dark and bright targets by extinction [1/m] for a sensor of 120 m (LISA's rule)."""


@pytest.mark.parametrize(("alpha", "rho"), sorted(REACH_IN_FOG))
def test_reach_in_fog_is_the_published_curve(alpha: float, rho: float) -> None:
    """The farthest of targets every 10 cm whose echo is seen."""
    at = np.arange(1.0, 120.0, 0.1)
    solid = SolidEchoes(
        range_m=at, power=np.full(len(at), rho), intensity=np.full(len(at), 100 * rho),
        reflectance=np.zeros(len(at)), cos_incidence=np.ones(len(at)),
    )  # fmt: skip
    air = Atmosphere(extinction_per_m=alpha, backscatter_per_m_sr=0.0, rain_mmph=0.0, wetness=0.0)
    place, intensity, tags = strongest_echoes(
        air,
        solid,
        beam_rad=3e-3,
        range_min_m=1.0,
        power_min=POWER_MIN,
        spray_m=None,
        uniform=np.ones((len(at), 6)),
    )
    assert np.all(tags == SURFACE)
    assert at[np.isfinite(place)].max() == pytest.approx(REACH_IN_FOG[alpha, rho], abs=0.7)
    assert intensity == pytest.approx(100 * rho * np.exp(-2 * alpha * at), rel=1e-5)


def test_fog_echo_is_rasshofers_integral() -> None:
    """Echo at several distances against numerical integration; its peak lies a few metres away."""
    alpha = 0.05
    air = atmosphere_at(fog_of(alpha), 0.0)
    assert air.extinction_per_m == pytest.approx(alpha)
    assert air.backscatter_per_m_sr == pytest.approx(BACKSCATTER_PER_MOR * alpha / math.log(20), rel=1e-6)
    echo = FogEcho(air)
    c = 299_792_458.0

    def exact(at: float) -> float:
        def density(t: float) -> float:
            r = at - 0.5 * c * t
            seen = 1.0 - math.exp(-((r / FOCUS_M) ** 2)) if r > 0 else 0.0
            return (
                math.sin(math.pi * t / (2 * PULSE_S)) ** 2
                * seen
                * math.exp(-2 * alpha * r)
                / max(r, 1e-3) ** 2
            )

        times = np.linspace(0, 2 * PULSE_S, 40_001)
        values = np.array([density(t) for t in times])
        return math.pi * air.backscatter_per_m_sr * float(np.trapezoid(values, times)) * 0.5 * c

    for at in (3.0, 4.5, 8.0, 20.0):
        assert np.interp(at, echo.range_m, echo.power) == pytest.approx(exact(at), rel=0.06)
    peak = echo.range_m[np.argmax(echo.power)]
    assert 2.0 < peak < 6.0
    thin = FogEcho(dataclasses.replace(air, backscatter_per_m_sr=0.5 * air.backscatter_per_m_sr))
    assert thin.power == pytest.approx(0.5 * echo.power)


def sky(air: Atmosphere, rays: int = 20_000) -> Any:
    """Echoes of beams into the sky."""
    none = np.zeros(rays)
    solid = SolidEchoes(
        range_m=none + 120.0, power=none, intensity=none, reflectance=none, cos_incidence=none + 1.0
    )
    uniform = 1.0 - np.random.default_rng(0).random((rays, 6))
    return strongest_echoes(
        air, solid, beam_rad=3e-3, range_min_m=1.0, power_min=POWER_MIN, spray_m=None, uniform=uniform
    )


@pytest.mark.parametrize(
    ("mor_m", "low", "high"), [(500, 0, 0), (300, 0, 1e-3), (100, 0.01, 0.2), (30, 0.5, 0.9)]
)
def test_thin_fog_sends_nothing_back(mor_m: float, low: float, high: float) -> None:
    """By the model of a real sensor (Bijelic et al. 2020), fog of 300 m hides no target within 120 m."""
    share = np.mean(np.isfinite(sky(atmosphere_at(fog_of(math.log(20) / mor_m), 0.0))[0]))
    assert low <= share <= high


def test_fog_hides_bright_targets_no_nearer_than_their_own_echo_fades() -> None:
    """In fog of 50 m, its mean echo is weaker than that of a 90 % target within its reach by LISA's rule."""
    alpha = math.log(20) / 50.0
    echo = FogEcho(atmosphere_at(fog_of(alpha), 0.0))
    reach = brentq(lambda r: 0.9 * math.exp(-2 * alpha * r) / r**2 - echo.power.max(), 1.0, 120.0)
    assert reach == pytest.approx(REACH_IN_FOG[0.06, 0.9], abs=1.0)


def test_fog_throws_far_points_near(scenery: Any) -> None:
    """In dense fog most far, dark points turn into a haze near the sensor; clear air has none."""
    wall = scenery.box([25, -60, -30], [26, 60, 40], Material.BRICK_BROWN)
    world, drive = scenery.world([wall]), scenery.drive(scenery.straight(), 0.2)
    share = {}
    for alpha in (1.2e-4, 0.02, 0.05):
        cloud = semantic(world, drive, model(), fog_of(alpha))
        soft = cloud.tag == Tag.UNLABELED
        share[alpha] = np.mean(soft)
        if soft.any():
            assert np.median(ranges(cloud)[soft]) < 8.0
            assert np.all(cloud.instance[soft] == 0)  # type: ignore[index]
            assert cloud.intensity[soft].max() < 60
    assert share[1.2e-4] == 0.0
    assert share[0.05] > share[0.02]
    assert share[0.05] > 0.5


def test_intensity_falls_as_exp_minus_two_alpha_r(scenery: Any) -> None:
    """A bright wall at 20 m in fog against the same wall in clear air."""
    world = scenery.world([scenery.box([21.2, -9, -9], [22, 9, 9], Material.PLASTER)])
    drive = scenery.drive(scenery.straight(), 0.2)
    clear, foggy = (semantic(world, drive, model(), fog_of(alpha)) for alpha in (1.0001e-4, 0.01))
    hard = {}
    for name, cloud in (("clear", clear), ("foggy", foggy)):
        wall = cloud.tag == Tag.BUILDING
        rows = zip(cloud.ring[wall], cloud.offset_ns[wall], cloud.intensity[wall], strict=True)
        hard[name] = {(int(ring), int(offset)): float(value) for ring, offset, value in rows}
    both = hard["clear"].keys() & hard["foggy"].keys()
    assert len(both) > 500
    ratio = np.array([hard["foggy"][k] / hard["clear"][k] for k in both])
    assert np.median(ratio) == pytest.approx(math.exp(-2 * (0.01 - 1e-4) * 20.6), rel=0.03)
