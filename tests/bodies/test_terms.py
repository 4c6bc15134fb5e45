"""Fields as lists of terms: what they cost, round trips, and tables that are made on demand."""

import subprocess
import sys
from fractions import Fraction as F

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import QuadraticField

of_terms, of_function = QuadraticField.from_terms, QuadraticField.from_function


def lattice(D):
    """Lorenz's atmosphere model, in terms and as a function."""
    i, one = np.arange(D), np.full(D, D)
    products = [[*i, *i], [*(i - 1) % D] * 2, [*(i + 1) % D, *(i - 2) % D]]
    indices = np.hstack([products, [i, i, one], [i, one, one]])
    return indices, np.repeat([1, -1, -1, 8], D)


def f_of_lattice(x):
    D = len(x)
    return [(x[(i + 1) % D] - x[i - 2]) * x[i - 1] - x[i] + 8 for i in range(D)]


def value(x, indices, values):
    """The sum of terms at a state, term by term."""
    y, f = [*x, 1], [0] * len(x)
    for i, j, k, v in zip(*indices.tolist(), values.tolist(), strict=True):
        f[i] += v * y[j] * y[k]
    return f


def random_terms(rng, D, T, batch=()):
    """Terms in any order, many of them repeated, with the factors in any order."""
    indices = np.array([rng.integers(0, D, T), *rng.integers(0, D + 1, (2, T))])
    return indices, rng.integers(-9, 10, (*batch, T)).astype(float)


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_repeated_terms_are_added_in_any_order(rng, batch):
    D, T = 4, 60
    indices, values = random_terms(rng, D, T, batch)
    field, order = of_terms(indices, values, D), rng.permutation(T)
    turned = indices[[0, 2, 1]][:, order]
    assert of_terms(turned, values[..., order], D) == field
    halves = of_terms(
        np.hstack([indices, turned]), np.concatenate([values, values[..., order]], -1) / 2, D
    )
    assert halves == field
    x = rng.integers(-5, 6, D)
    for member in np.ndindex(batch):
        single = field[member] if batch else field
        assert [*single([*map(int, x)])] == value(x, indices, values[member])
        assert single(x.astype(float)).tolist() == value(x, indices, values[member])


def test_a_field_is_its_terms_and_its_tables(rng):
    for field in (
        of_terms(*random_terms(rng, 5, 80), 5),
        of_terms(*random_terms(rng, 3, 30, (4,)), 3),
    ):
        twins = [
            QuadraticField(field.quadratic, field.linear, field.constant),
            of_terms(*field.terms, field.dimension),
        ]
        for twin in twins:
            assert twin == field
            assert hash(twin) == hash(field)
            assert all(map(np.array_equal, twin.terms, field.terms))
        assert field != of_terms(*field.terms, field.dimension + 1)
        x = rng.normal(size=(5, *np.ones_like(field.shape), field.dimension))
        assert (sf.step(field, x, 0.01) == sf.step(twins[0], x, 0.01)).all()


def test_linear_terms_and_constants_are_added():
    D = 6
    A = np.diag(np.arange(1.0, D), 1) - 0.25 * np.eye(D)
    indices, values = [[0, 2], [0, 1], [1, D]], [F(1, 3), 2]
    whole = of_terms(indices, values, "a b c d e f", linear=A, constant=np.arange(D))
    assert of_terms(indices, values, D, linear=A.tolist(), constant=range(D)) == whole
    assert whole.linear[2, 1] == 2
    assert (whole.linear - A)[[0, 3, 5]].tolist() == [[0] * D] * 3
    assert whole.quadratic[0, 0, 1] == F(1, 6)
    assert whole.constant.tolist() == [*range(D)]
    assert whole.names == tuple("abcdef")
    assert of_terms(np.zeros((3, 0), int), [], 2, linear=[[[1.0, 0], [0, 2]]] * 3).shape == (3,)
    with pytest.raises(ValueError, match=r"^linear\b"):
        of_terms(indices, values, D, linear=np.eye(7))


def test_exact_numbers_stay_exact():
    third = of_terms([[0, 0], [0, 0], [0, 0]], [F(1, 3), F(1, 3)], 1)
    assert third([F(1, 2)]) == (F(1, 6),)
    near = [1.0, 2.0**-53], [-(2.0**-53), 1.0], [1.0, -(2.0**-54)], [0.5, 2.0**-52], [3.0, -3.0]
    for numbers in ([0.1, 0.2], [0.1, 0.2, 1e-30], [1e16, 1.0, 1.0], [1.0, 1e16], *near):
        sums = of_terms([[0] * len(numbers)] * 3, numbers, 1)  # not the double 0.1 + 0.2
        assert sums([1]) == (sum(map(F, numbers)),)
    assert of_terms([[0], [0], [1]], [2**70 + 1], 1)([1]) == (2**70 + 1,)


def test_tables_that_do_not_fit_are_refused_with_their_size():
    field = of_terms(*lattice(1024), 1024)
    with pytest.raises(MemoryError, match="quadratic would need 8,589,934,592 bytes"):
        _ = field.quadratic
    assert field.linear.shape == (1024, 1024)
    small = of_terms(*lattice(8), 8)
    assert small.quadratic[3, 2, 4] == small.quadratic[3, 4, 2] == F(1, 2)


@pytest.mark.slow
def test_many_variables_cost_their_terms(rng):
    """In a process of its own, whose memory is limited to far less than a table."""
    D = 1024
    field = of_function(f_of_lattice, D)
    assert field == of_terms(*lattice(D), D)
    assert repr(field).endswith("...)")
    x = rng.normal(size=(2, D))
    expected = np.array([f_of_lattice(row) for row in x])
    np.testing.assert_allclose(sf.vector_field(field, x), expected, atol=1e-12)
    np.testing.assert_allclose(field(x), expected, atol=1e-12)
    code = (
        "import resource, sys, json, pickle, suslov_fast as sf, numpy as np\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "D = 2048\n"
        "f = lambda x: [(x[(i + 1) % D] - x[i - 2]) * x[i - 1] - x[i] + 8 for i in range(D)]\n"
        "field = sf.QuadraticField.from_function(f, D)\n"
        "same = sf.QuadraticField.from_dict(json.loads(json.dumps(field.to_dict())))\n"
        "assert same == field == pickle.loads(pickle.dumps(field)) and hash(same) == hash(field)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    if sys.platform == "linux":
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert int(done.stdout) < 2**17  # KiB; a table of 2048 variables has 64 GiB


def test_what_sympy_and_complex_variables_need():
    sympy = pytest.importorskip("sympy")
    names = sympy.symbols("x y z")
    x, y, z = names
    rows = [10 * (y - x), x * (28 - z) - y, x * y - 3 * z]
    f = sympy.lambdify([names], sympy.Matrix(rows))
    with pytest.raises(ValueError, match=r"\(3, 1\): .* f\(x\)\.ravel\(\)"):
        of_function(f, 3)
    field = of_function(lambda x: f(x).ravel(), 3)
    assert field == of_function(sympy.lambdify([names], rows), 3)
    assert of_function(sympy.lambdify([names], rows), names).names == ("x", "y", "z")
    root = sympy.sqrt(2)
    assert of_function(lambda a: (root * a[1], a[0]), 2)([0.0, 1.0])[0] == 2**0.5
    for given in (rows, sympy.Matrix(rows), lambda _: rows, lambda _: sympy.Matrix(rows)):
        with pytest.raises(TypeError, match="lambdify"):
            of_function(given, 3)
    for g in (lambda a: (1j * a[0], a[1]), lambda a: (1j, a[1])):
        with pytest.raises(TypeError, match="into real and imaginary parts"):
            of_function(g, 2)
    assert of_function(lambda a: (a[0].conjugate(), np.vdot(a, [1, 2])), 2)([3, 4]) == (3, 11)


def test_long_lists_of_states_are_those_of_arrays(rng):
    field, x = of_terms(*lattice(4), 4), rng.normal(size=(200, 4))
    expected = sf.step(field, x, 0.01)
    for rows in (x.tolist(), [*map(tuple, x.tolist())]):
        assert (sf.step(field, rows, 0.01) == expected).all()
        rows[150] = [True, 0.0, 0.0, 0.0]
        with pytest.raises(TypeError, match="bool"):
            sf.step(field, rows, 0.01)
        rows[150] = [0.0, 0.0, 0.0]
        with pytest.raises(ValueError, match="rows of equal length"):
            sf.step(field, rows, 0.01)
