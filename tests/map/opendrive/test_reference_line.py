"""Reference lines against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import fresnel
from shared_fixtures.worlds.single_roads import H0, X0, Y0, line_at, road, to_world


@pytest.mark.parametrize("curvature", [0.25, -0.05, 1e-3, 1e-9, 1e-15, 0.0])
def test_arc_is_a_circle(curvature: float) -> None:
    length = 60.0
    s = np.linspace(0.0, length, 121)
    line = line_at(road(f'<arc curvature="{curvature!r}"/>', length), s)
    if abs(curvature) > 1e-6:
        u, v = np.sin(curvature * s) / curvature, (1.0 - np.cos(curvature * s)) / curvature
    else:
        # Two terms of the series are exact to rounding here.
        u, v = s, 0.5 * curvature * s * s
    x, y = to_world(u, v)
    np.testing.assert_allclose(line.x_m, x, atol=1e-9)
    np.testing.assert_allclose(line.y_m, y, atol=1e-9)
    np.testing.assert_allclose(line.heading_rad, H0 + curvature * s, atol=1e-12)


@pytest.mark.parametrize(
    ("k0", "k1", "length"),
    [(0.0, 0.1, 40.0), (0.1, 0.0, 40.0), (-0.02, 0.05, 80.0), (0.3, 0.29, 50.0), (0.0, -0.5, 60.0)],
)
def test_spiral_is_fresnels(k0: float, k1: float, length: float) -> None:
    """∫(cos θ, sin θ) by scipy's Fresnel integrals, for a curvature that crosses zero too."""
    s = np.linspace(0.0, length, 97)
    line = line_at(road(f'<spiral curvStart="{k0}" curvEnd="{k1}"/>', length), s)
    c = (k1 - k0) / length
    a, s0 = math.sqrt(math.pi / abs(c)), k0 / c
    S1, C1 = fresnel((s0 + s) / a)
    S0, C0 = fresnel(s0 / a)
    plane = a * ((C1 - C0) + 1j * math.copysign(1.0, c) * (S1 - S0)) * np.exp(-0.5j * c * s0 * s0)
    x, y = to_world(plane.real, plane.imag)
    np.testing.assert_allclose(line.x_m, x, atol=1e-9)
    np.testing.assert_allclose(line.y_m, y, atol=1e-9)
    np.testing.assert_allclose(line.heading_rad, H0 + k0 * s + 0.5 * c * s * s, atol=1e-12)
    np.testing.assert_allclose(line.curvature_radpm, k0 + c * s, atol=1e-12)


def test_spiral_of_equal_curvatures_is_an_arc() -> None:
    s = np.linspace(0.0, 30.0, 31)
    spiral = line_at(road('<spiral curvStart="0.05" curvEnd="0.05"/>', 30.0), s)
    arc = line_at(road('<arc curvature="0.05"/>', 30.0), s)
    np.testing.assert_allclose(np.stack(spiral), np.stack(arc), atol=1e-12)


def test_poly3_runs_by_arc_length() -> None:
    """The point at s is the one whose arc length from the start, by scipy, is s."""
    b, c, d = 0.1, 0.01, -2e-4
    line = line_at(road(f'<poly3 a="0" b="{b}" c="{c}" d="{d}"/>', 35.0), np.linspace(0.0, 35.0, 15))
    dx, dy = line.x_m - X0, line.y_m - Y0
    u, v = math.cos(H0) * dx + math.sin(H0) * dy, math.cos(H0) * dy - math.sin(H0) * dx
    np.testing.assert_allclose(v, b * u + c * u**2 + d * u**3, atol=1e-9)
    for n, end in enumerate(u):
        arc = quad(lambda p: math.hypot(1.0, b + 2 * c * p + 3 * d * p * p), 0.0, end, epsabs=1e-12)[0]
        assert arc == pytest.approx(35.0 / 14.0 * n, abs=1e-7)
    slope = b + 2 * c * u + 3 * d * u**2
    np.testing.assert_allclose(line.heading_rad, H0 + np.arctan(slope), atol=1e-9)
    np.testing.assert_allclose(line.curvature_radpm, (2 * c + 6 * d * u) / (1 + slope**2) ** 1.5, atol=1e-9)


@pytest.mark.parametrize("span", ["normalized", "arcLength"])
def test_param_poly3_is_scaled_to_its_length(span: str) -> None:
    """s runs evenly along the curve: equal steps of s are equal arcs."""
    length = 25.0
    p_max = 1.0 if span == "normalized" else length
    U = (0.0, 20.0 / p_max, 3.0 / p_max**2, -2.0 / p_max**3)
    V = (0.0, 0.0, 9.0 / p_max**2, -4.0 / p_max**3)
    names = zip(("aU", "bU", "cU", "dU", "aV", "bV", "cV", "dV"), U + V, strict=True)
    text = " ".join(f'{name}="{value!r}"' for name, value in names)
    s = np.linspace(0.0, length, 2001)
    line = line_at(road(f'<paramPoly3 pRange="{span}" {text}/>', length), s)

    def at(c: tuple[float, ...], p: float) -> float:
        return c[0] + p * (c[1] + p * (c[2] + p * c[3]))

    x, y = to_world(np.array([at(U, p_max)]), np.array([at(V, p_max)]))
    np.testing.assert_allclose([line.x_m[-1], line.y_m[-1]], [x[0], y[0]], atol=1e-8)
    steps = np.hypot(np.diff(line.x_m), np.diff(line.y_m))
    assert steps.max() / steps.min() - 1.0 < 1e-6
    chord = np.arctan2(np.diff(line.y_m), np.diff(line.x_m))
    np.testing.assert_allclose(chord, 0.5 * (line.heading_rad[1:] + line.heading_rad[:-1]), atol=1e-6)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    np.testing.assert_allclose(line.rate, arc[-1] / length, rtol=1e-5)
    bend = np.gradient(line.heading_rad, arc)[5:-5]
    np.testing.assert_allclose(line.curvature_radpm[5:-5], bend, atol=2e-5)
    change = np.gradient(line.curvature_radpm, arc)[5:-5]
    np.testing.assert_allclose(line.curvature_slope[5:-5], change, atol=2e-5)
