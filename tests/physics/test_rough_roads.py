"""The body on roads with profiles: against the quarter car, ISO 2631 and a road without one."""

import numpy as np
import pytest
from scipy.signal import welch
from scipy.special import k1
from shared_fixtures.drives.rough_drives import PARAMS, SPEED_MPS, motion_at, motion_on, road

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_NS, TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.road.road_profile import LevelGrid, Relief, Roughness
from carlaloc_env.road.rough_surface import class_level, class_roughness_m3
from carlaloc_env.timeline.ego_spline import EgoTrack


def quarter_car(f: Array, axle: int) -> Array:
    """Gain of the body over the road of one corner of the ego, by frequency [Hz]."""
    p = PARAMS
    mass = p.static_load_n[axle] / 9.81
    body = mass * p.sprung_kg / p.mass_kg
    s = 2j * np.pi * f
    link = p.spring_npm[axle] + p.damper_nspm[axle] * s
    wheel = (mass - body) * s * s + link + p.tyre_npm
    return np.abs(p.tyre_npm * link / ((body * s * s + link) * wheel - link * link))


def wk(f: Array) -> Array:
    """Frequency weighting Wk of ISO 2631-1:1997, annex A."""
    s, two_pi = 2j * np.pi * f, 2 * np.pi
    w1, w2, w3, w5, w6 = (two_pi * x for x in (0.4, 100.0, 12.5, 2.37, 3.35))
    high = 1 / (1 + np.sqrt(2) * w1 / s + (w1 / s) ** 2)
    low = 1 / (1 + np.sqrt(2) * s / w2 + (s / w2) ** 2)
    turn = (1 + s / w3) / (1 + s / (0.63 * w3) + (s / w3) ** 2)
    step = (1 + s / (0.91 * w5) + (s / w5) ** 2) / (1 + s / (0.91 * w6) + (s / w6) ** 2) * (w5 / w6) ** 2
    return np.abs(high * low * turn * step)


@pytest.mark.parametrize("axle", [0, 1])
def test_the_body_answers_like_a_quarter_car(axle: int) -> None:
    """Vertical PSD above the middle of each axle, third octaves 0.5–16 Hz, within 3 dB.

    Theory: (2πf)⁴·|H|²·G_d(f/v)/v of class B, times (1 + γ)/2 since two wheels with the coherence γ of
    an isotropic surface carry the middle. Relief comes by the mesh, roughness by the wheels.
    """
    rise = motion_at(motion_on("B"), (1 - axle) * PARAMS.wheelbase_m).acceleration_world_mps2[:, 2]
    f, power = welch(rise, fs=1.0 / TICK_S, nperseg=4096)
    for low in 0.5 * 2.0 ** (np.arange(15) / 3):
        band = (f >= low) & (f < low * 2 ** (1 / 3))
        n = f[band] / SPEED_MPS
        b = 2 * np.pi * PARAMS.track_m * n
        ground = class_roughness_m3("B") * (n / 0.1) ** -2 / SPEED_MPS * 0.5 * (1 + b * k1(b))
        expected = (2 * np.pi * f[band]) ** 4 * quarter_car(f[band], axle) ** 2 * ground
        assert 10 * np.log10(power[band].sum() / expected.sum()) == pytest.approx(0.0, abs=3.0), low


def test_ride_comfort_is_that_of_a_saloon() -> None:
    """RMS of a_z at the front seat, weighted by Wk: 0.2–0.6 m/s² at 50 km/h on class B."""
    rise = motion_at(motion_on("B"), 1.4, 0.4).acceleration_world_mps2[:, 2]
    f, power = welch(rise, fs=1.0 / TICK_S, nperseg=4096)
    weighted = np.sqrt(np.sum(power[1:] * wk(f[1:]) ** 2) * f[1])
    assert 0.2 < weighted < 0.6


def test_the_weighting_is_that_of_the_standard() -> None:
    """Wk in thousandths at third octaves, table 3 of ISO 2631-1:1997."""
    found = 1e3 * wk(np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 31.5]))
    assert found == pytest.approx([418, 482, 531, 967, 1036, 768, 405], rel=0.02)


def test_roads_twice_as_rough_shake_twice_as_much() -> None:
    """Class C is twice as high as B, A half: the suspension is linear but for its stops."""
    tracks = [motion_on("A", 40.0), motion_on("B"), motion_on("C", 40.0)]  # of the same seed
    rises = [motion_at(track, 1.4).acceleration_world_mps2[: round(39.0 / TICK_S), 2] for track in tracks]
    spread = [float(rise.std()) for rise in rises]
    assert spread[1] / spread[0] == pytest.approx(2.0, rel=0.1)
    assert spread[2] / spread[1] == pytest.approx(2.0, rel=0.1)


def test_at_rest_a_rough_road_does_not_shake() -> None:
    """Parked on class C the specific force stays within 0.0003 m/s², and so it does on a smooth road."""
    level = LevelGrid.uniform(class_level("C"))
    for rough in (Roughness(3, level), None):
        with PhysicsWorld(*road(Relief(3, level), 60.0), roughness=rough) as world:
            car = EgoCar(world)
            car.reset((0.0, 0.0, 0.0), 0.3)
            track = EgoTrack()
            for _ in range(800):
                car.tick(Controls(brake=1.0))
                track.append(car.state().position_m, car.state().quat_xyzw)
        still = track.motion(np.arange(200, 790) * TICK_NS).acceleration_world_mps2
        assert still.std(axis=0).max() < 3e-4
