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
LOST, LOST_BY_DERIVATIVES = 1e5, 1e6
DIGITS = 250


def numbers(rng, exponent, shape):
    return 10.0 ** rng.uniform(-exponent, exponent, shape) * rng.choice([-1.0, 1.0], shape)


def nd_problems(rng, m, size):
    """J, I, omega (size, m), and eps; the largest eps I omega / J lies between 1e-30 and 1e30."""
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
        eps = numbers(rng, rng.choice([0.5, 8, 30]), 1) / terms.max()
        problems.append((J, I, omega, eps))
    J, I, omega, eps = map(np.array, zip(*problems, strict=True))
    return J, I, omega, eps[:, 0]


def field_problems(rng, D, size):
    """q, l, c, x and eps."""
    problems = []
    for _ in range(size):
        spread = rng.choice([1, 3, 10, 30])
        q = numbers(rng, spread, (D, D, D)) * (rng.random((D, D, D)) < rng.choice([0.3, 1.0]))
        l, c = numbers(rng, spread, (D, D)), numbers(rng, spread, D)
        l, c = l * (rng.random((D, D)) < 0.5), c * (rng.random(D) < 0.5)
        x = numbers(rng, spread, D)
        terms = max(abs(q).max() * abs(x).max(), abs(l).max(), 1e-30)
        eps = numbers(rng, rng.choice([0.5, 8, 30]), 1) / terms
        problems.append((q + q.swapaxes(1, 2), l, c, x, eps))
    q, l, c, x, eps = map(np.array, zip(*problems, strict=True))
    return q, l, c, x, eps[:, 0]


def changed(rng, parameter):
    """A parameter with a relative change of 2**-53 of each number."""
    signs = rng.choice([-1, 1], np.shape(parameter))
    change = np.vectorize(lambda v, s: mpf(float(v)) * (1 + s * mpf(2) ** -53), otypes=[object])
    return change(parameter, signs)[()]


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
            others = [reference(*(changed(rng, each) for each in problem)) for _ in range(2)]
            change = max(norm(np.subtract(other, exact), of) for other in others)
            error = norm([mpf(v) - e for v, e in zip(result.ravel(), exact, strict=True)], of)
            if error > lost * (change + mpf(2) ** -53 * size):
                wrong.append((float(error / size), float(change / size), problem))
    assert not wrong
    assert missing < 0.1 * len(results)


def residual_nd(J, I, _, eps):
    J, I, eps = naive.exactly(*J), naive.exactly(*I), mpf(eps)
    return lambda x, y: naive.dsn(J, I, eps, x, y)


def residual_of_field(q, l, c, x, eps):
    axes, eps = range(len(x)), mpf(eps)

    def residual(x, y):
        return [
            y[i] - x[i] - eps * sum(mpf(q[i][j][k]) * x[j] * y[k] for j in axes for k in axes)
            - eps * sum(mpf(l[i][j]) * (x[j] + y[j]) / 2 for j in axes)
            - eps * mpf(c[i])
            for i in axes
        ]  # fmt: skip

    return residual


def step(residual_of, *problem):
    residual, x = residual_of(*problem), naive.exactly(*problem[-2])
    return naive.solve_affine(lambda y: residual(x, y), len(x))


def derivative(residual_of, *problem):
    """Derivative of the map from x to y with residual(x, y) = 0, affine in x and in y."""
    residual, x, y = residual_of(*problem), naive.exactly(*problem[-2]), step(residual_of, *problem)
    if y is None:
        return None
    columns = []
    for j in range(len(x)):
        of_x = residual([v + (i == j) for i, v in enumerate(x)], y)

        def change(d, of_x=of_x):
            of_y = residual(x, [v + w for v, w in zip(y, d, strict=True)])
            return [v + w for v, w in zip(of_x, of_y, strict=True)]

        columns.append(naive.solve_affine(change, len(x)))
    return None if None in columns else [v for row in zip(*columns, strict=True) for v in row]


def of_energy(J, *_):
    return [mpmath.sqrt(mpf(v)) for v in J]


@pytest.mark.parametrize("m", [2, 3, 5])
@pytest.mark.parametrize("method", ["auto", "rank2", "gauss"])
def test_steps(rng, m, method):
    J, I, omega, eps = problems = nd_problems(rng, m, {2: 200, 3: 200, 5: 50}[m])
    run = sf.iterate(sf.SuslovND(J, I), omega, eps, 1, method=method, on_singular="ignore")
    assert ((run.status < 0) == np.isnan(run.final).any(axis=-1)).all()
    check(rng, run.final, problems, partial(step, residual_nd), of_energy)


@pytest.mark.parametrize("D", [1, 2, 3])
def test_steps_of_fields(rng, D):
    q, l, c, x, eps = problems = field_problems(rng, D, 100)
    run = sf.iterate(sf.QuadraticField(q, l, c), x, eps, 1, on_singular="ignore")
    assert ((run.status < 0) == np.isnan(run.final).any(axis=-1)).all()
    check(rng, run.final, problems, partial(step, residual_of_field), lambda *_: [1] * D)


@pytest.mark.filterwarnings("ignore::suslov_fast.SingularStepWarning")
@pytest.mark.parametrize("m", [2, 3])
def test_derivatives(rng, m):
    J, I, omega, eps = problems = nd_problems(rng, m, 300)
    found = sf.jacobian(sf.SuslovND(J, I), omega, eps)
    reference = partial(derivative, residual_nd)

    def weights(*problem):
        return [a / b for a in of_energy(*problem) for b in of_energy(*problem)]

    check(rng, found, problems, reference, weights, LOST_BY_DERIVATIVES)


@pytest.mark.filterwarnings("ignore::suslov_fast.SingularStepWarning")
@pytest.mark.parametrize("D", [1, 2, 3])
def test_derivatives_of_fields(rng, D):
    q, l, c, x, eps = problems = field_problems(rng, D, 100)
    found = sf.jacobian(sf.QuadraticField(q, l, c), x, eps)
    reference = partial(derivative, residual_of_field)
    check(rng, found, problems, reference, lambda *_: [1] * D**2, LOST_BY_DERIVATIVES)
