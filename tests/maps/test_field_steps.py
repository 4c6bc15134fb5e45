"""Kahan's map of quadratic fields, against the Runge-Kutta form in 60 digits.

Of a linear field x' = (1 - A) x and eps = 2 the matrix of a step is A, so that small systems show
what each rule of elimination is for.
"""

from fractions import Fraction
from functools import partial

import naive
import numpy as np
import pytest
from last_digits import PROCESSORS, changed
from scipy.sparse import csc_array, csc_matrix
from scipy.sparse.linalg import splu, spsolve
from systems import chain, exactly, lorenz, rates_of_henon_heiles

import suslov_fast as sf
from suslov_fast.compiled import system
from suslov_fast.core.maps import kernel, superlu
from suslov_fast.core.maps.pivoting import pivoting_step
from suslov_fast.core.maps.step_system import steps_of_one
from suslov_fast.core.numba import status_codes as codes
from suslov_fast.maps.orders import COMPOSITIONS

# Long steps on purpose, from states with det A < 0.
pytestmark = pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")


def square(x):
    return (x[0] * x[0],)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("f", "start", "eps", "steps", "tolerance"),
    [
        (lorenz, (1.0, 2.0, 20.0), 1 / 64, 200, 2e-13),
        (lorenz, (1.0, 2.0, 20.0), -0.5, 20, 1e-12),  # with other pivots
        (rates_of_henon_heiles, (0.125, 0.25, 0.25, -0.125), 0.25, 500, 1e-12),
        (lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), (0.5, 0.7), 0.125, 200, 1e-13),
        (chain, (1.0, 0.5, 0.75, 1.25, 1.5, 0.25), 0.125, 60, 1e-13),
        (square, (0.1,), 0.5, 15, 1e-13),
        (lambda x: (0 * x[0], 1 + 0 * x[1]), (0.0, -3.0), 0.25, 10, 0.0),
    ],
)
def test_orbits_in_60_digits(f, start, eps, steps, tolerance):
    run = sf.iterate(sf.Field(f, len(start)), start, eps, steps)
    exact = naive.iterated(lambda x: naive.kahan_step(f, eps, x), start, steps)
    size = max(float(naive.mpmath.norm(x)) for x in exact)
    assert run.ok.all()
    for state, x in zip(run.states, exact, strict=True):
        assert naive.relative_error(state, x) * float(naive.mpmath.norm(x)) <= tolerance * size


def random_field(rng):
    """Coefficients of a sparse field whose components have units up to 2**30 apart, and a state."""
    D = int(rng.integers(1, 7))
    units = 2.0 ** rng.integers(-15, 16, D)
    tables = [rng.normal(size=(D,) * n) for n in (3, 2, 1)]
    for n, table in enumerate(tables):
        table *= rng.random(table.shape) < 1.5 / D ** (2 - n)
        table *= units.reshape(D, *[1] * (2 - n))
        for axis in range(1, 3 - n):
            table /= units.reshape([-1 if k == axis else 1 for k in range(3 - n)])
    return tables, units, rng.normal(size=D) * units


def test_random_fields_in_units_far_apart(rng):
    """Errors of a step and of its derivative in units of the condition of A in these units."""
    for case in range(20):
        tables, units, x = random_field(rng)
        eps = 10.0 ** rng.uniform(-3, 3) * rng.choice([-1, 1])
        field = sf.Field.from_terms(*tables)
        f = partial(exactly, field.terms)
        exact = naive.kahan_step(f, eps, x)
        errors = [
            float((naive.mpf(a) - b) / u)
            for a, b, u in zip(sf.step(field, x, eps), exact, units, strict=True)
        ]
        size = max(1.0, *(abs(float(b / u)) for b, u in zip(exact, units, strict=True)))
        condition = np.linalg.cond(sf.kahan.matrix(field, x, eps) * units / units[:, None])
        assert max(map(abs, errors)) < 1e-13 * size * condition
        if case % 8 == 0:
            slope = naive.derivative(partial(naive.kahan_step, f, eps), x)
            slope = np.array(slope, float) * units / units[:, None]
            found = sf.kahan.jacobian(field, x, eps) * units / units[:, None]
            assert abs(found - slope).max() < 1e-13 * abs(slope).max() * condition


def linear_step(A, x):
    """Return a step of x' = (1 - A) x with eps = 2, and the exact state, None at a pole."""
    field = sf.Field.from_terms(np.zeros([len(x)] * 3), np.eye(len(x)) - A)
    run = sf.iterate(field, x, 2.0, 1, on_singular="ignore")
    if not run.ok.all():
        return run, None
    half = naive.mpmath.lu_solve(naive.mpmath.matrix(np.asarray(A).tolist()), list(x))
    return run, [2 * v - naive.mpf(w) for v, w in zip(half, x, strict=True)]


FAR = 2.0**60
RANDOM = np.eye(4) - np.random.default_rng(5).normal(size=(4, 4))
GROWING = np.tril(-np.ones((8, 8)), -1) + np.eye(8)
GROWING[:, -1] = 1.0  # the last column doubles with each pivot
UNITS = np.array([1.0, FAR, 1.0 / FAR, 2.0**30])
SYSTEMS = {
    "no pivot": [[0.0, 1.0], [1.0, 1.0]],
    "a pivot that loses digits": [[2.0**-9, 1.0], [1.0, 1.0]],
    "a pivot near 0": [[-(2.0**-30), 1.0], [1.0, 1.0]],
    "a second pivot near 0": [[1.0, 1, 0.25], [1, 1 + 2.0**-30, 1], [0.5, 1, 1]],
    "first pivots beside a larger one": [[2.0**-5, 1, 1], [-1, 2.0**-5, 1], [1.0, 1, 1]],
    "three exchanges": [[0.0, 0, 0, 4], [0.5, 0, 0, 1], [0, 3, 0, 1], [1, 1, 2, 0]],
    "growth": GROWING,
    "units of unknowns": RANDOM * UNITS / UNITS[:, None],
    "rows of different size": RANDOM * np.array([[1.0], [1e8], [1e-8], [1e3]]),
    "one way only": [[1.0, 1e9, 0.0], [0.0, 1.0, 1e9], [0.0, 0.0, 1.0]],
    "a row that is exchanged keeps its size": [[0.0, 1.0], [1.0, FAR]],
    "rank 2 by some rounding errors": [[1.0, 1.0], [1.0, 1.0 + 2.0**-44]],
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_steps_with_pivoting(name):
    """To some units in the last place of each entry of A and of the state (Skeel)."""
    A = 1 - (1 - np.array(SYSTEMS[name], float))  # as the map finds it
    x = np.linspace(1.0, 2.0, len(A))
    run, exact = linear_step(A, x)
    inverse = abs(np.array((naive.mpmath.matrix(A.tolist()) ** -1).tolist(), float))
    half = abs(np.array([(v + naive.mpf(w)) / 2 for v, w in zip(exact, x, strict=True)], float))
    bound = 2.0**-50 * len(A) * (2 * inverse @ (abs(A) @ half + abs(x)) + abs(x))
    for found, value, most in zip(run.final, exact, bound, strict=True):
        assert abs(naive.mpf(found) - value) <= most


# U has a last column as that of GROWING, of which the last row leaves 2**-30 beside 2**18.
GROWN = np.tril(-np.ones((20, 20)), -1) + np.eye(20)
GROWN[:, -1], GROWN[-1] = 1.0, [1.0] * 18 + [-1.0, 2.0**-30 - 1.0]


@pytest.mark.parametrize(
    "A",
    [
        [[0.0]],
        [[1.0, 1.0], [1.0, 1.0]],
        np.outer([0.1, 0.7, -0.3], [1.3, 0.9, 1.1]).tolist(),  # to rounding
        [[0.1, 0.3, 0.4], [0.2, 0.7, 0.9], [0.3, 1.0, 1.3]],
        [[1.0, 2.0**60], [2.0**-60, 1.0]],
        (1e9 * np.arange(1.0, 10.0).reshape(3, 3) / 7.0).tolist(),  # beside large terms
        [[1.0, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 1.0], [1.0, 1.0 + 2.0**-52]],
        GROWN.tolist(),
    ],
)
def test_singular_matrices_are_poles(A):
    run, _ = linear_step(np.array(A), np.ones(len(A)))
    assert run.status == sf.Status.SINGULAR
    assert run.failed_at == 1
    assert np.isnan(run.final).all()


def test_a_pole_and_what_is_next_to_it():
    field = sf.Field(square, 1)
    for x, status in ((2.0, -1), (2.0 * (1 + 2.0**-52), -1), (2.0 * (1 - 2.0**-40), 0)):
        assert sf.iterate(field, [x], 0.5, 1, on_singular="ignore").status == status
    for A in (np.diag([2.0**-40]), np.diag([0.25]), np.diag([0.25, 1.0])):  # they overflow
        run, _ = linear_step(A, [1e308, 1.0][: len(A)])
        assert (run.status, run.failed_at) == (sf.Status.NONFINITE, 1)


def test_one_step_at_a_pole():
    """`step` of one state has the short call of compiled code, which leaves poles to the kernel."""
    field = sf.Field(square, 1)
    arguments = kernel.scheme_of(field.terms[0], 1), field.terms[1][np.newaxis], np.array([0.5])
    assert steps_of_one(arguments, np.array([2.0])) is None
    assert steps_of_one(arguments, np.array([1.0])) == 2.0  # x + eps x**2 / (1 - eps x)
    with pytest.warns(sf.IntegrationWarning, match="singular"):
        assert np.isnan(sf.step(field, [2.0], 0.5)).all()
    assert sf.step(field, [1.0], 0.5) == 2.0


def test_a_state_that_its_increment_cancels():
    """x' = -x has x_next = x (1 - eps / 2) / (1 + eps / 2): of one component, or of both."""
    for gap in 2.0 ** -np.arange(5.0, 45.0, 5):
        for x in np.linspace(0.5, 1.0, 9):
            eps = 2 - gap
            exact = x * (1 - eps / 2) / (1 + eps / 2)
            alone = sf.step(sf.Field(lambda x: (-x[0],), 1), [x], eps)
            both = sf.step(sf.Field(lambda x: (-x[0], x[1] * 0.75), 2), [x, 1.0], eps)
            assert abs(alone[0] / exact - 1) < 1e-15
            assert abs(both[0] / exact - 1) < 3e-13


@pytest.mark.compiled
def test_a_run_returns_to_python_between_steps_by_solve(rng, monkeypatch):
    """Wherever it does, it goes on with the same bits: in blocks, stages and saved states."""
    field, calls, call = sf.Field(rates_of_henon_heiles, 4), [], kernel.call

    def counted(*given):
        calls.append(given)
        return call(*given)

    assert pivoting_step.address()
    monkeypatch.setattr(kernel, "call", counted)
    x0 = rng.normal(size=(700, 4)) * rng.choice([0.1, 1.0, 30.0], size=(700, 1))
    for method in ("auto", "order4"):
        args = field, x0, rng.choice([0.1, 0.5, 2.0], size=700), 30
        options = {"save_every": 3, "method": method, "on_singular": "ignore", "threads": 1}
        whole, usual = sf.iterate(*args, **options), len(calls)
        with monkeypatch.context() as patch:
            patch.setattr(kernel, "TIME_OF_PIVOTING", 1)
            assert sf.iterate(*args, **options) == whole
        assert len(calls) > 2 * usual
        calls.clear()
    assert (whole.status != 0).any()


def test_a_pivot_of_parameters_alone_may_be_0():
    """x' = x and eps = 2 have no next states; the warning is about these alone."""
    field = sf.Field(lambda x: (x[0], x[0] * x[1]), 2)
    with pytest.warns(sf.IntegrationWarning, match="1 of 1 states"):
        assert np.isnan(sf.kahan.jacobian(field, [1.0, 0.5], 2.0)).all()
    with pytest.warns(sf.IntegrationWarning, match="1 of 1 states"):
        assert np.isnan(sf.lyapunov_exponents(field, [1.0, 0.5], 2.0, 3)).all()
    assert system(field, 2.0).dimension == 2


LARGE = 16  # lattices 16 x 16 are the smallest that SuperLU solves


def neighbours(n):
    """Return the numbers of the four neighbours of the cells of a periodic lattice n x n."""
    cells = np.arange(n * n).reshape(n, n)
    return [np.roll(cells, shift, axis).ravel() for axis in (0, 1) for shift in (-1, 1)]


def test_steps_of_a_lattice(rng):
    """Of 16 x 16, beside SciPy's sparse solver: reaction, diffusion, advection, a source."""
    n = LARGE
    east, west, north, south = neighbours(n)

    def lattice(u, k):
        flow = u[west] * (u[east] - u[north])
        return (
            0.1 + k * u * (1 - u) + 0.3 * (u[east] + u[west] + u[north] + u[south] - 4 * u) + flow
        )

    field, x = sf.Field(lattice, n * n, k=0.8), rng.uniform(0.2, 1.0, (3, n * n))
    step = kernel.scheme_of(field.terms[0], n * n).step
    assert step.is_sparse
    assert not step.usual
    for eps in (0.1, -0.3, 1.5):
        found = sf.step(field, x, eps)
        for k in (0, 2):
            np.testing.assert_array_equal(found[k], sf.step(field, x[k], eps))
            slope = csc_array(np.eye(n * n) - 0.5 * eps * field.jacobian(x[k]))
            increment = eps * spsolve(slope, field(x[k]))
            np.testing.assert_allclose(found[k], x[k] + increment, rtol=0.0, atol=2e-13)
    order = rng.permutation(n * n)
    place = np.argsort(order)
    renamed = sf.Field(lambda u, k: lattice(u[place], k)[order], n * n, k=0.8)
    np.testing.assert_allclose(
        sf.step(renamed, x[0, order], 0.1), sf.step(field, x[0], 0.1)[order], rtol=1e-13
    )


@pytest.mark.parametrize("D", [4, 40])
def test_members_of_a_family(rng, D):
    """Bit for bit the member alone, with other zeros than the family, of order 4, after poles."""
    tables = rng.normal(size=(6, D, D, D)) / D, rng.normal(size=(D, D)) / D, rng.normal(size=D)
    tables[0][2] *= rng.random((D, D, D)) < 0.3
    family = sf.Field.from_terms(*tables)
    cases = (0.3, 0.1, "auto"), (0.3, 0.1, "order4"), (3.0, 0.6, "auto"), (3.0, 0.6, "order6")
    for size, eps, method in cases:
        x0 = size * rng.normal(size=(6, D))
        x0[1] = np.nan
        options = {"method": method, "on_singular": "ignore", "save_every": 2}
        run = sf.iterate(family, x0, eps, 4, **options)
        assert (run.status > 0).any() == (size > 1.0)
        for k in (2, 5):
            own = sf.iterate(family[k], x0[k], eps, 4, **options)
            assert np.array_equal(own.states, run.states[:, k], equal_nan=True)
            assert (own.status, own.failed_at) == (run.status[k], run.failed_at[k])
        assert sf.iterate(family, x0[:, None][:0], eps, 4, **options).states.shape == (3, 0, 6, D)
    x = 0.3 * rng.normal(size=(6, D))
    slopes, exponents = sf.kahan.jacobian(family, x, 0.1), sf.lyapunov_exponents(family, x, 0.1, 5)
    for k, after in enumerate(sf.step(family, x, 0.1)):
        A = np.eye(D) - 0.05 * family[k].jacobian(x[k])
        wanted = x[k] + 0.1 * np.linalg.solve(A, family[k](x[k]))
        np.testing.assert_allclose(after, wanted, rtol=1e-12, atol=1e-12)
        assert np.array_equal(sf.kahan.jacobian(family[k], x[k], 0.1), slopes[k])
        if k in (2, 5):
            own = sf.lyapunov_exponents(family[k], x[k], 0.1, 5)
            assert np.array_equal(own, exponents[k])


def populations(rng, n=LARGE):
    """Return a family of 2 lattices n x n of populations, which keep their signs."""
    near = neighbours(n)
    weights = rng.uniform(0.1, 0.3, size=(4, n * n))

    def rates(u, r):
        return u * (r - u - sum(w * u[at] for w, at in zip(weights, near, strict=True)))

    return sf.Field(rates, n * n, r=np.array([0.5, 3.0]))


def test_poles_and_signs_in_large_lattices(rng):
    """SuperLU's steps tell of det A < 0, beside NumPy's determinant, and of signs that change."""
    family, D = populations(rng), LARGE**2
    assert not kernel.scheme_of(family.terms[0], D).step.usual
    for method, eps, parts in (
        ("auto", 0.2, [1.0]),
        ("auto", 6.0, [1.0]),
        ("order4", 6.0, COMPOSITIONS[4].fractions),
    ):
        x0 = rng.uniform(0.2, 1.0, size=(2, D))
        run = sf.iterate(family, x0, eps, 2, method=method, on_singular="ignore")
        for k in (0, 1) if len(parts) == 1 else (1,):
            own = sf.iterate(family[k], x0[k], eps, 2, method=method, on_singular="ignore")
            assert np.array_equal(own.states, run.states[:, k], equal_nan=True)
            assert (own.status, own.failed_at) == (run.status[k], run.failed_at[k])
            x, first = x0[k], -1
            for n in (1, 2):
                before, told = x, False
                for part in parts:
                    A = np.eye(D) - 0.5 * part * eps * family[k].jacobian(x)
                    told |= np.linalg.slogdet(A)[0] < 0
                    x = x + part * eps * np.linalg.solve(A, family[k](x))
                told |= (before * x < 0.0).any()
                first = n if told and first < 0 else first
            assert run.failed_at[k] == first
            if first < 0:
                np.testing.assert_allclose(run.states[-1, k], x, rtol=1e-8, atol=1e-10)
    assert (run.status != 0).any()


def test_large_lattices_on_poles_and_out_of_range(rng):
    n = LARGE
    near = neighbours(n)
    field = sf.Field(lambda u: u * (u + 0.1 * sum(u[each] for each in near)), n * n)
    assert not kernel.scheme_of(field.terms[0], n * n).step.usual
    x = np.zeros((3, n * n))
    x[0, 7], x[1] = 1.0, 1e-3 * rng.normal(size=n * n)
    x[2, 7] = 1e308
    run = sf.iterate(field, x, 1.0, 2, on_singular="ignore")
    assert [*run.status] == [codes.SINGULAR, codes.OK, codes.NONFINITE]
    assert [*run.failed_at] == [1, -1, 1]
    assert np.isfinite(run.final).all(axis=1).tolist() == [False, True, False]


@pytest.mark.parametrize("distance", [1.0, 1e-6, 1e-10])
def test_refined_solutions_are_rounded_exact_ones(rng, distance):
    """Of sparse systems with a row at a distance from another one, beside fractions."""
    D = 12
    A = np.where(rng.random((D, D)) < 0.4, rng.normal(size=(D, D)), 0.0) + np.eye(D)
    A[1] = A[0] + distance * rng.normal(size=D)
    right = rng.normal(size=D) * 10.0 ** rng.integers(-8, 3, D)
    rows = [[*map(Fraction, row), Fraction(b)] for row, b in zip(A, right, strict=True)]
    for k in range(D):
        p = max(range(k, D), key=lambda i, k=k: abs(rows[i][k]))
        rows[k], rows[p] = rows[p], rows[k]
        rows[k] = [a / rows[k][k] for a in rows[k]]
        for i in {*range(D)} - {k}:
            rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    matrix = csc_matrix(A)
    for seed in PROCESSORS:
        found = superlu._refined(OtherFactors(splu(matrix), seed), matrix, right)
        np.testing.assert_array_equal(found, [float(row[-1]) for row in rows])


class OtherFactors:
    """Factors by SuperLU, with other last digits of solutions."""

    def __init__(self, factors, seed):
        self.factors, self.seed = factors, seed

    def __getattr__(self, name):
        return getattr(self.factors, name)

    def solve(self, right):
        found = self.factors.solve(right)
        return found if self.seed is None else changed(found, self.seed)


def other_factors(seed, *arguments, **options):
    return OtherFactors(splu(*arguments, **options), seed)


def test_large_lattices_do_not_depend_on_the_processor(rng, monkeypatch):
    field, x0 = populations(rng)[0], rng.uniform(0.2, 1.0, LARGE**2)
    run = sf.iterate(field, x0, 1.0, 20)
    for seed in PROCESSORS[1:]:
        monkeypatch.setattr(superlu, "splu", partial(other_factors, seed))
        np.testing.assert_array_equal(sf.iterate(field, x0, 1.0, 20).states, run.states)
