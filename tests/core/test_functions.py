"""Elementary functions as lists: against 40 digits and the C library, by NumPy and machine code."""

import itertools
import math

import mpmath
import numpy as np
import pytest

from suslov_fast.core.expressions.elementary import ELEMENTARY
from suslov_fast.core.expressions.numpy_evaluation import FUNCTIONS, OF_LIBRARY
from suslov_fast.core.llvm import compiler as machine_code
from suslov_fast.core.llvm.text import Code, Integers

SPECIAL = [
    0.0, 5e-324, 1e-310, 2.0**-1022, 1e-9, 0.5, 1.0 - 2.0**-53, 1.0, 1.5, 2.0, 3.0, 9.0, 44.0,
    709.5, 745.0, 1e3, 2.0**31, 2.0**52 + 1.0, 2.0**53, 1e22, 1.7e308, math.inf, math.nan,
]  # fmt: skip
SPECIAL = np.array([*SPECIAL, *(-x for x in SPECIAL)])


def expit(x):
    return 1 / (1 + mpmath.exp(-x))


EXACT = {
    "log2": lambda x: mpmath.log(x, 2),
    "pow": mpmath.power,
    "cbrt": lambda x: mpmath.sign(x) * mpmath.cbrt(abs(x)),
    "expit": expit,
    "logaddexp": lambda x, y: max(x, y) + mpmath.log1p(mpmath.exp(-abs(x - y))),
}
OF_NUMBERS = [name for name in ELEMENTARY if name != "scale"]  # the C library has none
OF_OTHERS = "tan", "expm1", "expit", "sinh", "cosh", "tanh", "log2", "log10", "hypot"


def of_size(rng, least, greatest, n):
    """Return n numbers of both signs from 10**least to 10**greatest."""
    return 10.0 ** rng.uniform(least, greatest, n) * rng.choice([-1.0, 1.0], n)


def arguments(name, rng, n):
    """Return arguments (operands, -) of all sizes where a function is neither 0, infinite nor NaN.

    Many are where reductions begin and end.
    """
    near_0, near_1 = of_size(rng, -20, 1, n), 1 + of_size(rng, -15, -0.1, n)
    if name in ("sin", "cos", "tan"):
        multiples = np.round(of_size(rng, 0, 9.3, n)) * (math.pi / 2)
        found = near_0, multiples, of_size(rng, -300, 308, n), rng.uniform(-50, 50, n)
    elif name in ("exp", "expm1", "sinh", "cosh", "expit", "tanh"):
        most = 20.0 if name == "tanh" else 708.0
        found = near_0, rng.uniform(-most, most, n), rng.uniform(-2, 2, n)
    elif name == "logaddexp":
        x = np.concatenate([of_size(rng, -300, 307, n), near_0, 700 * near_1, np.zeros(n)])
        y = np.concatenate([of_size(rng, -300, 307, n), near_1, x[2 * n : 3 * n] - near_0, near_0])
        return np.array([x, y])
    elif name == "log1p":
        found = near_0[near_0 > -1], near_1 - 1, abs(of_size(rng, -300, 308, n))
    elif name.startswith("log"):
        found = near_1, abs(of_size(rng, -323, 308, n))
    elif name == "pow":
        x = np.concatenate([abs(of_size(rng, -300, 300, n)), near_1])
        return np.array([x, rng.uniform(-700, 700, 2 * n) / np.log(x)])
    elif name == "hypot":
        x = of_size(rng, -300, 307, n)
        return np.array([x, np.fmin(abs(x), 1e290) * of_size(rng, -9, 9, n)])
    else:
        found = near_0, of_size(rng, -323, 308, n)
    return np.concatenate(found)[np.newaxis]


def exact(name, operands):
    with mpmath.workprec(1200 if name in ("sin", "cos", "tan") else 200):
        return +EXACT.get(name, getattr(mpmath, name, None))(*map(mpmath.mpf, operands))


def ulps(found, expected):
    """Return the error of a finite double in units of the last place of the exact value."""
    exponent = max(mpmath.frexp(expected)[1] - 1, -1022) - 52
    return float(abs(mpmath.mpf(found) - expected) / mpmath.mpf(2) ** exponent)


@pytest.mark.parametrize("name", OF_NUMBERS)
def test_errors_in_the_last_place(rng, name):
    given = arguments(name, rng, 400)
    found = FUNCTIONS[name](*given).tolist()
    assert np.isfinite(found).all()
    expected = [exact(name, each) for each in given.T.tolist()]
    if name == "logaddexp":  # of the larger operand if that is larger
        sizes = [max(abs(e), abs(max(each))) for e, each in zip(expected, given.T, strict=True)]
        errors = [
            float(abs(f - e) / math.ulp(s)) for f, e, s in zip(found, expected, sizes, strict=True)
        ]
        assert 0.5 < max(errors) < 4.0
        return
    assert 0.4 < max(map(ulps, found, expected)) < (3.0 if name in OF_OTHERS else 0.95)


def of_c(name, *operands):
    """Return the value of the C library, whose errors Python tells by exceptions."""
    x = operands[0]
    try:
        if name == "logaddexp":
            with np.errstate(all="ignore"):
                return float(np.logaddexp(*operands))
        if name == "expit":
            return 1 / (1 + math.exp(-x)) if x > -700 else math.exp(x)
        return getattr(math, name)(*operands)
    except OverflowError:
        odd = name == "pow" and abs(math.fmod(operands[1], 2)) == 1
        return math.copysign(math.inf, x) if odd or name == "sinh" else math.inf
    except ValueError:
        if name == "pow" and x == 0:  # to a negative power
            return math.copysign(math.inf, x) if abs(math.fmod(operands[1], 2)) == 1 else math.inf
        return -math.inf if name.startswith("log") and x == -(name == "log1p") else math.nan


@pytest.mark.parametrize("name", OF_NUMBERS)
def test_special_values_are_those_of_the_c_library(name):
    given = [*itertools.product(SPECIAL.tolist(), repeat=ELEMENTARY[name][1])]
    found = FUNCTIONS[name](*np.transpose(given))
    for operands, value in zip(given, found.tolist(), strict=True):
        expected = of_c(name, *operands)
        if math.isfinite(expected) and expected:
            assert abs(value - expected) <= 3 * math.ulp(expected), operands
        else:
            assert same_bits(value, expected), operands


def test_scale_is_the_power_of_2_that_makes_the_larger_modulus_2_to_4(rng):
    x, y = arguments("hypot", rng, 400)
    x = np.concatenate([x, [2.0**-1022, 1.7e308, 0.0, np.inf]])
    y = np.concatenate([y, [0.0, 1.0, 5e-324, 1.0]])
    found = FUNCTIONS["scale"](x, y)
    assert (np.frexp(found[:-2])[0] == 0.5).all()
    larger = found[:-2] * np.maximum(abs(x), abs(y))[:-2]
    assert larger.min() >= 2.0
    assert larger.max() < 4.0
    assert found[-2:].tolist() == [np.inf, 0.0]


def same_bits(found, expected):
    same = (found == expected) & (np.signbit(found) == np.signbit(expected))
    return np.all(same | (np.isnan(found) & np.isnan(expected)))


def code(name, count, W):
    """Return the address of code that writes f of lines of W lanes, and its number of lines."""

    def text_of(_, own, *_others):
        text = Code(W)
        text.begin(own, "given")
        *rows, lines = (Integers(text, "%given")[k] for k in range(count + 2))
        for line in text.each(lines):
            places = [row + line * (8 * W) for row in rows]
            values = {k: text.load(text.V, place) for k, place in enumerate(places[:-1])}
            text.carry_out([(name, count, tuple(range(count)))], values, None)
            text.store(text.V, values[count], places[-1])
        text.add("  ret i64 0")
        return text.finished()

    return machine_code.code_of(text_of, STEP, W)


class STEP:
    indices, D, is_long, key = np.empty((3, 0), int), 1, False, "STEP"


@pytest.mark.compiled
@pytest.mark.parametrize("W", [1, 8])
@pytest.mark.parametrize("name", [*ELEMENTARY, *OF_LIBRARY])
def test_machine_code_has_the_bits_of_numpy(rng, name, W):
    count = 2 if name in ("pow", "hypot", "logaddexp", "scale", "atan2") else 1
    n = 2304
    given = of_size(rng, -3, 3, (count, n)) * rng.choice([1.0, 1e-300, 1e5, 1e300], (count, n))
    for row in given:
        row[rng.permutation(n)[: n // 4]] = rng.choice(SPECIAL, n // 4)
        row[rng.permutation(n)[: n // 4]] = rng.uniform(-2, 2, n // 4)
    found = np.empty(n)
    rows = [*(row.ctypes.data for row in given), found.ctypes.data, n // W]
    machine_code.call(code(name, count, W), np.array(rows))
    assert same_bits(found, FUNCTIONS[name](*given))


def test_angles_nearest_to_multiples_of_a_quarter():
    """Remainders that cancel least and most, below 2**31; larger ones by libm."""
    angles = [6381956970095103.0 * 2.0**797, 5.319372648326541e255, 1e22, 2.0**31, 2.0**1023]
    angles += [math.nextafter(2.0**31, 0), math.pi, 1.5 * math.pi, 1e5 * math.pi, 11.0, 355.0]
    # The doubles that are nearest to multiples of pi / 2, by continued fractions of 2**k / pi.
    angles += [45.553093477052, 14461176.67027838, 321307.9594422229, 1698673.2849629424]
    for name in ("sin", "cos", "tan"):
        for x in angles:
            if abs(x) < 2.0**31:
                assert ulps(float(FUNCTIONS[name](x)), exact(name, [x])) < 0.9
            else:
                assert float(FUNCTIONS[name](x)) == getattr(math, name)(x)


def test_powers_that_are_exact():
    n = np.arange(-1074.0, 1024.0)
    assert (FUNCTIONS["pow"](2.0, n) == np.ldexp(1.0, n.astype(int))).all()
    assert (FUNCTIONS["log2"](np.ldexp(1.0, n.astype(int))) == n).all()
    small = np.arange(-2000.0, 2001.0)
    cubes = small * small * small  # NumPy 1.26 rounds powers with AVX-512
    assert (FUNCTIONS["cbrt"](cubes) == small).all()
    assert (FUNCTIONS["pow"](small, 3.0) == cubes).all()
