"""Tyre forces from the shear of the contact patch, a state of each wheel.

Steady-state slip with wheel spin is stiff (≈ 8500/v 1/s) and undefined at standstill. The shear
u [m] with relaxation, u' = v_slip − |v|·u/σ, is neither: at speed u/σ becomes the slip, at rest u
is a spring that holds the car on a slope (Pacejka, "Tyre and Vehicle Dynamics", chapter 7).
"""

from __future__ import annotations

from math import atan, exp, sin, sqrt

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.physics.params import VehicleParams

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


class Tyre:
    """Shear state and forces of one tyre."""

    __slots__ = (
        "_compliance",
        "_params",
        "force_lat_n",
        "force_long_n",
        "shear_lat_m",
        "shear_long_m",
    )

    def __init__(self, params: VehicleParams, *, is_front: bool) -> None:
        self._params = params
        self._compliance = params.front_compliance if is_front else 1.0
        self.release()

    def release(self) -> None:
        """Forget the shear, as after lifting the wheel."""
        self.shear_long_m = self.shear_lat_m = 0.0
        self.force_long_n = self.force_lat_n = 0.0

    def update(self, load_n: float, rolling_mps: float, slip_long: float, slip_lat: float, mu: float) -> None:
        """Advance the shear by one tick and set the forces.

        Args:
            load_n: Normal force [N].
            rolling_mps: Forward speed of the wheel over the ground [m/s].
            slip_long: Tread speed minus ground speed along the wheel [m/s]; > 0 drives.
            slip_lat: Minus the lateral speed of the contact patch [m/s].
            mu: Factor on the friction, 1 = dry asphalt.
        """
        if load_n <= 0.0:
            self.release()
            return
        p = self._params
        speed = abs(rolling_mps)
        u = (self.shear_long_m + slip_long * TICK_S) / (1.0 + speed * TICK_S / p.relaxation_long_m)
        w = (self.shear_lat_m + slip_lat * TICK_S) / (1.0 + speed * TICK_S / p.relaxation_lat_m)
        stiff = 0.8 + 0.2 * mu
        d_long = p.mu_long * mu * load_n
        d_lat = lateral_mu(p, load_n) * mu * load_n
        e_long = p.slip_stiffness * load_n * stiff * u / (p.relaxation_long_m * d_long)
        e_lat = cornering_stiffness(p, load_n) * self._compliance * stiff * w / (p.relaxation_lat_m * d_lat)
        r = sqrt(e_long * e_long + e_lat * e_lat)
        if r > _R_MAX:
            shrink = _R_MAX / r
            u, w, e_long, e_lat, r = u * shrink, w * shrink, e_long * shrink, e_lat * shrink, _R_MAX
        self.shear_long_m, self.shear_lat_m = u, w
        if r > 1e-9:
            x = _B * r
            shape = sin(_C * atan(x - _E * (x - atan(x)))) / r
        else:
            shape = 1.0
        self.force_long_n = d_long * e_long * shape
        self.force_lat_n = d_lat * e_lat * shape
        if speed < 6.0:
            # Without rolling, nothing else takes the swing out of the shear springs.
            damping = p.standstill_nspm * load_n / p.load_ref_n * exp(-speed)
            self.force_long_n += damping * max(-_SLIP_DAMPED_MPS, min(_SLIP_DAMPED_MPS, slip_long))
            self.force_lat_n += damping * max(-_SLIP_DAMPED_MPS, min(_SLIP_DAMPED_MPS, slip_lat))


def cornering_stiffness(params: VehicleParams, load_n: float) -> float:
    """Slope of lateral force over slip angle [N/rad], rising with load less than in proportion."""
    return params.cornering_n * sin(2.0 * atan(load_n / params.cornering_load_n))


def lateral_mu(params: VehicleParams, load_n: float) -> float:
    """Peak lateral friction on dry asphalt under a load [N]."""
    return params.mu_lat * (1.0 - params.mu_lat_fall * (load_n - params.load_ref_n) / params.load_ref_n)
