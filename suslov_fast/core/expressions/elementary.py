"""Elementary functions as expression programs on doubles.

Each function takes a `Number` for each operand, and returns the `Number` of its value. Programs
have no branches and no FMA, so their bits are the same on all machines. Errors are at most 1 ulp;
in functions made of others, such as `expm1`, 3 ulp. Special values agree with the C library.

A number in two parts is a sum high + low, whose low part is less than an ulp of the high part.
Coefficients of polynomials are minimax, by the Remez algorithm with 300 bits. Each is rounded to a
double before the next one is fitted.
"""

import functools
import struct

from .values import Number


def from_bits(bits):
    """Return the double with the 64 bits of the integer `bits`, for instructions on bits."""
    return struct.unpack("<d", struct.pack("<Q", bits))[0]


def _polynomial(coefficients, x):
    """Return c_0 + c_1 x + c_2 x**2 + ... by Estrin's scheme; the c_k are `coefficients`."""
    terms = [*coefficients]
    while len(terms) > 1:
        left = terms[len(terms) & ~1 :]
        pairs = zip(terms[::2], terms[1::2], strict=False)
        terms = [b * x + a for a, b in pairs] + left
        x = x * x
    return terms[0]


# --------------------------------------------------------------------------------------- two parts
_INFINITY = float("inf")
_UPPER = from_bits(0xFFFF_FFFF_F800_0000)  # a mask: without the last 27 bits, products are exact


def _sum(a, b):
    """Return a + b as a sum (high, low), if abs(a) >= abs(b), a = 0 or a + b needs no rounding."""
    high = a + b
    return high, b - (high - a)


def _difference(a, b):
    """Return a - b as a sum (high, low), if abs(a) >= abs(b), a = 0 or a - b needs no rounding."""
    high = a - b
    return high, (a - high) - b


def _split(a):
    """Return (upper, lower) with upper + lower = a: upper has 26 bits, and lower at most 27."""
    upper = a.then("bits_and", _UPPER)
    return upper, a - upper


def _product(a, b):
    """Return (high, low): high is a b rounded; low is a b - high, up to 2**-103 abs(a b)."""
    (a1, a2), (b1, b2), high = _split(a), _split(b), a * b
    return high, ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2


def _square(a):
    """Return (high, low): high is a**2 rounded; low is a**2 - high, up to 2**-103 a**2."""
    (a1, a2), high = _split(a), a * a
    return high, ((a1 * a1 - high) + (a1 + a1) * a2) + a2 * a2


# ----------------------------------------------------------------------------------- powers of two
# The sum x + _SHIFT has the integer nearest to x in its last bits.
_SHIFT = 1.5 * 2.0**52
_BIASED = _SHIFT + 1023.0
_TO_EXPONENT = from_bits(52)


def _nearest(x):
    """Return x rounded to an integer, for abs(x) < 2**51; NaN and infinity stay."""
    return (x + _SHIFT) - _SHIFT


def _power_of_two(n):
    """Return 2**n for an integer n from -1022 to 1023."""
    return (n + _BIASED).then("bits_shl", _TO_EXPONENT)


def _scaled(x, n):
    """Return x 2**n, rounded once, for an integer n; 2**n alone may overflow or underflow."""
    half = _nearest(n * 0.5)
    return (x * _power_of_two(half)) * _power_of_two(n - half)


# ------------------------------------------------------------------------------- exponentials
# exp(x) = 2**n exp(r) with r = x - n log 2 from -log(2) / 2 to log(2) / 2, in two parts. n times
# the first part of log 2 is exact.
_PER_LN2 = float.fromhex("0x1.71547652b82fep+0")
_LN2 = float.fromhex("0x1.62e42fefa3800p-1"), float.fromhex("0x1.ef35793c76730p-45")
# Coefficients of (exp(r) - 1 - r) / r**2 in powers of r.
_EXP = tuple(map(float.fromhex, (
    "0x1.0000000000000p-1", "0x1.5555555555556p-3", "0x1.5555555555556p-5",
    "0x1.11111111109a6p-7", "0x1.6c16c16c15dadp-10", "0x1.a01a01a7ceafbp-13",
    "0x1.a01a01a942812p-16", "0x1.71de0d857c0e7p-19", "0x1.27e4d4b126346p-22",
    "0x1.af390aaa2f741p-26", "0x1.1f7f694802139p-29",
)))  # fmt: skip
# Coefficients of (sinh(r) - r) / r**3 in powers of r**2.
_SINH = tuple(map(float.fromhex, (
    "0x1.5555555555559p-3", "0x1.111111110f62ap-7", "0x1.a01a01b02055dp-13",
    "0x1.71ddf7b2da8a2p-19", "0x1.af5fe5614b704p-26",
)))  # fmt: skip


def _less_log_2(x, low=None):
    """Return n = round(x / log(2)), high and rest; high + rest is x + (low or 0) - n log(2)."""
    n = _nearest(x * _PER_LN2)
    first, second = x - n * _LN2[0], n * _LN2[1]
    if low is not None:
        second = second - low
    return n, *_difference(first, second)


def _exp_of(r, low):
    """Return exp(r + low) as a sum (high, rest), for abs(r) <= log(2) / 2 and a tiny `low`."""
    high, rest = _sum(1.0, r)
    return high, rest + (low + (r * r) * _polynomial(_EXP, r))


def exp(x):
    n, *r = _less_log_2(x.within(-746.0, 710.0))
    high, low = _exp_of(*r)
    return _scaled(high + low, n)


def expm1(x):
    """Return exp(x) - 1 as (u - 1) x / log(u), where u is exp(x) rounded."""
    u = exp(x)
    less = u - 1.0
    result = less * (x / log(u))
    is_exact = u.equals(1.0) | (abs(x) > 40.0)
    return is_exact.select(u.equals(1.0).select(x, less), result)


def expit(x):
    """Return 1 / (1 + exp(-x))."""
    return 1.0 / (1.0 + exp(-x))


def _hyperbolic(x):
    """Return n = round(x / log(2)), sinh(x) / 2**(n - 1) and cosh(x) / 2**(n - 1), for x >= 0."""
    n, r, low = _less_log_2(x)
    high, rest = _exp_of(r, low)
    e = high + rest
    inverse = _power_of_two(-2.0 * n.within(-99.0, 99.0)) / e
    z = r * r
    near_0 = r + (r * (z * _polynomial(_SINH, z)) + low)
    return n, n.equals(0.0).select(near_0 + near_0, e - inverse), e + inverse


def sinh(x):
    n, result, _ = _hyperbolic(abs(x).within(0.0, 712.0))
    return _scaled(result, n - 1.0).then("copysign", x)


def cosh(x):
    n, _, result = _hyperbolic(abs(x).within(0.0, 712.0))
    return _scaled(result, n - 1.0)


def tanh(x):
    _, above, below = _hyperbolic(abs(x).within(0.0, 40.0))
    return (above / below).then("copysign", x)


# --------------------------------------------------------------------------------- logarithms
# x = 2**k m with m from sqrt(1 / 2) to sqrt(2), and log(m) = 2 artanh(s) with s = f / (2 + f),
# f = m - 1.
_ROOT_HALF = 0x3FE6_A09E_667F_3BCD
_ONE = 0x3FF0_0000_0000_0000
_FRACTION = from_bits(0x000F_FFFF_FFFF_FFFF)
_LEAST_NORMAL = 2.0**-1022
# Coefficients of (2 artanh(s) - 2 s) / s**3 in powers of s**2.
_LOG = tuple(map(float.fromhex, (
    "0x1.5555555555593p-1", "0x1.999999997f9ffp-2", "0x1.2492494229124p-2",
    "0x1.c71c51d96a36dp-3", "0x1.7466494421c7ap-3", "0x1.39a0a1ac066eap-3",
    "0x1.2f110066a41e3p-3",
)))  # fmt: skip
# Coefficients of ((2 artanh(s) - 2 s) / s**3 - 2 / 3) / s**2 in powers of s**2.
_LOG_REST = tuple(map(float.fromhex, (
    "0x1.9999999999996p-2", "0x1.2492492492f56p-2", "0x1.c71c71c59593bp-3",
    "0x1.745d1829f0f0cp-3", "0x1.3b1364998027ep-3", "0x1.11207720110e8p-3",
    "0x1.de3c158d6eed5p-4", "0x1.ead1accddc524p-4",
)))  # fmt: skip
# Coefficients of m**(1/3) in powers of m, for m from 1/2 to 4.
_CBRT = tuple(map(float.fromhex, (
    "0x1.dd2b893657793p-2", "0x1.aba59ae8e77d7p-1", "-0x1.b5648b480154dp-2",
    "0x1.3a835faea1671p-3", "-0x1.e050be3ea0d9ep-6", "0x1.2565a3b84c2f1p-9",
)))  # fmt: skip
_TWO_THIRDS = 2 / 3, float.fromhex("0x1.5555555555555p-55")
_PER_LN10 = float.fromhex("0x1.bcb7b1526e50ep-2")


def _exponent(x):
    """Return an integer k and f with x = 2**k (1 + f) > 0; 1 + f is from 2**-0.5 to 2**0.5."""
    is_small = x < _LEAST_NORMAL
    x = is_small.select(x * 2.0**54, x)
    parts = x.then("bits_sub", from_bits(_ROOT_HALF))
    k = parts.then("bits_add", from_bits(_ONE)).then("bits_lshr", _TO_EXPONENT)
    k = k.then("bits_or", 2.0**52) - (2.0**52 + 1023.0)
    k = is_small.select(k - 54.0, k)
    m = parts.then("bits_and", _FRACTION).then("bits_add", from_bits(_ROOT_HALF))
    return k, m - 1.0


def _with_special_values(x, zero, result):
    """Return `result` = log(x - zero), with -inf at x = zero, NaN below it, and inf at infinity."""
    ends = x.equals(zero).select(-_INFINITY, float("nan"))
    return (x > zero).select((x < _INFINITY).select(result, x), ends)


def _log(k, f, rest=None):
    """Return k log(2) + log(1 + f) + (rest or 0), for k and f of `_exponent` and a small `rest`."""
    s = f / (2.0 + f)
    z, half = s * s, 0.5 * (f * f)
    low = k * _LN2[1] if rest is None else k * _LN2[1] + rest
    low = half - (s * (half + z * _polynomial(_LOG, z)) + low)
    return k * _LN2[0] - (low - f)


def log(x):
    return _with_special_values(x, 0.0, _log(*_exponent(x)))


def log1p(x):
    """Return log(1 + x) = log(u) + rest / u, where u is 1 + x rounded, and rest is 1 + x - u."""
    u = 1.0 + x
    rest = (x > 1.0).select(1.0 - (u - x), x - (u - 1.0))
    result = _log(*_exponent(u), rest / u)
    result = x.equals(0.0).select(x, result)
    return _with_special_values(x, -1.0, result)


def logaddexp(x, y):
    """Return log(exp(x) + exp(y)); its error is up to 4 ulp of max(x, y), or of a larger result."""
    a, b = x.then("max", y), x.then("min", y)
    below = a.equals(b).select(0.0, b - a)  # not the difference of infinities
    result = a + log1p(exp(below))
    return x.equals(x).select(y.equals(y).select(result, y), x)


def _log_in_parts(f):
    """Return log(1 + f) as a sum (high, low), with a relative error below 2**-62."""
    below, rest = _sum(2.0, f)
    inverse = 1.0 / below
    s = f * inverse
    product, error = _product(s, below)
    s = s, (((f - product) - error) - s * rest) * inverse
    z, low = _square(s[0])
    z = z, low + (s[0] + s[0]) * s[1]
    c, low = _sum(_TWO_THIRDS[0], z[0] * _polynomial(_LOG_REST, z[0]))
    c = c, low + _TWO_THIRDS[1]
    for factor in (z, s):  # s z c
        product, low = _product(factor[0], c[0])
        c = product, low + (factor[0] * c[1] + factor[1] * c[0])
    high, low = _sum(s[0] + s[0], c[0])
    return _sum(high, low + ((s[1] + s[1]) + c[1]))


def log2(x):
    """Return the logarithm of x with base 2, exact for powers of 2."""
    k, f = _exponent(x)
    return _with_special_values(x, 0.0, k + _PER_LN2 * _log(0.0, f))


def log10(x):
    return _PER_LN10 * log(x)


# -------------------------------------------------------------------------------------- powers
def pow(x, y):
    """Return x**y = exp(y log(x)), where log(x) is a sum high + low of two doubles."""
    size = abs(x)
    k, f = _exponent(size)
    high, low = _log_in_parts(f)
    high, rest = _sum(k * _LN2[0], high)
    high, low = _sum(high, rest + (low + k * _LN2[1]))
    high = (size > 0.0).select((size < _INFINITY).select(high, size), -_INFINITY)
    high = size.equals(size).select(high, size)
    product, rest = _product(y, high)
    rest = rest + y * low
    rest = (abs(product) < 800.0).select(rest, 0.0)
    n, *r = _less_log_2(product.within(-800.0, 800.0), rest)
    high, low = _exp_of(*r)
    result = _scaled(high + low, n)
    is_integer, half = y.then("floor").equals(y), y * 0.5
    is_even = half.then("floor").equals(half)
    sign = x.then("bits_and", -0.0)
    odd = result.then("bits_or", sign)
    result = is_integer.select(is_even.select(result, odd), result)
    has_none = (x < 0.0) & (x > -_INFINITY)
    result = is_integer.select(result, has_none.select(float("nan"), result))
    result = y.equals(y).select(result, y)
    is_one = x.equals(1.0) | y.equals(0.0) | (size.equals(1.0) & abs(y).equals(_INFINITY))
    return is_one.select(1.0, result)


def cbrt(x):
    """Return the cube root of x: its modulus is 2**k m**(1/3), if abs(x) = 8**k m, m from 1/2 to 4.

    A polynomial starts Halley's method; the result of a step is rounded to 26 bits, so that its
    square is exact. Another step follows.
    """
    size = abs(x)
    is_small = size < _LEAST_NORMAL
    scaled = is_small.select(size * 2.0**54, size)
    exponent = scaled.then("bits_lshr", _TO_EXPONENT).then("bits_or", 2.0**52)
    k = _nearest((exponent - (2.0**52 + 1023.0)) * (1.0 / 3.0))
    m = scaled.then("bits_sub", (3.0 * k + _SHIFT).then("bits_shl", _TO_EXPONENT))
    t = _polynomial(_CBRT, m)
    cube = t * t * t
    t = (t * ((cube + 2.0 * m) / (2.0 * cube + m))).then("bits_and", _UPPER)
    quotient = m / (t * t)
    t = t + t * ((quotient - t) / ((t + t) + quotient))
    k = is_small.select(k - 18.0, k)
    t = t.then("bits_add", (k + _SHIFT).then("bits_shl", _TO_EXPONENT)).then("copysign", x)
    return ((size > 0.0) & (size < _INFINITY)).select(t, x)


def hypot(x, y):
    """Return sqrt(x**2 + y**2) without overflow; inf where x or y is infinite."""
    x, y = abs(x), abs(y)
    a, b = x.then("max", y), x.then("min", y)
    is_large, is_small = a > 2.0**500, a < 2.0**-500
    scale = is_large.select(2.0**-600, is_small.select(2.0**600, 1.0))
    back = is_large.select(2.0**600, is_small.select(2.0**-600, 1.0))
    a, b = a * scale, b * scale
    root = (a * a + b * b).sqrt()
    result = a.equals(0.0).select(a, root * back)
    total = x + y
    result = total.equals(total).select(result, total)
    return (x.equals(_INFINITY) | y.equals(_INFINITY)).select(_INFINITY, result)


def scale(x, y):
    """Return the power of 2 by which the larger modulus of x and y is from 2 to 4.

    It is inf where both are below the least normal number, and 0 where one is infinite.
    """
    x, y = x.then("bits_and", _INFINITY), y.then("bits_and", _INFINITY)
    return Number(x.emit, _INFINITY).then("bits_sub", x.then("max", y))


# ------------------------------------------------------------------------------------- angles
# x = n pi / 2 + r, r from -pi / 4 to pi / 4 in two parts. For abs(x) < 2**31, the products of n
# with all parts of pi / 2 but the last one are exact. r is as accurate for each x as two parts
# can be, because no double of this size is nearer to a multiple of pi / 2 than 2**-62. Larger
# angles have the functions of the C library.
LARGE_ANGLE, OF_ANGLES = 2.0**31, ("sin", "cos", "tan")
_PER_QUARTER = float.fromhex("0x1.45f306dc9c883p-1")
_QUARTER = tuple(map(float.fromhex, (
    "0x1.921fb00000000p+0", "0x1.5110b00000000p-22", "0x1.1846980000000p-44",
    "0x1.3198800000000p-69", "0x1.1701b839a2520p-88",
)))  # fmt: skip
# Coefficients of (sin(r) - r) / r**3 and (cos(r) - 1 + r**2 / 2) / r**4 in powers of r**2.
_SIN = tuple(map(float.fromhex, (
    "-0x1.5555555555549p-3", "0x1.111111110f892p-7", "-0x1.a01a019c1219dp-13",
    "0x1.71de3576bbc75p-19", "-0x1.ae5e64a8f48c2p-26", "0x1.5d925ec785876p-33",
)))  # fmt: skip
_COS = tuple(map(float.fromhex, (
    "0x1.555555555554cp-5", "-0x1.6c16c16c15210p-10", "0x1.a01a019cbcdb1p-16",
    "-0x1.27e4f81048a1ep-22", "0x1.1ee9ef555464dp-29", "-0x1.8fb002b9251dap-37",
)))  # fmt: skip


def _less_quarters(x):
    """Return n + _SHIFT, high and low, with high + low = x - n pi / 2, for x >= 0.

    n is round(2 x / pi), in the last bits of n + _SHIFT. If high is tiny, low may be larger.
    """
    n = _nearest(x * _PER_QUARTER)
    r = (x - n * _QUARTER[0]) - n * _QUARTER[1]  # exact
    r, first = _difference(r, n * _QUARTER[2])
    r, second = _difference(r, n * _QUARTER[3])
    return n + _SHIFT, r, (first + second) - n * _QUARTER[4]


def _sine_and_cosine(x):
    """Return n + _SHIFT, and sin(r) and cos(r) as sums (high, low), for x = r + n pi / 2 >= 0."""
    n, r, low = _less_quarters(x)
    z = r * r
    cosine, rest = _difference(1.0, 0.5 * z)
    cube = r * z  # terms that do not wait for a polynomial are added first
    sine = r, (cube * _SIN[0] + low * cosine) + (cube * z) * _polynomial(_SIN[1:], z)
    return n, sine, (cosine, (rest - r * low) + (z * z) * _polynomial(_COS, z))


def _is_odd(shifted):
    """Return the truth value that n is odd, where `shifted` is n + _SHIFT = n + 1.5 * 2**52."""
    return shifted.then("bits_shl", from_bits(63)).then("bits_or", 1.0) < 0.0


def _signed(x, shifted, *signs):
    """Return x, negated once for each negative number in `signs`, and once if n mod 4 > 1.

    `shifted` is n + _SHIFT, which has the number n of quarters of a turn in its last bits.
    """
    x = x.then("bits_xor", shifted.then("bits_shl", from_bits(62)).then("bits_and", -0.0))
    for sign in signs:
        x = x.then("bits_xor", sign.then("bits_and", -0.0))
    return x


def sin(x):
    n, (sine, first), (cosine, second) = _sine_and_cosine(abs(x))
    return _signed(_is_odd(n).select(cosine + second, sine + first), n, x)


def cos(x):
    n, (sine, first), (cosine, second) = _sine_and_cosine(abs(x))
    return _signed(_is_odd(n).select(sine + first, cosine + second), n + 1.0)


def tan(x):
    """Return the tangent of x = r + n pi / 2: sin(r) / cos(r), or -cos(r) / sin(r) if n is odd."""
    n, (sine, first), (cosine, second) = _sine_and_cosine(abs(x))
    sine, cosine, is_odd = sine + first, cosine + second, _is_odd(n)
    result = is_odd.select(-cosine, sine) / is_odd.select(sine, cosine)
    return result.then("bits_xor", x.then("bits_and", -0.0))


# The functions by the names of their instructions, with the number of operands.
ELEMENTARY = {
    function.__name__: (function, 1)
    for function in (exp, expm1, expit, sinh, cosh, tanh, log, log1p, log2, log10, cbrt,
                     sin, cos, tan)
} | {function.__name__: (function, 2) for function in (pow, hypot, logaddexp, scale)}  # fmt: skip


@functools.cache
def list_of(name):
    """Return the operations of function `name` on values 0, 1, ..., and the result's number."""
    function, count = ELEMENTARY[name]
    operations = []

    def emit(instruction, *operands):
        operations.append((instruction, count + len(operations), operands))
        return operations[-1][1]

    return operations, function(*(Number(emit, k) for k in range(count))).number
