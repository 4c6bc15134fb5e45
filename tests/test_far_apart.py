"""Parameters and components spread over tens of orders of magnitude: results are as accurate as
their dependence on the last digit of the input allows, or NaN with a status.
"""

from functools import partial

import mpmath
import naive
import numpy as np
import pytest
from mpmath import mpf

import suslov_fast as sf

# Loss of digits beyond those that a change of all inputs by one rounding costs.
LOST, LOST_BY_DERIVATIVES, LOST_BY_ENERGIES = 1e5, 1e6, 1e7
DIGITS = 250
METHODS = ("auto", "rank2", "gauss")
# Powers of x1 and of x2 in the terms of a Hamiltonian.
A, B = np.array([(a, b) for a in range(4) for b in range(4 - a) if a + b], dtype=object).T
exactly = np.vectorize(mpf, otypes=[object])


def numbers(rng, exponent, shape):
    return 10.0 ** rng.uniform(-exponent, exponent, shape) * rng.choice([-1.0, 1.0], shape)


def bodies(rng, m, size):
    """Arguments of functions; J, I, omega (size, m) and eps; equations, and weights of states.

    The largest eps I omega / J lies between 1e-30 and 1e30.
    """
    problems = []
    for _ in range(size):
        spread = rng.choice([1, 3, 10, 24])
        J, I, omega = abs(numbers(rng, spread, m)), *numbers(rng, spread, (2, m))
        if rng.random() < 0.5:
            omega = numbers(rng, 0.5, m) / np.sqrt(J)
        if rng.random() < 0.2:
            omega = I * numbers(rng, 5, 1)
        if rng.random() < 0.2:
            J[:] = J[0]
        I[rng.random(m) < 0.15] = 0.0
        I[0] = I[0] or 1.0
        terms = abs(I).max() * abs(omega) / J
        eps = numbers(rng, rng.choice([0.5, 8, 30]), 1)[0] / terms.max()
        problems.append((J, I, omega, eps))
    J, I, omega, eps = problems = [np.array(each) for each in zip(*problems, strict=True)]
    return (sf.SuslovND(J, I), omega, eps), problems, residual_nd, of_energy


def fields(rng, D, size):
    """The same of fields, with q, l, c, x and eps."""
    problems = []
    for _ in range(size):
        spread = rng.choice([1, 3, 10, 30])
        q = numbers(rng, spread, (D, D, D)) * (rng.random((D, D, D)) < rng.choice([0.3, 1.0]))
        l, c = numbers(rng, spread, (D, D)), numbers(rng, spread, D)
        l, c = l * (rng.random((D, D)) < 0.5), c * (rng.random(D) < 0.5)
        x = numbers(rng, spread, D)
        terms = max(abs(q).max() * abs(x).max(), abs(l).max(), 1e-30)
        eps = numbers(rng, rng.choice([0.5, 8, 30]), 1)[0] / terms
        problems.append((q + q.swapaxes(1, 2), l, c, x, eps))
    *field, x, eps = problems = [np.array(each) for each in zip(*problems, strict=True)]
    return (sf.QuadraticField(*field), x, eps), problems, residual_of_field, lambda *_: [1] * D


def changed(rng, parameter):
    """A parameter with relative changes of up to 2**-53 of each number."""
    return exactly(parameter) * (1 + mpf(2) ** -53 * rng.uniform(-1.0, 1.0, np.shape(parameter)))


def norm(difference, weights):
    return mpmath.sqrt(sum((w * v) ** 2 for v, w in zip(difference, weights, strict=True)))


def check(rng, results, problems, reference, weights, lost=LOST):
    """Compare results (size, ...) with a reference, in a norm with weights."""
    wrong, missing = [], 0
    with mpmath.workdps(DIGITS):
        for result, problem in zip(results, zip(*problems, strict=True), strict=True):
            exact = reference(*problem)
            if exact is None or not 1e-280 < max(map(abs, exact)) < 1e280:
                continue
            if np.isnan(result).any():
                missing += 1
                continue
            of = weights(*problem)
            size = norm(exact, of)
            others = [reference(*(changed(rng, each) for each in problem)) for _ in range(4)]
            change = max(norm(np.subtract(other, exact), of) for other in others)
            error = norm(np.subtract(exactly(result).ravel(), exact), of)
            if error > lost * (change + mpf(2) ** -53 * size):
                wrong.append((float(error / size), float(change / size), problem))
    assert not wrong
    assert missing < 0.1 * len(results)


def residual_nd(J, I, _, eps):
    return lambda x, y: naive.dsn(J, I, mpf(eps), x, y)


def residual_of_field(q, l, c, _, eps):
    q, l, c, eps = map(exactly, (q, l, c, eps))
    return lambda x, y: np.subtract(y, x) - eps * (q @ y @ x + l @ np.add(x, y) / 2 + c)


def step(residual_of, *problem):
    residual, x = residual_of(*problem), exactly(problem[-2])
    return naive.solve_affine(lambda y: residual(x, y), len(x))


def derivative(residual_of, *problem):
    """Derivative of the map from x to y with residual(x, y) = 0, affine in x and in y."""
    residual, x, y = residual_of(*problem), exactly(problem[-2]), step(residual_of, *problem)
    if y is None:
        return None
    columns = []
    for unit in np.eye(len(x), dtype=int):
        by_x = np.array(residual(x + unit, y))
        columns.append(naive.solve_affine(lambda d, v=by_x: v + residual(x, np.add(y, d)), len(x)))
    return None if None in columns else [v for row in zip(*columns, strict=True) for v in row]


def reaction(J, I, x, eps):
    """The matrix of the discrete equations, row by row."""
    y = step(residual_nd, J, I, x, eps)
    if y is None:
        return None
    matrix = naive.reaction_nd(J, I, exactly(x), y, naive.quotient(eps, x, y))
    return [v for row in matrix for v in row]


def energy_and_density(c, x, eps):
    """H + (eps/3) grad H.d and 1 / det(1 - h f'), d = (1 - h f')**-1 f, f = (H_2, -H_1)."""
    c, (x1, x2), h = exactly(c), exactly(x), mpf(eps) / 2
    terms = c * x1**A * x2**B
    H1, H2, H12 = terms @ A / x1, terms @ B / x2, terms @ (A * B) / (x1 * x2)
    H11, H22 = terms @ (A * (A - 1)) / x1**2, terms @ (B * (B - 1)) / x2**2
    det = 1 - h * h * (H12 * H12 - H11 * H22)
    work = 2 * h * h * (2 * H12 * H1 * H2 - H22 * H1 * H1 - H11 * H2 * H2) / det
    return sum(terms) + work / 3, 1 / det


def of_energy(J, *_):
    return [mpmath.sqrt(mpf(v)) for v in J]


def of_torque(J, *_):
    return [mpmath.sqrt(mpf(a) * mpf(b)) / max(a, b) for a in J for b in J]


@pytest.mark.parametrize(
    ("made", "D", "size", "method"),
    [(bodies, m, size, method) for m, size in ((2, 200), (3, 200), (5, 50)) for method in METHODS]
    + [(fields, D, 100, "auto") for D in (1, 2, 3)],
)
def test_steps(rng, made, D, size, method):
    arguments, problems, residual_of, weights = made(rng, D, size)
    run = sf.iterate(*arguments, 1, method=method, on_singular="ignore")
    assert ((run.status < 0) == np.isnan(run.final).any(axis=-1)).all()
    check(rng, run.final, problems, partial(step, residual_of), weights)


@pytest.mark.filterwarnings("ignore::suslov_fast.SingularStepWarning")
@pytest.mark.parametrize(
    ("made", "D", "size"),
    [(bodies, 2, 300), (bodies, 3, 300), (fields, 1, 150), (fields, 2, 100), (fields, 3, 100)],
)
def test_derivatives_and_exponents(rng, made, D, size):
    arguments, problems, residual_of, of = made(rng, D, size)

    def weights(*problem):
        return [a / b for a in of(*problem) for b in of(*problem)]

    reference = partial(derivative, residual_of)
    check(rng, sf.jacobian(*arguments), problems, reference, weights, LOST_BY_DERIVATIVES)

    def determinant(*problem):
        found = reference(*problem)
        return found and [abs(mpmath.det(mpmath.matrix(np.reshape(found, (D, D)))))]

    products = np.exp(sf.lyapunov_exponents(*arguments, 1).sum(axis=-1))
    check(rng, products, problems, determinant, lambda *_: [1], LOST_BY_ENERGIES)


@pytest.mark.filterwarnings("ignore::suslov_fast.SingularStepWarning")
@pytest.mark.parametrize("m", [3, 5])
def test_reactions(rng, m):
    arguments, problems, *_ = bodies(rng, m, 200)
    check(rng, sf.reaction(*arguments), problems, reaction, of_torque)


def test_hamiltonian_fields(rng):
    problems, found = [], []
    for _ in range(300):
        spread = rng.choice([1, 3, 10, 30])
        c, x = numbers(rng, spread, A.size), numbers(rng, spread, 2)
        c[rng.random(A.size) < 0.5] = 0.0
        terms = abs(c) * abs(x).max() ** (A + B - 2).astype(float) * (A + B > 1)
        eps = numbers(rng, rng.choice([0.5, 8, 30]), 1)[0] / (terms.max() or 1.0)
        terms = [*zip(c, A, B, strict=True)]
        H = lambda v, terms=terms: sum(v[0] ** a * v[1] ** b * k for k, a, b in terms)  # noqa: E731
        field = sf.QuadraticField.from_hamiltonian(H, 2)
        problems.append((c, x, eps))
        found.append((sf.modified_energy(field, x, eps), sf.invariant_density(field, x, eps)))
    problems = [np.array(each) for each in zip(*problems, strict=True)]
    for i, values in enumerate(np.array(found).T):
        reference = lambda *problem, i=i: [energy_and_density(*problem)[i]]  # noqa: E731
        check(rng, values, problems, reference, lambda *_: [1], LOST_BY_ENERGIES)
