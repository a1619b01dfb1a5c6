"""A night by tiles, each with its own lists of lamps, against one list for the whole image."""

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import CAMERA, FORWARD, ground, need_opengl, scene, wall

from carlaloc_env.render.lighting import night_lighting
from carlaloc_env.render.lighting.light_grid import (
    LIGHT_CUTOFF,
    LOOPS,
    Fog,
    LightGrid,
)
from carlaloc_env.render.lighting.light_sources import Lights
from carlaloc_env.render.lighting.light_tiles import DepthRange, TileGroups, every_tile
from carlaloc_env.render.lighting.sky_model import sky_light
from carlaloc_env.render.views import CameraView
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.weather.presets import PRESETS

need_opengl()


def one_list(
    view: CameraView, lights: Lights, depths: DepthRange, *, exposure: float, fog: Fog, **_: object
) -> LightGrid:
    """All lamps for every tile."""
    tiles = every_tile(depths.near_m.shape)
    every = np.arange(len(lights))
    beams, lamps = every[lights.beam], every[~lights.beam]
    ends = 1 + np.cumsum([len(every), len(lamps), len(beams)])
    for name, first, end in zip(("glows", "lamps", "beams"), (1, *ends), ends, strict=False):
        # A loop without entries finds the entry of no light.
        tiles[name] = (first, end) if end > first else (0, 1)
    kinds = np.full(len(tiles), len(LOOPS) - 1)
    return LightGrid(
        lights=lights,
        glow_range_m=fog.glow_range_m(lights, exposure),
        groups=TileGroups.sorted_by(tiles, kinds, LOOPS, depths.shown.ravel()),
        entries=np.concatenate([[-1], every, lamps, beams]),
        glow_count=1 + len(every),
    )


@pytest.mark.parametrize("weather", ["ClearNight", "RainyNight"])
def test_tiles_show_what_one_list_shows(weather: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pixels miss a hundredth of the light cut-off of each lamp on average."""
    lamps_m = np.random.default_rng(6).uniform([5, -25, 3], [70, 25, 9], (40, 3))
    images: list[NDArray[np.float32]] = []
    with scene(ground(), wall(25.0, (-9.0, 0.0), (3.0, 7.0)), lamps_m=lamps_m, quality="medium") as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, Instances())
        images.append(renderer.radiance_cd_m2(gbuffer, PRESETS[weather]))
        monkeypatch.setattr(night_lighting, "light_grid", one_list)
        images.append(renderer.radiance_cd_m2(gbuffer, PRESETS[weather]))
    missed = (images[1] - images[0]) * sky_light(PRESETS[weather]).exposure
    assert images[0].max() > 10.0 * images[0].min()
    assert np.abs(missed).mean() < 0.01 * len(lamps_m) * LIGHT_CUTOFF
    assert np.quantile(np.abs(missed), 0.999) < 5.0 * LIGHT_CUTOFF
