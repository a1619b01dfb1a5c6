"""Rows of the lights of a night, as the shaders read them."""

from dataclasses import replace

import numpy as np

from carlaloc_env.render.lighting.light_sources import street_lamps
from carlaloc_env.render.lighting.light_table import TEXELS, fog_lights, surface_lights


def test_rows_hold_what_lights_are() -> None:
    """Random lamps and low beams, texel by texel; the last row gives no light."""
    random = np.random.default_rng(7)
    count = 60
    axis, left = random.normal(size=(2, count, 3))
    lights = replace(
        street_lamps(random.uniform(-200, 200, (count, 3))),
        axis=axis,
        left=left,
        colour_cd=random.uniform(0.1, 30000.0, (count, 3)),
        range_m=random.uniform(3.0, 90.0, count),
        beam=random.random(count) < 0.5,
    )
    eye, exposure, glow_range = np.array([10.0, -4.0, 1.5]), 0.37, random.uniform(0.3, 8.0, count)
    table = surface_lights(lights, eye, exposure)
    assert table.shape == (count + 1, 4 * TEXELS)
    assert not table[-1].any()
    texel = table[:-1].reshape(count, TEXELS, 4)
    np.testing.assert_allclose(texel[:, 0, :3] + eye, lights.position_m, rtol=1e-4)
    np.testing.assert_allclose(texel[:, 0, 3] ** -0.5, lights.range_m, rtol=1e-6)
    np.testing.assert_allclose(texel[:, 1, :3] * np.pi / exposure, lights.colour_cd, rtol=1e-6)
    np.testing.assert_allclose(texel[:, 1, 3], lights.cap, rtol=1e-6)
    np.testing.assert_allclose(texel[:, 2, :3], axis, rtol=1e-6)
    np.testing.assert_allclose(texel[:, 3, :3], left, rtol=1e-6)
    # From where the beam ends, the last number leads to the full beam in one step.
    np.testing.assert_allclose(texel[:, 2, 3] + 1.0 / texel[:, 3, 3], lights.edge[:, 1], rtol=1e-6)
    fog = fog_lights(lights, eye, exposure, glow_range)[:-1].reshape(count, TEXELS, 4)
    np.testing.assert_allclose(fog[:, 0, 3] ** -0.5, glow_range, rtol=1e-6)
    np.testing.assert_allclose(fog[:, 1, :3].max(axis=1), lights.glow_cd * exposure / np.pi, rtol=1e-6)
