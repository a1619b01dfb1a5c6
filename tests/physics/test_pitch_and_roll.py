"""Pitch and roll on a rough road against the linear model of a whole car with seven degrees of freedom."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.special import gamma, kv
from shared_fixtures.drives.rough_drives import SPEED_MPS, motion_at, motion_on

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.physics.params import RIDES, Ride, VehicleParams
from carlaloc_env.road.rough_surface import class_roughness_m3

WHEELS = ((True, 1.0), (True, -1.0), (False, 1.0), (False, -1.0))
"""Whether front, and side, of each wheel."""


def response(p: VehicleParams, f: float) -> NDArray[np.complex128]:
    """Heave [m], pitch and roll [rad] of the body per metre of road under each wheel at f [Hz], (3, 4)."""
    s = 2j * np.pi * f
    stiff, mass = np.zeros((7, 7), dtype=complex), np.diag([p.sprung_kg, *p.inertia_kgm2[1::-1], 0, 0, 0, 0])
    road = np.zeros((7, 4), dtype=complex)
    travel = np.zeros((4, 7))
    for k, (front, side) in enumerate(WHEELS):
        x, y = (p.wheelbase_m if front else 0.0) - p.cog_x_m, 0.5 * side * p.track_m
        travel[k, :3], travel[k, 3 + k] = (-1.0, x, -y), 1.0
        load = p.static_load_n[0 if front else 1]
        mass[3 + k, 3 + k] = load / 9.80665 * (1.0 - p.sprung_kg / p.mass_kg)
        stiff[3 + k, 3 + k] += p.tyre_npm
        road[3 + k, k] = p.tyre_npm
    for k, (front, _) in enumerate(WHEELS):
        axle = 0 if front else 1
        link = p.spring_npm[axle] + p.damper_nspm[axle] * s
        stiff += link * np.outer(travel[k], travel[k])
    for axle, (a, b) in enumerate(((0, 1), (2, 3))):
        bar = travel[a] - travel[b]
        stiff += p.anti_roll_npm[axle] * np.outer(bar, bar)
    result: NDArray[np.complex128] = np.linalg.solve(mass * s * s + stiff, road)[:3]
    return result


def expected_psd(ride: Ride, f: float) -> Array:
    """PSD of heave [m²/Hz], pitch and roll [rad²/Hz] on class B, (3,)."""
    p, n = ride.vehicle, f / SPEED_MPS
    b = 2 * np.pi * p.track_m * n
    # Waves above 10 m are the town's relief, whose waviness is the standard's.
    w = ride.waviness if n > 0.1 else 2.0
    own = 2.0 * (b / 2) ** (w / 2) * kv(w / 2, b) / gamma(w / 2)
    phase = np.array([np.exp(-2j * np.pi * n * (0.0 if front else p.wheelbase_m)) for front, _ in WHEELS])
    side = np.array([side for _, side in WHEELS])
    coherence = np.where(side[:, None] == side, 1.0, own)
    ground = class_roughness_m3("B") * (n / 0.1) ** -w / SPEED_MPS * coherence * np.outer(phase, phase.conj())
    gain = response(p, f)
    return np.real(np.einsum("ij,jk,ik->i", gain, ground, gain.conj()))


@pytest.mark.parametrize("ride", RIDES)
@pytest.mark.parametrize(("name", "axis", "row"), [("roll", 0, 2), ("pitch", 1, 1)])
def test_body_rates_are_those_of_the_linear_car(name: str, axis: int, row: int, ride: str) -> None:
    """RMS of roll and pitch rate within 12 % from 0.5 to 15 Hz: 1.2 and 1.0 °/s at 50 km/h on class B."""
    rate = motion_at(motion_on("B", ride=ride), 1.4).omega_body_radps[:, axis]
    f, power = welch(rate, fs=1.0 / TICK_S, nperseg=4096)
    band = (f >= 0.5) & (f <= 15.0)
    theory = np.array([(2 * np.pi * x) ** 2 * expected_psd(RIDES[ride], x)[row] for x in f[band]])
    found, expected = (np.degrees(np.sqrt(np.sum(p) * f[1])) for p in (power[band], theory))
    assert found == pytest.approx(expected, rel=0.12), name
    assert 0.5 < found < 2.0


def test_bars_have_the_share_of_roll_stiffness_that_real_cars_have() -> None:
    """The real ride's bars give 19 to 32 % of it: Ford Escort, BMW 320i, VW Vanagon of DOT's data."""
    p = RIDES["real"].vehicle
    bars = sum(p.anti_roll_npm) * p.track_m**2
    springs = sum(2.0 * rate * (0.5 * p.track_m) ** 2 for rate in p.spring_npm)
    assert 0.19 < bars / (bars + springs) < 0.32
    assert RIDES["standard"].vehicle == VehicleParams()
