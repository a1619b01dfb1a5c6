"""Geodetic coordinates, compiled: an epoch of GNSS asks for them of single points, again and again."""

import math

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.elementary_kernels import arctan2, sin_cos
from carlaloc_env.core.jit import compiled


@compiled
def to_geodetic(points: Array, a_m: float, flattening: float) -> None:
    """Write latitude [rad], longitude [rad] and height [m] over Earth-centred points [m], rows (p, y, x, z).

    The distance p from the axis comes with the points, since a C library's `hypot` is not NumPy's.
    """
    e2, b_m = flattening * (2.0 - flattening), a_m * (1.0 - flattening)
    ep2 = e2 / (1.0 - e2)
    for k in range(len(points)):
        p, y, x, z = points[k, 0], points[k, 1], points[k, 2], points[k, 3]
        beta = arctan2(z * a_m, p * b_m)
        latitude, sine, cosine = beta, 0.0, 1.0
        for _ in range(3):
            sine, cosine = sin_cos(beta)
            latitude = arctan2(
                z + ep2 * b_m * sine * (sine * sine), p - e2 * a_m * cosine * (cosine * cosine)
            )
            sine, cosine = sin_cos(latitude)
            beta = arctan2((1.0 - flattening) * sine, cosine)
        n_m = a_m / math.sqrt(1.0 - e2 * (sine * sine))
        points[k, 0], points[k, 1] = latitude, arctan2(y, x)
        points[k, 2] = p * cosine + z * sine - n_m * (1.0 - e2 * (sine * sine))
