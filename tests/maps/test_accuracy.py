"""Backward error: results are exact ones of inputs that changed by a few units in the last place.

Errors in three dimensions are in the norm of the energy, |(sqrt(I1) Omega1, sqrt(I2) Omega2)|, and
in units of the condition: the sum of the changes of the result by a change of half an ulp in each
input, and half an ulp of the result. References have 60 digits.
"""

from functools import partial

import adversary
import naive
import numpy as np
import pytest

import suslov_fast as sf

SLOW = pytest.mark.slow, pytest.mark.compiled
WORST = 1e-2  # conditions above tell nothing


def body_of(I1, I2, I13, I23, k=0.0):
    return sf.Suslov3D(I1, I2, I13, I23, k) if k else sf.Suslov3D(I1, I2, I13, I23)


def distance_in(inputs):
    """Distances of states, or of pairs of states, in the norm of the energy."""
    J = inputs[:2]

    def distance(found, want):
        pairs = [slice(i, i + 2) for i in range(0, len(want), 2)]
        return max(naive.energy_error(J, found[pair], want[pair]) for pair in pairs)

    return distance


def map_at(n, *inputs):
    return naive.solution_with_rotor(*inputs, n)


def flow_at(I1, I2, I13, I23, k, time, w1, w2):
    return naive.solution_with_rotor(I1, I2, I13, I23, k, 1, w1, w2, time, flows=True)


def error(found, inputs, solution):
    """Error in units of the condition; None if the problem is too ill conditioned to tell."""
    distance = distance_in(inputs)
    want, condition = naive.condition(solution, inputs, distance)
    if not condition < WORST:
        return None
    return distance(found, want) / condition if np.isfinite(found).all() else np.inf


# Each function returns the error of one kernel for a problem, relative to what is promised.
def of_exact(draw, inputs):
    n = adversary.index(draw, 15.95)
    if draw.chance(0.2) and has_real_powers(inputs):
        n *= draw.rng.random()
    found = body_of(*inputs[:5]).exact(inputs[6:], inputs[5], n)
    return scaled(error(found, inputs, partial(map_at, n)), 32)


def has_real_powers(inputs):
    """True if e L < 1, or |k| > A."""
    I1, I2, I13, I23, k, eps, w1, w2 = naive.exactly(*inputs)
    level = naive.level(I1, I2, I13, I23, eps, (w1, w2), k)  # (2 A / sqrt(4 I1 I2))**2
    return eps**2 * (level - k**2 / (4 * I1 * I2)) < 1 - 1e-6


def of_flow(draw, inputs):
    time = adversary.index(draw, 15.95) * abs(inputs[5])
    inputs = *inputs[:5], time, *inputs[6:]
    found = sf.flow(body_of(*inputs[:5]), inputs[6:], time=time).states[0]
    return scaled(error(found, inputs, flow_at), 32)


def of_limits(draw, inputs):
    found = body_of(*inputs[:5]).limits(inputs[6:], inputs[5])
    if np.isnan(found).any() or adversary.terms_cancel(inputs):  # it turns, or rests
        return None
    return scaled(error(np.ravel(found), inputs, naive.limits_with_rotor), 32)


def of_steps(draw, inputs):
    n = abs(adversary.index(draw, 3.0))
    body, eps, omega = body_of(*inputs[:5]), inputs[5], inputs[6:]
    run = sf.iterate(body, omega, eps, n, save_every=None, on_singular="ignore")
    if run.status < 0:  # then state n is next to a pole
        n = int(run.failed_at)
        failed = error(np.zeros(2), inputs, partial(map_at, n))
        return None if failed is None else np.inf
    return scaled(error(run.final, inputs, partial(map_at, n)), 128 * max(1, n / 100))


def scaled(number, bound):
    return None if number is None else number / bound


THREE = {"exact": of_exact, "flow": of_flow, "limits": of_limits, "iterate": of_steps}


@pytest.mark.filterwarnings("ignore")  # of missing states
@pytest.mark.parametrize("kernel", THREE)
@pytest.mark.parametrize("cases", [15, pytest.param(80, marks=SLOW)])
def test_backward_errors_next_to_two_degenerate_sets(kernel, cases, seed):
    draw, errors = adversary.Adversary(np.random.default_rng([seed, cases])), []
    for _ in range(cases):
        inputs, sets = adversary.planar(draw)
        found = THREE[kernel](draw, inputs)
        assert found is None or found < 1, (kernel, found, inputs, sets)
        errors += [] if found is None else [found]
    assert len(errors) > (0.25 if kernel == "limits" else 0.8) * cases
    assert np.median(errors) < 1 / 16


@pytest.mark.parametrize("size", [1e3, 1e5, 1e8])
def test_large_dimensionless_numbers(size):
    """X, Y and K up to 1e8 keep seven digits; beyond, there is a warning."""
    rng = np.random.default_rng(2)
    I1, I2, I13, I23, eps = 2.0, 1.0, 0.5, 0.25, 0.5
    e, g = eps / (2 * np.sqrt(I1 * I2)), complex(I13 / np.sqrt(I1), I23 / np.sqrt(I2))
    for case in range(12):
        X, Y, K = size * 10.0 ** rng.uniform(-4, 0, 3) * rng.choice([-1, 1], 3) * [1, 1, case % 2]
        z, n = g * complex(X - K, -Y) / (e * abs(g) ** 2), int(rng.choice([1, -2, 30]))
        omega, k = [z.real / np.sqrt(I1), z.imag / np.sqrt(I2)], K / e
        inputs = tuple(map(float, (I1, I2, I13, I23, k, eps, *omega)))
        found = body_of(*inputs[:5]).exact(omega, eps, n)
        bound = 32 if size == 1e3 else 1e-9 * 2.0**53
        assert (error(found, inputs, partial(map_at, n)) or 0.0) < bound
        with pytest.warns(RuntimeWarning, match="1e8|1e\\+08|range"):
            beyond = body_of(*inputs[:4], 1e9 * k).exact(2e12 * np.array(omega), eps, n)
        assert np.isnan(beyond).all()
