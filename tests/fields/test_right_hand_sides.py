"""`Field`: right-hand sides as lists of operations, their derivatives, and texts."""

import json
import math
import threading
from fractions import Fraction

import mpmath as mp
import numpy as np
import pandas
import pytest
from scipy import special

from suslov_fast import Field, flow

RNG = np.random.default_rng


# ------------------------------------------------------------------------------------ bits of NumPy
BITS = {
    "arithmetic": lambda a, b: (a * b - a / b + 3.0 * b, (a - 0.1) / (b + 7) * a),
    "roots": lambda a, b: (np.sqrt(abs(a)) / np.sqrt(b * b + 1), np.abs(a - b)),
    "comparisons": lambda a, b: (
        1.0 * (a < b) + 2.0 * (a >= b) * (b > 0.3),
        1.0 * ((a > 0) & ~(b <= 0) | (a == b)) - (a != b),
    ),
    "their names": lambda a, b: (
        1.0 * np.bitwise_or(a > b, np.invert(b > 0)),
        1.0 * np.logical_and(a > 0, np.bitwise_not(b > 0)),
    ),
    "where": lambda a, b: (np.where(a > b, a, 1 / b), np.where((a > 0) ^ (b > 0), a * b, 2.0)),
    "clip": lambda a, b: (np.clip(a, -0.5, 0.5), np.minimum(a, np.maximum(b, 0.1))),
    "interp": lambda a, b: (
        np.interp(a, [-1.0, -0.2, 0.1, 0.7, 1.3], [2.0, -1.0, 0.3, 5.0, 4.0]),
        np.interp(b, [-0.3, 0.6], [0.1, 0.7], left=-3.0, right=9.0),
    ),
    "steps": lambda a, b: (np.sign(a) + np.floor(3 * b), np.heaviside(b, 0.5) * np.ceil(a)),
    "square": lambda a, b: (a**2 + np.square(b), a**-1 + abs(b) ** 0.5),
}


@pytest.mark.parametrize("kind", BITS)
def test_values_have_the_bits_of_numpy(kind):
    g = BITS[kind]
    field = Field(lambda x: g(*x), "a b")
    x = RNG(2).normal(size=(2000, 2))
    x[:10] = np.round(x[:10], 1)
    x[10:15, 1] = x[10:15, 0]
    x[15:20] = [[-1.0, -0.3], [-0.2, 0.6], [0.1, 0.6], [0.7, -0.3], [1.3, 0.6]]
    expected = np.stack(np.broadcast_arrays(*g(*x.T)), axis=-1) + 0.0
    assert np.array_equal(field(x) + 0.0, expected)


def test_a_branch_that_is_not_taken_may_be_nan():
    field = Field(lambda x: (np.where(x[0] > 0, np.log(x[0]), x[0]),), "x")
    assert field([-2.0]) == -2.0
    assert field.jacobian([-2.0]) == 1.0
    assert np.isnan(Field(lambda x: (np.maximum(np.log(x[0]), 0),), "x")([-2.0]))


# ----------------------------------------------------------------- random expressions, in 60 digits
ONE = {
    "exp": mp.exp, "expm1": mp.expm1, "exp2": lambda a: mp.mpf(2) ** a, "sin": mp.sin,
    "cos": mp.cos, "tan": mp.tan, "sinh": mp.sinh, "cosh": mp.cosh, "tanh": mp.tanh,
    "arctan": mp.atan, "arcsinh": mp.asinh,
    "cbrt": lambda a: mp.sign(a) * mp.root(abs(a), 3),
    "erf": mp.erf, "erfc": mp.erfc, "expit": lambda a: 1 / (1 + mp.exp(-a)),
    "absolute": abs, "square": lambda a: a * a,
}  # fmt: skip
POSITIVE = {
    "log": mp.log, "log1p": mp.log1p, "log2": lambda a: mp.log(a) / mp.log(2),
    "log10": mp.log10, "sqrt": mp.sqrt, "arccosh": lambda a: mp.acosh(1 + a),
    "power": lambda a: a ** mp.mpf(2.3), "half": lambda a: a ** mp.mpf(-1.5),
}  # fmt: skip
BELOW_1 = {"arcsin": mp.asin, "arccos": mp.acos, "arctanh": mp.atanh}
TWO = {
    "add": lambda a, b: a + b, "subtract": lambda a, b: a - b, "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b, "arctan2": mp.atan2, "hypot": mp.hypot,
    "logaddexp": lambda a, b: mp.log(mp.exp(a) + mp.exp(b)),
}  # fmt: skip


def _in_numpy(name, *a):
    if name in ("erf", "erfc", "expit"):
        return getattr(special, name)(*a)
    if name in POSITIVE:
        positive = np.abs(a[0])
        if name in ("power", "half"):
            return positive ** (2.3 if name == "power" else -1.5)
        return getattr(np, name)(1 + positive if name == "arccosh" else positive)
    return getattr(np, name)(np.tanh(a[0]) if name in BELOW_1 else a[0], *a[1:])


def _in_mpmath(name, *a):
    if name in POSITIVE:
        return POSITIVE[name](abs(a[0]))
    if name in BELOW_1:
        return BELOW_1[name](mp.tanh(a[0]))
    return (ONE | TWO)[name](*a)


@pytest.mark.parametrize("f", [lambda x: special.erfc(x), lambda x: math.erfc(x[0])])
def test_erfc_has_all_digits(f):
    """Where 1 - erf(x) has none; also in machine code: x' = erfc(y) with y' = 0."""
    np.testing.assert_allclose(Field(f, 1)([26.0]), [float(mp.erfc(26))], rtol=1e-14)
    motion = flow(Field(lambda z: (*np.atleast_1d(f(z[1:])), 0.0), 2), [0.0, 26.0], time=3.0)
    np.testing.assert_allclose(motion.states[-1, 0], 3 * float(mp.erfc(26)), rtol=1e-14)


def random_tree(rng, depth):
    if depth == 0 or rng.random() < 0.1:
        return int(rng.integers(3)) if rng.random() < 0.8 else float(np.round(rng.normal(), 2))
    names = [*ONE, *POSITIVE, *BELOW_1, *[*TWO] * 4]
    name = names[rng.integers(len(names))]
    return (name, *(random_tree(rng, depth - 1) for _ in range(2 if name in TWO else 1)))


def value_of(tree, x, function, number):
    if isinstance(tree, int):
        return x[tree]
    if isinstance(tree, float):
        return number(tree)
    name, *parts = tree
    return function(name, *(value_of(part, x, function, number) for part in parts))


def test_values_and_derivatives_of_random_expressions_in_60_digits():
    rng, compared = RNG(4), 0
    with mp.workdps(60):
        while compared < 60:
            tree, x = random_tree(rng, 3), rng.uniform(0.3, 1.4, size=3)

            def exact(*s, tree=tree):
                return mp.mpf(value_of(tree, s, _in_mpmath, mp.mpf))

            field = Field(lambda s, tree=tree: (value_of(tree, s, _in_numpy, float), 0, 0), 3)
            numbers = [*map(mp.mpf, x)]
            try:
                value = exact(*numbers)
                places = [tuple(int(i == j) for i in range(3)) for j in range(3)]
                slopes = [mp.diff(exact, numbers, n=place) for place in places]
            except (ZeroDivisionError, ValueError, OverflowError, TypeError):
                continue
            if not 1e-3 < abs(value) < 1e3 or max(map(abs, slopes)) > 1e4:
                continue
            compared += 1
            found = field(x)[0], *field.jacobian(x)[0]
            for one, other in zip(found, (value, *slopes), strict=True):
                assert abs(one - other) <= 1e-11 * (1 + abs(other)), (tree, x)


# ------------------------------------------------------------------------------------- f' by rule
@pytest.mark.parametrize(
    ("f", "x", "slope"),
    [
        (abs, 0.0, 0.0),
        (abs, 5e-324, 1.0),
        (abs, -5e-324, -1.0),
        (lambda a: np.maximum(a, 2 * a), 1e-300, 2.0),
        (lambda a: np.clip(a, 0, 1), 1e-300, 1.0),
        (np.sign, 0.5, 0.0),
        (np.floor, 0.5, 0.0),
        (lambda a: np.heaviside(a, 1), 0.0, 0.0),
        (lambda a: (a > 0) * 3.0, 1.0, 0.0),
        (lambda a: np.where(a > 0, a**2, -a), 3.0, 6.0),
        (lambda a: np.clip(a, 0, 1), 2.0, 0.0),
        (lambda a: np.interp(a, [0, 1, 2], [0, 5, 6]), 1.0, 1.0),
        (lambda a: np.interp(a, [0, 1, 2], [0, 5, 6]), 2.0, 0.0),
        (lambda a: np.interp(a, [0, 1, 2], [0, 5, 6]), -1.0, 0.0),
        (lambda a: a**2.2, 0.0, 0.0),
        (lambda a: a**3, 2.0, 12.0),
        (lambda a: a**0, 2.0, 0.0),
        (lambda a: 2.0**a, 1.0, 2 * math.log(2)),
        (lambda a: a % 3, 4.0, 1.0),
        (lambda a: np.hypot(a, 0 * a), 0.0, 0.0),
        (lambda a: np.logaddexp(0, a), 0.0, 0.5),
        (lambda a: np.logaddexp(a, 3 * a), 0.0, 2.0),
        (lambda a: np.logaddexp(a, -a), 0.0, 0.0),
        (lambda a: np.logaddexp(a, 0), 1e300, 1.0),
        (lambda a: np.logaddexp(a, 0), -700.0, math.exp(-700)),
        (lambda a: np.logaddexp(2 * a, -np.inf), -5.0, 2.0),
        (lambda a: np.logaddexp(1e308 * a, 1.5e308 * a), 10.0, 1.25e308),
        # What advice makes of functions that have no rule.
        (lambda a: a - 2 * np.trunc(a / 2), 0.0, 1.0),  # fmod(a, 2)
        (lambda a: a - 2 * np.trunc(a / 2), -3.0, 1.0),
        (lambda a: np.where(a == 0, 1, np.sin(np.pi * a) / (np.pi * a)), 0.0, 0.0),  # sinc(a)
        (lambda a: np.where(a == 0, 1, np.sin(np.pi * a) / (np.pi * a)), 1.0, -1.0),
        (lambda a: np.where(a == a, a, 0), 0.0, 1.0),  # nan_to_num(a)
    ],
)
def test_derivatives_where_f_chooses(f, x, slope):
    field = Field(lambda s: (f(s[0]) * 1.0,), "a")
    np.testing.assert_allclose(field.jacobian([x]), [[slope]], rtol=1e-14)


# --------------------------------------------------------------------------------------- parameters
def rates(x, a, b):
    return a / b * x[0] - x[0] * x[1] / (1 + a * x[0]), x[0] ** b - x[1]


def test_families_are_arrays_and_trace_once():
    calls = []

    def f(x, a, b):
        calls.append(1)
        return rates(x, a, b)

    a = np.linspace(1, 2, 100_000)
    family = Field(f, "u v", a=a, b=2.5)
    assert len(calls) == 2
    assert family.shape == (100_000,)
    assert family
    x = np.array([1.5, 0.3])
    member = Field(rates, "u v", a=float(a[77]), b=2.5)
    assert family[77] == member
    assert family[77](x).tobytes() == member(x).tobytes() == family(x)[77].tobytes()
    assert family.sel(a=a[5]) == family[5]
    assert len(family[::1000]) == 100
    other = family[77].with_parameters(b=pandas.Series([2.0, 3.0]))
    assert len(calls) == 2
    np.testing.assert_allclose(other(x)[1], rates(x, a[77], 3.0), rtol=1e-14)
    assert other.parameters["a"] == a[77]
    assert other[1] == member.with_parameters(b=3.0) == Field(rates, "u v", a=float(a[77]), b=3.0)
    for each in (member, Field.from_dict(member.to_dict())):
        with pytest.raises(TypeError, match=r"with_parameters: .*it has a, b"):
            each.with_parameters(r=1.0)


# ------------------------------------------------------------------------------------- forms of f
def in_place(x):
    u = np.zeros_like(x)
    u += x
    u *= 2
    u[0] -= 1
    v = x[1]
    v += 1  # where x is an array of NumPy, too
    return u[0], u[1] + 0 * v


def into_objects(x):
    out = np.zeros(2, object)
    np.multiply([3, 4], x, out=out)
    return out


def filled(x):
    dx = np.zeros_like(x)
    dx[0] = x[0] * (1 - x[0] / 10)
    dx[1] += x[1] / (1 + x[0] ** 2)
    return dx


def partly(x):
    return np.add(x, 1, out=np.array([*x], object), where=[True, False])


A = np.array([[0.1, 1], [-1, 0]])
FORMS = {
    "in place": in_place,
    "out": into_objects,
    "where=": partly,
    "roll": lambda x: np.roll(x, 1) + np.roll(np.array(x), 1),
    "sums": lambda x: (np.sum(x) + x.sum(), np.mean(x)),
    "products": lambda x: (x @ x, np.dot(x, [1, 2])),
    "cumsum": lambda x: np.cumsum(np.stack([x[0], x[1]])),
    "norm": lambda x: x / np.linalg.norm(x),
    "extremes": lambda x: (np.max(x), x.min()),
    "select": lambda x: np.select([x < 0, x < 1], [-x, 2 * x], 7),
    "methods": lambda x: np.exp(np.array(x)),
    "outer": lambda x: np.outer(x, x).sum(0),
    "vectorize": lambda x: np.vectorize(lambda s: s * s)(x),
    "integers": lambda x: (np.int64(3) * x[0], x[1] // 1 + np.float32(0.5)),
    "truth": lambda x: (np.any(x > 0) * 1, (x > 0).sum()),
    "a matrix": lambda x: A @ x,
    "columns": lambda x: A[0] * x[0] - x[1] * A[1],
    "dot": lambda x: [np.dot(x, x), np.dot(A, x)[0]],
    "quotients": lambda x: x[0] / np.array([2.0, 4]) + x[1] / np.array(2.0),
    "types": lambda x: [np.float32(0.5) - x[0] ** 2 / 3, +x[1] * np.int64(2)],
    "conjugates": lambda x: (x[0].conjugate(), np.vdot(x, [1, 2])),
    "Fractions": lambda x: (Fraction(1, 4) * x[0], x[1] * Fraction(3, 2) - Fraction(1, 2)),
    "where": lambda x, a=2: (np.where(np.array(a) > 1, x[0], x[1] ** 3), x[1]),
    "angles": lambda x: (np.arctan2(x[1], x[0]) / np.pi, special.erf(x[0] / np.sqrt(2))),
    "remainders": lambda x: (1.0 * ((x[0] % 24 < 1) & (x[0] < 72)), x[1] - np.cbrt(x[1])),
    # As people type them for SciPy.
    "all pairs": lambda x: np.sin(x[None, :] - x[:, None] + 0.3).sum(axis=1),
    "neighbours": lambda x: np.diff(np.concatenate([x[:1], x, x[-1:]]), 2),
    "rows": lambda x: (np.roll(x.reshape(1, 2), 1, 1) + np.roll(x.reshape(2, 1), 1, 0).T).ravel(),
    "distances": lambda x: (x[:, None] / ((x[:, None] - x) ** 2 + np.eye(2)) ** 1.5).sum(1),
    "a diode": lambda x: (np.expm1(np.clip(x[0] / 0.4, -5, 4)), np.heaviside(np.sin(x[1]), 0.5)),
    "a thermostat": lambda x: (np.where(x[1] < 1, 1.0, np.where(x[1] > 2, 0.0, x[0])) - x[0], x[0]),
    "rows that are filled": filled,
    # Arrays of symbols.
    "clip of arrays": lambda x: np.clip(np.array([x[1], -x[0]]), -0.5, 1),
    "clip as a method": lambda x: np.asarray([x[1], -x[0]]).clip(max=0.5),
    "minimum": lambda x: np.minimum(np.array([x[1], -x[0]]), x),
    "where of arrays": lambda x: np.where(np.array(x) > 0.3, 1, np.sign(np.array([x[1], x[0]]))),
    "interp of arrays": lambda x: np.interp(np.array([x[1], x[0]]), [0, 1], [1, 3]),
    "interp around a period": lambda x: np.interp(
        7 * x, [2, -3, 0.5, 5, -1], [1, 3, 2, -1, 4], period=-4
    ),
    "a column": lambda x: np.array([[0, 1], [-2, 3]]) @ x.reshape(2, 1),
    "all axes": lambda x: x * (np.array([[x[0], x[1]], [x[1], 2]]) ** 2).sum(),
    "mean": lambda x: x * (x.reshape(2, 1) * x).mean() + np.outer(x, x).max(),
    "any": lambda x: np.where((np.outer(x, x) > 1).any(), x, np.outer(x, x).prod()),
}


@pytest.mark.parametrize("form", FORMS)
def test_forms_of_numpy_are_honoured(form):
    f, make = FORMS[form], np.array
    field = Field(f, "a b")
    assert np.array is make
    for x in ([0.3, -0.7], [1.2, 0.4], [-2.0, 3.0], [3.0, 4.0]):
        expected = np.array(f(np.array(x)), float).ravel()
        np.testing.assert_allclose(field(x), expected, rtol=1e-15, atol=1e-16)


# --------------------------------------------------------------------------- infinite and NaN
LIMITS = {
    "clip": (lambda a: np.clip(a, 0, np.inf), [0.0, 3.0]),
    "minimum": (lambda a: np.minimum(np.inf, a), [-2.0, 3.0]),
    "where": (lambda a: np.where(a > 0, a, np.nan), [np.nan, 3.0]),
    "less": (lambda a: a * (a < np.inf), [-2.0, 3.0]),
    "capacity": (lambda a: a * (1 - a / np.inf), [-2.0, 3.0]),
    "logaddexp": (lambda a: np.logaddexp(-np.inf, a), [-2.0, 3.0]),
    "interp": (lambda a: np.interp(a, [0, 4], [0, 8], left=np.nan), [np.nan, 6.0]),
}


@pytest.mark.parametrize("name", LIMITS)
def test_limits_may_be_infinite(name):
    f, expected = LIMITS[name]
    field = Field(lambda x: (f(x[0]),), "a")
    np.testing.assert_array_equal(field([[-2.0], [3.0]]).ravel(), expected)
    assert Field.from_dict(json.loads(json.dumps(field.to_dict()))) == field


@pytest.mark.parametrize(
    "f",
    [
        lambda a: np.inf, lambda a: np.nan, lambda a: 1e308 * 10.0, lambda a: np.inf * a,
        lambda a: a - np.nan, lambda a: a**np.inf, lambda a: np.where(a > 0, np.inf * a, 1.0),
        lambda a: np.sin(a + np.inf), lambda a: a / np.nan, lambda a: np.inf / a,
    ],
)  # fmt: skip
def test_rates_that_are_infinite_or_nan_are_refused(f):
    with pytest.raises(TypeError, match=r"^f: .*(inf|nan)"):
        Field(lambda x: (f(x[0]),), "a")
    with pytest.raises(TypeError, match=r"^H: .*(inf|nan)"):
        Field.from_hamiltonian(lambda x: f(x[0]), "q p")


# ------------------------------------------------------------------------------- files of strangers
def test_equations_can_be_typed():
    text = "where((x > 0) & ~(x >= k), u**2.5, -abs(x)/3) + interp(x, (0, 1), (2, 3), 2, 3)"
    given = {"body": "Field", "names": ["x"], "equations": [text]}
    given |= {"definitions": {"u": "exp(-x)"}, "parameters": {"k": 2.0}}
    field = Field.from_dict(given)
    np.testing.assert_allclose(field([0.5]), np.exp(-1.25) + 2.5, rtol=1e-15)


def test_other_threads_make_the_arrays_of_numpy():
    kinds = []

    def f(x):
        other = threading.Thread(target=lambda: kinds.append(type(np.array([None]))))
        other.start()
        other.join()
        return np.array([x[1], -x[0]])

    Field(f, 2)
    assert {*kinds} == {np.ndarray}


@pytest.mark.parametrize("f", [
    lambda x: np.multiply(x[0], 2.0, x[1]), lambda x: np.sin(x[0], x[1]),
    lambda x: np.multiply(x[0], 2.0, out=x[1]), lambda x: np.add(x[0], x[1], x[0]),
])  # fmt: skip
def test_no_function_writes_into_a_variable(f):
    """A third operand of np.multiply is where NumPy writes: it was left out without a word."""
    with pytest.raises(TypeError, match="operand too many"):
        Field(lambda x: (f(x), 0.0), "a b")
