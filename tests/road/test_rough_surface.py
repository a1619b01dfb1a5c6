"""Rough surfaces against ISO 8608's spectrum and the coherence of isotropic surfaces."""

import itertools

import numpy as np
import pytest
from scipy.signal import csd, welch
from scipy.special import gamma, k1, kv

from carlaloc_env.core.array_types import Array
from carlaloc_env.road.road_profile import LevelGrid, Relief, Roughness
from carlaloc_env.road.rough_surface import ROAD_CLASSES, RoughSurface, class_level, class_roughness_m3

TRACK_M = 1.58
STEP_M = 0.1


@pytest.fixture(scope="module")
def whole() -> RoughSurface:
    """All waves of 0.5 to 50 m in one surface."""
    return RoughSurface(5, "test", waves_cpm=(0.02, 2.0), spacing_m=0.1, size=2048)


def profile(surface: RoughSurface, *, heading_rad: float, aside_m: float = 0.0) -> Array:
    """Heights along 12 km of a straight road [m]."""
    s = np.arange(0.0, 12_000.0, STEP_M)
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return surface.heights(np.stack([cos * s - sin * aside_m, sin * s + cos * aside_m], axis=-1))[:, 0]


def bands(n: Array, low: float, high: float) -> list[Array]:
    """Masks of half octaves."""
    edges = np.geomspace(low, high, round(2 * np.log2(high / low)) + 1)
    return [(n >= a) & (n < b) for a, b in itertools.pairwise(edges)]


@pytest.mark.parametrize("heading_rad", [0.0, 0.9])
def test_profiles_have_the_spectrum_of_iso_8608(whole: RoughSurface, heading_rad: float) -> None:
    """G_d = 1e-6 m³·(n/0.1)⁻² in every direction, each half octave within 1 dB from 33 m to 0.8 m."""
    n, power = welch(profile(whole, heading_rad=heading_rad), fs=1.0 / STEP_M, nperseg=4096)
    for band in bands(n, 0.03, 1.2):
        expected = 1e-6 * (n[band] / 0.1) ** -2
        assert 10 * np.log10(power[band].sum() / expected.sum()) == pytest.approx(0.0, abs=1.0)


def test_steeper_profiles_meet_the_others_at_ten_metres() -> None:
    """G_d = 1e-6 m³·(n/0.1)⁻²·⁵ within 1 dB in each half octave, coherence within 0.07."""
    steep = RoughSurface(5, "test", waves_cpm=(0.05, 2.0), spacing_m=0.1, size=2048, waviness=2.5)
    left, right = (profile(steep, heading_rad=0.9, aside_m=y) for y in (0.0, TRACK_M))
    n, own = welch(left, fs=1.0 / STEP_M, nperseg=4096)
    _, cross = csd(left, right, fs=1.0 / STEP_M, nperseg=4096)
    for band in bands(n, 0.08, 1.2):
        expected = 1e-6 * (n[band] / 0.1) ** -2.5
        assert 10 * np.log10(own[band].sum() / expected.sum()) == pytest.approx(0.0, abs=1.0)
        x = 2 * np.pi * TRACK_M * n[band]
        theory = 2.0 * (x / 2) ** 1.25 * kv(1.25, x) / gamma(1.25)
        found = cross[band].real.sum() / own[band].sum()
        assert found == pytest.approx(np.average(theory, weights=own[band]), abs=0.07)


def test_two_tracks_have_the_coherence_of_an_isotropic_surface(whole: RoughSurface) -> None:
    """2πBn·K₁(2πBn) of Dodds and Robson within 0.07, in every half octave."""
    left, right = (profile(whole, heading_rad=0.3, aside_m=y) for y in (0.0, TRACK_M))
    n, own = welch(left, fs=1.0 / STEP_M, nperseg=4096)
    _, cross = csd(left, right, fs=1.0 / STEP_M, nperseg=4096)
    for band in bands(n, 0.03, 1.2):
        b = 2 * np.pi * TRACK_M * n[band]
        found = cross[band].real.sum() / own[band].sum()
        assert found == pytest.approx(np.average(b * k1(b), weights=own[band]), abs=0.07)


def test_slopes_are_the_heights_derivatives() -> None:
    level = LevelGrid((0.0, 0.0), 5.0, np.linspace(4.0, 16.0, 36).reshape(6, 6))
    relief = Relief(3, level)
    at, step = np.array([[7.3, 11.1], [2.2, 19.0], [60.0, -3.0]]), 1e-4
    found = relief.heights(at)
    for k, direction in enumerate(([step, 0.0], [0.0, step])):
        ahead, behind = (relief.heights(at + sign * np.array(direction))[:, 0] for sign in (1, -1))
        assert found[:, 1 + k] == pytest.approx((ahead - behind) / (2 * step), rel=1e-4, abs=1e-9)


def test_one_place_and_many_agree() -> None:
    rough = Roughness(3, LevelGrid.uniform(8.0))
    surface = RoughSurface(3, "a", waves_cpm=(0.1, 2.0), spacing_m=0.1, size=128)
    at = np.array([[7.3, -11.1], [1e4, 3.0]])
    assert [surface.height(x, y) for x, y in at] == surface.heights(at)[:, 0].tolist()
    assert rough.height(7.3, -11.1) == Roughness(3, LevelGrid.uniform(8.0)).height(7.3, -11.1)
    assert rough.height(7.3, -11.1) != Roughness(4, LevelGrid.uniform(8.0)).height(7.3, -11.1)


def test_levels_run_between_their_points() -> None:
    grid = LevelGrid((10.0, 20.0), 5.0, np.array([[4.0, 8.0], [12.0, 16.0], [4.0, 4.0]]))
    at = np.array([[10.0, 20.0], [12.5, 22.5], [15.0, 20.0], [-9.0, 20.0]])
    levels = grid.levels(at)
    assert levels[:, 0] == pytest.approx([4.0, 10.0, 12.0, 4.0], abs=0.02)
    assert levels[1, 1:] == pytest.approx([1.6, 0.8])
    assert not levels[3, 1:].any()


def test_classes_are_those_of_iso_8608() -> None:
    """Table C.1: geometric means 16, 64, 256, … 262 144 e-6 m³."""
    assert [round(class_roughness_m3(name) * 1e6) for name in ROAD_CLASSES] == [4**k for k in range(2, 10)]
    assert class_level("B") == 8.0
