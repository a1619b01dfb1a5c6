"""Livox's patterns against the field, coverage and density of Livox's own tables of directions."""

import numpy as np
import pytest

from carlaloc_env.core.array_types import Array
from carlaloc_env.sensors.lidar import optics
from carlaloc_env.sensors.lidar.sweep_rays import RayPattern
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.lidar_patterns import WedgePattern

BANDS = {
    "mid360": (-7.2, 52.2, [.092, .111, .085, .085, .090, .090, .083, .075, .069, .073, .100, .046]),
    "avia": (-38.6, 38.6, [.022, .054, .067, .083, .107, .167, .166, .107, .083, .067, .054, .023]),
}  # fmt: skip
"""Lowest and highest elevation [deg], and the share of the points in each of twelve bands between."""
COVERAGE = {
    ("mid360", 0.5): {0.1: 0.243, 0.2: 0.428, 0.4: 0.681, 1.0: 0.890, 2.0: 0.987},
    ("mid360", 1.0): {0.1: 0.683, 0.2: 0.894, 0.4: 0.992, 1.0: 0.999, 2.0: 1.0},
    ("avia", 0.2): {0.1: 0.195, 0.2: 0.350, 0.4: 0.564, 1.0: 0.874, 2.0: 0.983},
    ("avia", 0.5): {0.1: 0.608, 0.2: 0.858, 0.4: 0.960, 1.0: 0.998, 2.0: 1.0},
}
"""Share of the cells of a size [deg] that are hit after some seconds, of those that are hit in 4 s."""


def directions(name: str, sweeps: int, seed: int = 0) -> Array:
    config = LidarConfig(**LidarConfig.preset_values(name))
    rays = RayPattern(config)
    return np.concatenate([rays.sweep(k * config.sweep_ns, seed).directions for k in range(sweeps)])


def angles_deg(along: Array) -> tuple[Array, Array]:
    return np.degrees(np.arctan2(along[:, 1], along[:, 0])), np.degrees(np.arcsin(along[:, 2]))


@pytest.mark.parametrize("name", BANDS)
def test_elevations_are_spread_as_livoxs_are(name: str) -> None:
    low, high, shares = BANDS[name]
    azimuth, elevation = angles_deg(directions(name, 40))
    assert (elevation.min(), elevation.max()) == (pytest.approx(low, abs=0.6), pytest.approx(high, abs=0.6))
    found = np.histogram(elevation, np.linspace(low, high, 13))[0] / len(elevation)
    assert found == pytest.approx(shares, abs=0.0025)
    if name == "avia":
        assert (azimuth.min(), azimuth.max()) == (
            pytest.approx(-35.31, abs=0.3),
            pytest.approx(35.31, abs=0.3),
        )
    else:
        assert np.histogram(azimuth, 12)[0] / len(azimuth) == pytest.approx(np.full(12, 1 / 12), abs=0.003)


@pytest.mark.parametrize(("name", "cell_deg"), COVERAGE)
def test_cells_fill_as_those_of_livoxs_tables(name: str, cell_deg: float) -> None:
    """Cells of equal angle, their azimuths scaled by the cosine; after 10 s hardly one is left."""
    azimuth, elevation = angles_deg(directions(name, 100))
    row = np.floor(elevation / cell_deg)
    column = np.floor(azimuth * np.cos(np.radians((row + 0.5) * cell_deg)) / cell_deg)
    cell, per_sweep = row * 1e5 + column, len(row) // 100
    whole = len(np.unique(cell[: 40 * per_sweep]))
    for seconds, share in COVERAGE[name, cell_deg].items():
        hit = len(np.unique(cell[: round(10 * seconds) * per_sweep]))
        assert hit / whole == pytest.approx(share, abs=0.022), seconds
    assert 1.0 <= len(np.unique(cell)) / whole < 1.004


def test_every_point_has_its_time_and_its_line() -> None:
    """The driver counts lines in the order of points: 4 in 20 µs, 6 in 25 µs."""
    for name, lines, first in (("mid360", 4, [0, 5000, 10000, 15000]), ("avia", 6, [0, 4167, 8333, 12500])):
        one = RayPattern(LidarConfig(**LidarConfig.preset_values(name))).sweep(0, 0)
        assert one.ring.tolist() == (list(range(lines)) * (len(one) // lines))
        assert one.offset_ns[:4].tolist() == first
        assert np.all(np.diff(one.offset_ns.astype(int)) > 0)


def test_rotors_go_on_and_begin_by_the_seed() -> None:
    """At 20 Hz the second sweep is the second half of the first at 10 Hz; another seed has other phases."""
    for name in BANDS:
        values = LidarConfig.preset_values(name)
        slow, fast = (RayPattern(LidarConfig(**{**values, "rate_hz": hz})) for hz in (10.0, 20.0))
        whole = slow.sweep(4_300_000_000, 3).directions
        later = fast.sweep(4_350_000_000, 3).directions
        assert np.abs(whole[len(later) :] - later).max() < 1e-9
        assert np.abs(whole - slow.sweep(4_300_000_000, 4).directions).max() > 0.1
        assert np.abs(whole - slow.sweep(4_400_000_000, 3).directions).max() > 0.1


def test_one_thin_wedge_deflects_by_its_angle_and_index() -> None:
    """(n − 1)·α beside the axis, round and round at the wedge's rate (paraxial optics)."""
    pattern = WedgePattern(
        wedge_deg=(1.0,),
        turns_hz=(10.0,),
        phase_deg=(0.0,),
        inclined=("exit",),
        field_deg=(-1, 1),
        width_deg=2,
    )
    config = LidarConfig(elevations_deg=(0.0,), columns=360, rate_hz=10.0, pattern=pattern)
    along = RayPattern(config).sweep(0, 0).directions
    away = np.degrees(np.arctan2(np.hypot(along[:, 1], along[:, 2]), along[:, 0]))
    assert away == pytest.approx(np.full(360, 0.51), abs=2e-4)
    around = np.unwrap(np.arctan2(along[:, 2], along[:, 1]))
    assert np.diff(around) == pytest.approx(np.full(359, 2 * np.pi / 360), abs=1e-7), "whole nanoseconds"


ROWS = {
    "avia": [
        (0, 0, -35.27, 2.24), (0, 5, -35.27, -2.24), (4001, 0, -23.08, -2.27), (4001, 5, -23.06, -6.66),
        (30011, 0, 16.98, 6.17), (30011, 5, 17.03, 1.79), (77777, 0, 6.48, 34.17), (77777, 5, 5.58, 28.32),
        (131313, 0, -25.67, 7.65), (131313, 5, -25.60, 3.26),
    ],
    "mid360": [
        (0, 0, -91.01, 52.16), (0, 3, -91.00, 43.85), (4001, 0, 26.54, 23.10), (4001, 3, 29.50, 26.80),
        (30011, 0, 93.30, 43.85), (30011, 3, 93.05, 52.16), (77777, 0, -15.28, -2.19),
        (77777, 3, -10.70, -1.79), (131313, 0, -89.50, 20.31), (131313, 3, -93.17, 16.51),
    ],
}  # fmt: skip
"""Number of the firing, line, azimuth and elevation [deg] in Livox's tables (livox_laser_simulation, MIT)."""


@pytest.mark.parametrize("name", ROWS)
def test_rays_are_those_of_livoxs_tables_at_their_phases(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All lines of a row of a table share their time; the fits are within half a degree of every row."""

    class Phases:
        def random(self, count: int | None = None) -> Array:
            """Those with which the tables begin: of turn, nod and azimuth; the wedges' are the preset's."""
            return np.array(0.0) if count is None else np.array([0.0009, -0.0014, 0.7492])

    monkeypatch.setattr(optics.clock, "stream", lambda *_: Phases())
    config = LidarConfig(**LidarConfig.preset_values(name))
    firing, line, azimuth, elevation = np.array(ROWS[name]).T
    time_s = 1e-9 * config.cycle_ns * firing
    all_lines = optics.pattern_directions(config, 0, np.arange(config.rings)[::-1], time_s)
    along = all_lines.reshape(len(firing), -1, 3)[np.arange(len(firing)), line.astype(int)]
    a, e = np.radians(azimuth), np.radians(elevation)
    rows = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    assert np.degrees(np.arccos(np.sum(along * rows, axis=1))).max() < 0.5
