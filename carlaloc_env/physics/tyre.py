"""Tyre forces from the shear of the contact patch, a state of each wheel.

Steady-state slip with spin is stiff (≈ 8500/v 1/s) and undefined at standstill. The shear u [m] with
relaxation, u' = v_slip − |v|·u/σ, is neither: at speed u/σ becomes the slip, at rest u is a spring that holds
the car on a slope (Pacejka, "Tyre and Vehicle Dynamics", chapter 7).
"""

from math import sqrt
from typing import Any

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.elementary_kernels import arctan, exp, sin
from carlaloc_env.core.jit import compiled

_C = 1.4
"""Shape factor C of Pacejka's Magic Formula."""
_E = -0.2
"""Its curvature factor E."""
_B = 1.0 / _C
"""Its stiffness factor B, such that the slope at zero is one."""
_R_PEAK = 2.69
"""Normalised slip at which the formula has its peak."""
_R_MAX = 4.0 * _R_PEAK
"""Greatest normalised slip; shear beyond it slides away."""
_SLIP_DAMPED_MPS = 0.3
"""Speed below which slip is damped [m/s]."""


@compiled
def advance_tyre(
    wheel: Any, car: Any, rolling_mps: float, slip_long: float, slip_lat: float, mu: float
) -> None:
    """Advance the shear of a tyre by one tick and set its forces.

    Args:
        wheel: Record of `WHEEL`; its load is that of now.
        car: Record of `CAR`.
        rolling_mps: Forward speed of the wheel over the ground [m/s].
        slip_long: Tread speed minus ground speed along the wheel [m/s]; > 0 drives.
        slip_lat: Minus the lateral speed of the contact patch [m/s].
        mu: Factor on the friction, 1 = dry asphalt.
    """
    load_n = wheel.load_n
    if load_n <= 0.0:
        # A lifted wheel forgets its shear.
        wheel.shear_long_m = wheel.shear_lat_m = 0.0
        wheel.force_long_n = wheel.force_lat_n = 0.0
        return
    speed = abs(rolling_mps)
    u = (wheel.shear_long_m + slip_long * TICK_S) / (1.0 + speed * TICK_S / car.relaxation_long_m)
    w = (wheel.shear_lat_m + slip_lat * TICK_S) / (1.0 + speed * TICK_S / car.relaxation_lat_m)
    stiff = 0.8 + 0.2 * mu
    d_long = car.mu_long * mu * load_n
    d_lat = lateral_mu(car, load_n) * mu * load_n
    e_long = car.slip_stiffness * load_n * stiff * u / (car.relaxation_long_m * d_long)
    e_lat = cornering_stiffness(car, load_n) * wheel.compliance * stiff * w / (car.relaxation_lat_m * d_lat)
    r = sqrt(e_long * e_long + e_lat * e_lat)
    if r > _R_MAX:
        shrink = _R_MAX / r
        u, w, e_long, e_lat, r = u * shrink, w * shrink, e_long * shrink, e_lat * shrink, _R_MAX
    wheel.shear_long_m, wheel.shear_lat_m = u, w
    shape = 1.0
    if r > 1e-9:
        x = _B * r
        shape = sin(_C * arctan(x - _E * (x - arctan(x)))) / r
    force_long, force_lat = d_long * e_long * shape, d_lat * e_lat * shape
    if speed < 6.0:
        # Without rolling, nothing else takes the swing out of the shear springs.
        damping = car.standstill_nspm * load_n / car.load_ref_n * exp(-speed)
        force_long += damping * max(-_SLIP_DAMPED_MPS, min(_SLIP_DAMPED_MPS, slip_long))
        force_lat += damping * max(-_SLIP_DAMPED_MPS, min(_SLIP_DAMPED_MPS, slip_lat))
    wheel.force_long_n, wheel.force_lat_n = force_long, force_lat


@compiled
def cornering_stiffness(car: Any, load_n: float) -> float:
    """Slope of lateral force over slip angle [N/rad], rising with load less than in proportion."""
    return float(car.cornering_n * sin(2.0 * arctan(load_n / car.cornering_load_n)))


@compiled
def lateral_mu(car: Any, load_n: float) -> float:
    """Peak lateral friction on dry asphalt under a load [N]."""
    return float(car.mu_lat * (1.0 - car.mu_lat_fall * (load_n - car.load_ref_n) / car.load_ref_n))
