"""Elementary functions of one number by fdlibm's algorithms, compiled: in + − × ÷ and √ alone.

A C library and NumPy choose code by the processor, with fused multiply-adds where it has them, and their
results differ in the last bit. These are the same on every processor, and within one unit of that bit of
the truth (`power` and the inverse functions within a few). Sources: Sun Microsystems, fdlibm 5.3: `k_sin.c`,
`k_cos.c`, `e_rem_pio2.c`, `e_exp.c`, `e_log.c`, `s_atan.c`.
"""

import math

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled

_TWO_OVER_PI = 6.36619772367581382433e-01
_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624871116645580e-21)
"""First, second and third 33 bits of π/2."""
_HALF_PI_REST = 8.47842766036889956997e-32
_LARGE = 1e6
"""Angles beyond this are first brought into ±2π by the double next to 2π."""
_SIN = (
    *(-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04),
    *(2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10),
)
_COS = (
    *(4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05),
    *(-2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11),
)
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_EXP = (
    *(1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05),
    *(-1.65339022054652515390e-06, 4.13813679705723846039e-08),
)
_INVERSE_LN2 = 1.44269504088896338700e00
_EXP_HIGHEST, _EXP_LOWEST = 7.09782712893383973096e02, -7.45133219101941108420e02
_LOG = (
    *(6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01),
    *(2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01),
    1.479819860511658591e-01,
)
_ATAN = (
    *(3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01),
    *(-1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02),
    *(6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02),
    *(-3.65315727442169155270e-02, 1.62858201153657823623e-02),
)
_ATAN_AT = (4.63647609000806093515e-01, 7.85398163397448278999e-01, 9.82793723247329054082e-01)
"""Arcs of the tangents ½, 1 and 3/2; π/2 comes from `math`."""
_ATAN_REST = (2.26987774529616870924e-17, 3.06161699786838301793e-17, 1.39033110312309984516e-17)
_HALF_PI_LOW = 6.12323399573676603587e-17
_HALF_ROOT = 0.7071067811865476
_LOG10_E = 0.4342944819032518


@compiled
def sin_cos(x: float) -> tuple[float, float]:
    """Sine and cosine of an angle [rad]."""
    if not abs(x) < np.inf:
        return np.nan, np.nan
    if abs(x) > _LARGE:
        x = np.fmod(x, 2.0 * math.pi)
    turns = np.floor(x * _TWO_OVER_PI + 0.5)
    first = x - turns * _HALF_PI[0]
    small = turns * _HALF_PI[1]
    second = first - small
    lost = (first - second) - small
    small = turns * _HALF_PI[2] - lost
    third = second - small
    rest = turns * _HALF_PI_REST - ((second - third) - small)
    high = third - rest
    low = (third - high) - rest
    z = high * high
    cubic = z * high
    tail = _SIN[1] + z * (_SIN[2] + z * (_SIN[3] + z * (_SIN[4] + z * _SIN[5])))
    sine = high - ((z * (0.5 * low - cubic * tail) - low) - cubic * _SIN[0])
    quartic = _COS[0] + z * (_COS[1] + z * (_COS[2] + z * (_COS[3] + z * (_COS[4] + z * _COS[5]))))
    half = 0.5 * z
    near_one = 1.0 - half
    cosine = near_one + (((1.0 - near_one) - half) + (z * (z * quartic) - high * low))
    quadrant = int(turns) & 3
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


@compiled
def sin(x: float) -> float:
    """Sine of an angle [rad]."""
    return sin_cos(x)[0] if x != 0.0 else x


@compiled
def cos(x: float) -> float:
    """Cosine of an angle [rad]."""
    return sin_cos(x)[1]


@compiled
def tan(x: float) -> float:
    """Tangent of an angle [rad]."""
    sine, cosine = sin_cos(x)
    return sine / cosine if x != 0.0 else x


@compiled
def exp(x: float) -> float:
    """e to the power x."""
    if not x < _EXP_HIGHEST:
        return x + np.inf
    if x < _EXP_LOWEST:
        return 0.0
    k = np.floor(x * _INVERSE_LN2 + 0.5)
    high, low = x - k * _LN2_HIGH, k * _LN2_LOW
    r = high - low
    t = r * r
    c = r - t * (_EXP[0] + t * (_EXP[1] + t * (_EXP[2] + t * (_EXP[3] + t * _EXP[4]))))
    return math.ldexp(1.0 - ((low - (r * c) / (2.0 - c)) - high), int(k))


@compiled
def log(x: float) -> float:
    """Natural logarithm."""
    if not 0.0 < x < np.inf:
        return -np.inf if x == 0.0 else (x if x > 0.0 else np.nan)
    m, k = math.frexp(x)
    if m < _HALF_ROOT:
        m, k = 2.0 * m, k - 1
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (_LOG[1] + w * (_LOG[3] + w * _LOG[5]))
    odd = z * (_LOG[0] + w * (_LOG[2] + w * (_LOG[4] + w * _LOG[6])))
    half = 0.5 * f * f
    return k * _LN2_HIGH - ((half - (s * (half + (even + odd)) + k * _LN2_LOW)) - f)


@compiled
def arctan(x: float) -> float:
    """Angle of a tangent [rad], −π/2 to π/2."""
    a = abs(x)
    if not a < 1e18:
        return math.copysign(0.5 * math.pi, x) if a > 0.0 else x
    if a < 7.0 / 16.0:
        at, rest, t = 0.0, 0.0, a
    elif a < 11.0 / 16.0:
        at, rest, t = _ATAN_AT[0], _ATAN_REST[0], (2.0 * a - 1.0) / (2.0 + a)
    elif a < 19.0 / 16.0:
        at, rest, t = _ATAN_AT[1], _ATAN_REST[1], (a - 1.0) / (a + 1.0)
    elif a < 39.0 / 16.0:
        at, rest, t = _ATAN_AT[2], _ATAN_REST[2], (a - 1.5) / (1.0 + 1.5 * a)
    else:
        at, rest, t = 0.5 * math.pi, _HALF_PI_LOW, -1.0 / a
    z = t * t
    w = z * z
    odd = z * (_ATAN[0] + w * (_ATAN[2] + w * (_ATAN[4] + w * (_ATAN[6] + w * (_ATAN[8] + w * _ATAN[10])))))
    even = w * (_ATAN[1] + w * (_ATAN[3] + w * (_ATAN[5] + w * (_ATAN[7] + w * _ATAN[9]))))
    return math.copysign(at - ((t * (odd + even) - rest) - t), x)


@compiled
def arctan2(y: float, x: float) -> float:
    """Angle of the point (x, y) [rad], −π to π."""
    if np.isnan(x) or np.isnan(y):
        return np.nan
    if y == 0.0:
        return math.copysign(math.pi if math.copysign(1.0, x) < 0.0 else 0.0, y)
    if x == 0.0:
        return math.copysign(0.5 * math.pi, y)
    angle = arctan(abs(y) / abs(x)) if abs(x) < np.inf or abs(y) < np.inf else 0.25 * math.pi
    if x < 0.0:
        angle = math.pi - (angle - 2.0 * _HALF_PI_LOW)
    return math.copysign(angle, y)


FUNCTIONS = (
    "sin", "cos", "tan", "arcsin", "arccos", "arctan", "exp", "log", "log10", "arctan2", "power",
)  # fmt: skip
"""Functions of `fill` by their number; the last two are of two numbers."""


@compiled
def fill(function: int, x: Array, y: Array) -> None:
    """Write a function of numbers x (N,), or of x and y (N,), over x.

    One function for all, since loading one from numba's files takes as long as computing 100 000 sines. Each
    kernel is called at one place, since every call of it is compiled anew.
    """
    for k in range(len(x)):
        a = x[k]
        if function < 3:
            sine, cosine = sin_cos(a)
            if function == 1:
                x[k] = cosine
            elif a != 0.0:
                x[k] = sine if function == 0 else sine / cosine
        elif function == 5:
            x[k] = arctan(a)
        elif function in (3, 4, 9):
            b = y[k] if function == 9 else math.sqrt((1.0 - a) * (1.0 + a))
            a, b = (b, a) if function == 4 else (a, b)
            x[k] = arctan2(a, b)
        else:
            if function != 6:
                a = log(a)
            if function == 8:
                a *= _LOG10_E
            elif function == 10:
                a = y[k] * a if y[k] != 0.0 else 0.0
            x[k] = a if 7 <= function <= 8 else exp(a)
