"""Elementary functions in plain arithmetic: the same bits on every processor, also in vector code.

The C library takes one call per number, and the last bit of its results depends on the library and
on the instructions that it chooses. These functions are branch-free polynomials that a compiler
vectorises: many numbers cost little more than one. Coefficients are the minimax polynomials of
fdlibm (Sun Microsystems 1993: k_sin.c, k_cos.c, s_atan.c, e_exp.c, e_log.c); the tests state the
error against NumPy's.
"""

from __future__ import annotations

import math

import numpy as np

from twin.compiled.function import jit

ROUND = 6755399441055744.0
"""1.5 * 2^52: adding and subtracting this number rounds to the nearest whole number."""
HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
"""pi / 2 in three parts, of 33 bits each but the last (fdlibm, e_rem_pio2.c)."""
TAN_PI_8 = 0.4142135623730950488
LOG2_E = 1.44269504088896338700
LN_2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
"""ln 2 in two parts, the first of 32 bits (fdlibm, e_exp.c)."""
SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip
ATAN = (
    3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
    -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02,
    6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02,
    -3.65315727442169155270e-02, 1.62858201153657823623e-02,
)  # fmt: skip
EXP = (
    1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05,
    -1.65339022054652515390e-06, 4.13813679705723846039e-08,
)  # fmt: skip
LOG = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01,
    2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01,
    1.479819860511658591e-01,
)  # fmt: skip
"""Coefficients of polynomials, the lowest power first."""
LOWEST, HIGHEST = -700.0, 700.0
"""Range of arguments of `exp`, in which its results are normal numbers."""
scalar = jit(forceinline=True)
"""Compile a function of scalars that is always inlined, also into loops over many vehicles."""


@scalar
def _sine(x):  # type: ignore[no-untyped-def]
    """sin on [-pi/4, pi/4]."""
    z = x * x
    r = SINE[1] + z * (SINE[2] + z * (SINE[3] + z * (SINE[4] + z * SINE[5])))
    return x + z * x * (SINE[0] + z * r)


@scalar
def _cosine(x):  # type: ignore[no-untyped-def]
    """cos on [-pi/4, pi/4]."""
    z = x * x
    r = COSINE[3] + z * (COSINE[4] + z * COSINE[5])
    r = COSINE[0] + z * (COSINE[1] + z * (COSINE[2] + z * r))
    return 1.0 - (0.5 * z - z * z * r)


@scalar
def sincos(x):  # type: ignore[no-untyped-def]
    """Return (sin, cos) of an angle [rad] of up to a million turns."""
    turns = x * (2.0 / math.pi) + ROUND
    quarter = turns - ROUND
    rest = ((x - quarter * HALF_PI[0]) - quarter * HALF_PI[1]) - quarter * HALF_PI[2]
    s, c = _sine(rest), _cosine(rest)
    # quarter modulo 4 as -2, -1, 0, 1 or 2
    part = quarter - 4.0 * ((0.25 * quarter + ROUND) - ROUND)
    odd = abs(part) == 1.0
    sine, cosine = (c, s) if odd else (s, c)
    if abs(part) == 2.0 or part == -1.0:
        sine = -sine
    if abs(part) == 2.0 or part == 1.0:
        cosine = -cosine
    return sine, cosine


@scalar
def sin(x):  # type: ignore[no-untyped-def]
    """Sine of an angle [rad]."""
    return sincos(x)[0]


@scalar
def cos(x):  # type: ignore[no-untyped-def]
    """Cosine of an angle [rad]."""
    return sincos(x)[1]


@scalar
def tan(x):  # type: ignore[no-untyped-def]
    """Tangent of an angle [rad]."""
    s, c = sincos(x)
    return s / c


@scalar
def _atan(x):  # type: ignore[no-untyped-def]
    """atan on [0, 1]."""
    far = x > TAN_PI_8
    t = (x - 1.0) / (x + 1.0) if far else x
    z = t * t
    w = z * z
    even = ATAN[4] + w * (ATAN[6] + w * (ATAN[8] + w * ATAN[10]))
    even = z * (ATAN[0] + w * (ATAN[2] + w * even))
    odd = w * (ATAN[1] + w * (ATAN[3] + w * (ATAN[5] + w * (ATAN[7] + w * ATAN[9]))))
    found = t - t * (even + odd)
    return 0.25 * math.pi + found if far else found


@scalar
def atan2(y, x):  # type: ignore[no-untyped-def]
    """Angle [rad] of the direction (x, y), from -pi to pi; 0 for (0, 0)."""
    a, b = abs(x), abs(y)
    large, small = max(a, b), min(a, b)
    angle = _atan(small / large if large > 0.0 else 0.0)
    if b > a:
        angle = 0.5 * math.pi - angle
    if x < 0.0:
        angle = math.pi - angle
    return -angle if y < 0.0 else angle


@scalar
def asin(x):  # type: ignore[no-untyped-def]
    """Angle [rad] of a sine, which is clamped to [-1, 1]."""
    s = min(max(x, -1.0), 1.0)
    return atan2(s, math.sqrt(abs((1.0 - s) * (1.0 + s))))


@scalar
def acos(x):  # type: ignore[no-untyped-def]
    """Angle [rad] of a cosine, which is clamped to [-1, 1]."""
    c = min(max(x, -1.0), 1.0)
    return atan2(math.sqrt(abs((1.0 - c) * (1.0 + c))), c)


@scalar
def exp(x):  # type: ignore[no-untyped-def]
    """Exponential function, relative error 2e-16; arguments are clamped to LOWEST..HIGHEST."""
    x = min(max(x, LOWEST), HIGHEST)
    shifted = x * LOG2_E + ROUND
    times = shifted - ROUND
    high, low = x - times * LN_2[0], times * LN_2[1]
    r = high - low
    z = r * r
    c = r - z * (EXP[0] + z * (EXP[1] + z * (EXP[2] + z * (EXP[3] + z * EXP[4]))))
    found = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    power = np.int64(np.float64(shifted).view(np.int64) + 1023) << 52
    return found * np.int64(power).view(np.float64)


@scalar
def log(x):  # type: ignore[no-untyped-def]
    """Natural logarithm of a normal positive number; NaN for 0 and below."""
    bits = np.float64(x).view(np.int64)
    power = (bits >> 52) - 1023
    part = np.int64((bits & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000).view(np.float64)
    large = part > 1.4142135623730951
    part = 0.5 * part if large else part
    times = float(power + 1 if large else power)
    f = part - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (LOG[1] + w * (LOG[3] + w * LOG[5]))
    odd = z * (LOG[0] + w * (LOG[2] + w * (LOG[4] + w * LOG[6])))
    half = 0.5 * f * f
    found = times * LN_2[0] - ((half - (s * (half + (even + odd)) + times * LN_2[1])) - f)
    return found if x > 0.0 else math.nan


@scalar
def hypot(x, y):  # type: ignore[no-untyped-def]
    """Length of (x, y); x * x + y * y must be within the range of floats."""
    return math.sqrt(x * x + y * y)


@scalar
def cross(a, b):  # type: ignore[no-untyped-def]
    """Vector product a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@scalar
def dot(a, b):  # type: ignore[no-untyped-def]
    """Scalar product of two vectors of 3."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
