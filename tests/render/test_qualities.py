"""All render qualities show the same light; only edges and noise differ."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import (
    CAMERA,
    FORWARD,
    ego_plate,
    ground,
    need_opengl,
    quad,
    scene,
    standing,
    wall,
)

from carlaloc_env.core import transforms
from carlaloc_env.render.lighting import light_grid, night_lighting
from carlaloc_env.render.lighting.fixed_exposure import READ_NOISE_E, electrons
from carlaloc_env.render.lighting.sky_model import sky_light
from carlaloc_env.render.views import QUALITIES
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.presets import PRESETS

need_opengl()

LAMP_M = np.array([24.0, 6.0, 8.0])
EGO = standing(transforms.transform([-1.4, 0.0, 0.0], [0, 0, 0, 1]), instance=EGO_INSTANCE)


def street() -> list[Mesh]:
    """Asphalt, a house on the right and a lamp post on the left."""
    x, y = LAMP_M[:2]
    return [
        ground(),
        quad([[10, -6, 0], [60, -6, 0], [60, -6, 9], [10, -6, 9]], Material.PLASTER, Tag.BUILDING),
        wall(x, (y - 0.1, 0.0), (y + 0.1, 8.0), material=Material.METAL_PAINTED, tag=Tag.POLE),
    ]


@pytest.fixture(scope="module")
def radiance() -> dict[tuple[str, str], NDArray[np.float32]]:
    seen = {}
    for quality in QUALITIES:
        with scene(*street(), library=ego_plate(), quality=quality, lamps_m=LAMP_M[None]) as renderer:
            gbuffer = renderer.draw(CAMERA, FORWARD, EGO)
            for name in ("ClearNoon", "FoggyNoon", "RainyNight"):
                seen[quality, name] = renderer.radiance_cd_m2(gbuffer, PRESETS[name])
    return seen


@pytest.mark.parametrize("weather", ["ClearNoon", "FoggyNoon", "RainyNight"])
def test_qualities_agree_in_brightness(
    radiance: dict[tuple[str, str], NDArray[np.float32]], weather: str
) -> None:
    """Means of the whole picture, of the sky and of the road; live pictures do without mirrors."""
    for rows, name in ((slice(None), "all"), (slice(0, 80), "above"), (slice(110, 180), "road")):
        means = [float(radiance[quality, weather][rows].mean()) for quality in QUALITIES]
        assert means == pytest.approx([means[1]] * 3, rel=0.03), name


def test_qualities_agree_in_the_glow_round_a_lamp_by_night(
    radiance: dict[tuple[str, str], NDArray[np.float32]],
) -> None:
    """Rain and fog glow before the sky round a street lamp, ever less away from it."""
    u, v = round(160 - 160 * 6 / 24), round(90 - 160 * (8 - 1.6) / 24)
    for quality in QUALITIES:
        seen = radiance[quality, "RainyNight"][..., 1]
        near, far = (seen[v + 4 : v + 12, u - d - 6 : u - d].mean() for d in (2, 40))
        assert near > 1.15 * far, quality
    boxes = [
        float(radiance[quality, "RainyNight"][v - 15 : v + 25, u - 30 : u + 30].mean())
        for quality in QUALITIES
    ]
    assert boxes == pytest.approx([boxes[1]] * 3, rel=0.02)


def test_lamps_left_out_of_lists_are_not_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A night among lamps and cars, with and without the search for what they light."""
    random = np.random.default_rng(6)
    lamps_m = random.uniform([5, -25, 3], [70, 25, 9], (30, 3))
    night = PRESETS["RainyNight"]
    exposure = sky_light(night).exposure
    with scene(*street(), library=ego_plate(), quality="medium", lamps_m=lamps_m) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, EGO)
        sparse = renderer.radiance_cd_m2(gbuffer, night) * exposure
        shares: list[float] = []
        search = light_grid.keep_lit

        def counting(mask: NDArray[np.bool_], *rest: Any) -> None:
            whole = mask.copy()
            search(mask, *rest)
            shares.append(np.count_nonzero(mask) / np.count_nonzero(whole))
            mask[:] = whole

        monkeypatch.setattr(light_grid, "keep_lit", counting)
        whole = renderer.radiance_cd_m2(gbuffer, night) * exposure
    assert len(shares) == 1
    assert max(shares) < 0.8
    assert np.abs(sparse - whole).mean() < 0.2 * light_grid.LIGHT_CUTOFF
    # The noise of reading the darkest pixel hides the rest, but for some pixels of thin posts.
    noise = READ_NOISE_E / electrons(exposure)
    assert np.quantile(np.abs(sparse - whole), 0.9995) < noise
    assert np.quantile(np.abs(sparse - whole), 0.99) < 0.05 * noise


def test_light_that_the_noise_hides_is_not_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A night's picture with and without it differs by a tenth of what two exposures differ by, or less."""
    lamps_m = np.random.default_rng(6).uniform([5, -25, 3], [70, 25, 9], (30, 3))
    weather = PRESETS["ClearNight"]
    with scene(*street(), library=ego_plate(), lamps_m=lamps_m) as renderer:
        gbuffer = renderer.draw(CAMERA, FORWARD, EGO)
        sparse = renderer.shade(gbuffer, weather).astype(float)
        monkeypatch.setattr(night_lighting, "UNSEEN_NOISE", 0.0)
        whole = renderer.shade(gbuffer, weather).astype(float)
        again = renderer.shade(gbuffer, weather, seed=1).astype(float)
    missed, noise = (np.sqrt(np.mean((picture - whole) ** 2)) for picture in (sparse, again))
    assert 0.0 < missed < 0.1 * noise
    assert abs(np.mean(sparse - whole)) < 0.02 * noise
