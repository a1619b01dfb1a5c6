"""Textures against the albedo sheet, for seams, contrast, atlas layout and caching."""

import numpy as np
import pytest
from numpy.typing import NDArray

from carlaloc_env.assets.texture_atlas import (
    BILLBOARDS,
    GRID,
    SHOP_NAMES,
    PosterCell,
    SignCell,
    WideWindowCell,
    WindowCell,
    atlas_cells,
    atlas_uv,
)
from carlaloc_env.core.clock import stream
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.render.textures.build import RECIPES, make_albedo
from carlaloc_env.render.textures.noise import fbm, worley
from carlaloc_env.scene.materials import MATERIALS, Material

SIZE = 256
TILED = [m for m in Material if m not in GRID]

MEAN_ALBEDO: dict[Material, tuple[float, float]] = {
    Material.ASPHALT: (0.08, 0.13),
    Material.ASPHALT_OLD: (0.10, 0.18),
    Material.ASPHALT_MOTORWAY: (0.09, 0.15),
    Material.ROAD_PAINT_WHITE: (0.40, 0.65),
    Material.ROAD_PAINT_YELLOW: (0.20, 0.35),
    Material.CONCRETE: (0.25, 0.40),
    Material.CONCRETE_PANEL: (0.25, 0.40),
    Material.PAVEMENT: (0.25, 0.35),
    Material.KERB: (0.25, 0.40),
    Material.GRASS: (0.05, 0.09),
    Material.SOIL: (0.09, 0.18),
    Material.BRICK_RED: (0.13, 0.28),
    Material.BRICK_BROWN: (0.13, 0.28),
    Material.PLASTER: (0.45, 0.65),
    Material.ASHLAR: (0.33, 0.45),
    Material.ROOF_TILE: (0.12, 0.20),
    Material.BARK: (0.10, 0.20),
    Material.LEAF: (0.05, 0.12),
    Material.GLASS: (0.02, 0.05),
    Material.RUBBER: (0.02, 0.06),
    Material.METAL_GALVANISED: (0.30, 0.50),
    Material.WATER: (0.02, 0.06),
    Material.CAR_PAINT: (0.70, 0.85),
}
"""Mean of the three channels, linear."""

ROUGH_SURFACES = [
    Material.PAVEMENT, Material.BRICK_RED, Material.BRICK_BROWN, Material.GRASS, Material.SOIL,
    Material.GRAVEL, Material.ASHLAR, Material.ROOF_TILE, Material.ROOF_SLATE, Material.CROP,
    Material.FURROWS,
]  # fmt: skip
"""Rubble is not among them: the shader gives its stones their tones, which `test_fronts.py` sees."""


@pytest.fixture(scope="module")
def albedo() -> NDArray[np.float32]:
    return make_albedo(SIZE).astype(np.float32)


def brightness(layer: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.log(layer[..., :3].astype(np.float64).mean(axis=-1))


def cell(albedo: NDArray[np.float32], material: Material, index: int) -> NDArray[np.float32]:
    """Pixels of an atlas cell, row 0 at its lower edge."""
    u0, v0, u1, v1 = np.array(atlas_uv(material, index)) / MATERIALS[material].tile_m * SIZE
    return albedo[material, int(v0) : int(v1) + 1, int(u0) : int(u1) + 1, :3]


def test_every_material_has_a_recipe() -> None:
    assert set(RECIPES) == set(Material)


def test_values_are_possible_albedo(albedo: NDArray[np.float32]) -> None:
    assert albedo.shape == (len(Material), SIZE, SIZE, 4)
    assert np.isfinite(albedo).all()
    assert albedo[..., :3].min() > 0.0195
    assert albedo[..., :3].max() < 0.8505
    assert albedo[..., 3].min() > 0.015
    assert albedo[..., 3].max() <= 1.0


@pytest.mark.parametrize("material", MEAN_ALBEDO)
def test_mean_albedo_is_that_of_the_sheet(albedo: NDArray[np.float32], material: Material) -> None:
    low, high = MEAN_ALBEDO[material]
    assert low <= albedo[material, ..., :3].mean() <= high


@pytest.mark.parametrize("material", TILED)
def test_textures_tile_without_a_seam(albedo: NDArray[np.float32], material: Material) -> None:
    """The step over the border is no larger than steps inside; at a joint it may be the largest of them."""
    log = brightness(albedo[material])
    for axis in (0, 1):
        step = np.abs(np.roll(log, -1, axis=axis) - log).mean(axis=1 - axis)
        assert step[-1] <= 1.2 * step[:-1].max() + 1e-3
        around = np.concatenate([step[-4:], step[:3]])
        assert np.median(around) <= 2.0 * np.percentile(step, 90) + 1e-3


@pytest.mark.parametrize("material", ROUGH_SURFACES)
def test_contrast_at_fine_and_coarse_scale(albedo: NDArray[np.float32], material: Material) -> None:
    """Blocks, blades and clods show near and far: at full size, and still after shrinking eight times."""
    log = brightness(albedo[material])
    assert 0.12 < log.std() < 0.50
    assert coarse(log, 8).std() > 0.05


@pytest.mark.parametrize("material", [m for m in Material if m.name.startswith("ASPHALT")])
def test_asphalt_is_grain_alone(albedo: NDArray[np.float32], material: Material) -> None:
    """Stones of 5–15 mm and nothing larger: whatever else a tile showed, a road would show every 2.5 m."""
    log = brightness(albedo[material])
    assert 0.08 < log.std() < 0.35
    assert coarse(log, 32).std() < 0.008


def coarse(log: NDArray[np.float64], times: int) -> NDArray[np.float64]:
    """The same picture, so many times smaller."""
    return log.reshape(SIZE // times, times, SIZE // times, times).mean(axis=(1, 3))


def test_same_seed_same_bytes() -> None:
    assert make_albedo(64).tobytes() == make_albedo(64).tobytes()


def test_atlas_cells_lie_apart_inside_the_tile() -> None:
    for material in GRID:
        tile = MATERIALS[material].tile_m
        boxes = np.array([atlas_uv(material, k) for k in range(atlas_cells(material))])
        assert boxes.min() > 0
        assert boxes.max() < tile
        for a in range(len(boxes)):
            for b in range(a):
                apart = (boxes[a, :2] >= boxes[b, 2:]) | (boxes[b, :2] >= boxes[a, 2:])
                assert apart.any()
        assert atlas_uv(material, atlas_cells(material)) == atlas_uv(material, 0)
    with pytest.raises(ConfigError, match="no atlas texture 'ASPHALT'"):
        atlas_uv(Material.ASPHALT, 0)


def test_signs_have_their_colours(albedo: NDArray[np.float32]) -> None:
    red, green, blue = cell(albedo, Material.SIGN, SignCell.STOP).mean(axis=(0, 1))
    assert red > 1.8 * green
    red, green, blue = cell(albedo, Material.SIGN, SignCell.PARKING).mean(axis=(0, 1))
    assert blue > 1.5 * red
    red, green, blue = cell(albedo, Material.SIGN, SignCell.STREET_A).mean(axis=(0, 1))
    assert green > 1.3 * red


def test_lettering_stands_upright_and_reads_from_left_to_right(albedo: NDArray[np.float32]) -> None:
    """A P has its stem on the left and its bowl above."""
    letter = cell(albedo, Material.SIGN, SignCell.PARKING)[..., 0]
    rows, columns = letter.shape
    inside = letter[int(0.32 * rows) : int(0.92 * rows), int(0.1 * columns) : int(0.9 * columns)] > 0.3
    up, across = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    part = inside[up[0] : up[-1] + 1, across[0] : across[-1] + 1]
    low, high = part[: len(part) // 2], part[len(part) // 2 :]
    assert high.sum() > 1.15 * low.sum()
    assert low[:, : low.shape[1] // 2].sum() > 3 * max(low[:, low.shape[1] // 2 :].sum(), 1)


def test_cells_of_an_atlas_differ(albedo: NDArray[np.float32]) -> None:
    for material, cells in (
        (Material.WINDOW, WindowCell),
        (Material.POSTER, PosterCell),
        (Material.WINDOW_WIDE, WideWindowCell),
        (Material.SHOP_SIGN, range(len(SHOP_NAMES))),
        (Material.BILLBOARD, range(len(BILLBOARDS))),
    ):
        pictures = [cell(albedo, material, k) for k in cells]
        for a in range(len(pictures)):
            for b in range(a):
                assert np.abs(pictures[a] - pictures[b]).mean() > 0.004


def test_windows_are_glossy_and_frames_are_not(albedo: NDArray[np.float32]) -> None:
    roughness = albedo[Material.WINDOW, ..., 3]
    assert np.mean(roughness < 0.1) > 0.3
    assert np.mean(roughness > 0.4) > 0.15


def test_fbm_has_its_wavelengths() -> None:
    """No energy beyond the band that was asked for."""
    field = fbm(stream(0, "t"), 128, 1 / 4, 1 / 16)
    power = np.abs(np.fft.rfft2(field)) ** 2
    fu, fv = np.meshgrid(np.fft.rfftfreq(128, 1 / 128), np.fft.fftfreq(128, 1 / 128))
    f = np.hypot(fu, fv)
    assert field.std() == pytest.approx(1.0, abs=1e-3)
    assert power[(f <= 2) | (f >= 32)].sum() < 1e-6 * power.sum()


def test_worley_equals_brute_force() -> None:
    cells = worley(stream(0, "w"), 48, 5, 4)
    points = 0.5 + 0.9 * (stream(0, "w").random((4, 5, 2), dtype=np.float32) - 0.5)
    u = (np.arange(48) + 0.5) / 48 * 5
    v = (np.arange(48) + 0.5) / 48 * 4
    where = np.array([(c + points[r, c, 0], r + points[r, c, 1]) for r in range(4) for c in range(5)])
    du = np.abs(u[None, :, None] - where[:, 0])
    dv = np.abs(v[:, None, None] - where[:, 1])
    distance = np.sort(np.hypot(np.minimum(du, 5 - du), np.minimum(dv, 4 - dv)), axis=-1)
    np.testing.assert_allclose(cells.nearest, distance[..., 0], atol=1e-5)
