"""Backward error: results are exact ones of inputs that changed by a few units in the last place.

Errors are in the norm of the energy, |(sqrt(I1) Omega1, sqrt(I2) Omega2)|, and in units of the
condition: the sum of the changes of the result by a change of half an ulp in each input, and half
an ulp of the result. The reference has 60 digits.
"""

from functools import partial

import naive
import numpy as np
import pytest

import suslov_fast as sf

SLOW = pytest.mark.slow, pytest.mark.compiled
REGIMES = [
    "body, T < 1",
    "body, next to the line",
    "rotor, passes",
    "rotor, passes, next to the line",
    "rotor, next to |k| = A",
    "rotor, turns",
    "body, T >= 1",
    "rotor, passes, T >= 1",
    "rotor, turns, T >= 1",
    "rotor, g = 0",
    "small and large units",
    "body, T = 1",
    "flow, body",
    "flow, next to the line",
    "flow, rotor",
]


def problem(regime, rng, case):
    """Return I1, I2, I13, I23, k, eps, Omega1, Omega2, as floats, and n."""
    I1, I2 = rng.uniform(1, 4, 2)
    I13, I23 = rng.uniform(-0.9, 0.9, 2)
    w, k, eps = rng.uniform(-2, 2, 2), 0.0, rng.choice([0.05, 0.3]) * rng.choice([-1, 1])
    n = int(rng.choice([1, 5, 30, 200, 1000, 10**6]) * rng.choice([-1, 1]))
    if "passes" in regime or regime == "flow, rotor":
        k = rng.choice([1e-9, 0.05, -0.05, 0.3, -0.3])
    if "turns" in regime or (regime == "flow, rotor" and case % 2):
        k = rng.choice([2.0, -5.0, 30.0])
    if "line" in regime:
        distance = 10.0 ** rng.uniform(-14, -2)
        w = np.array([I23, -I13]) * rng.uniform(0.5, 2) * rng.choice([-1, 1])
        w += rng.uniform(-1, 1, 2) * distance - k * np.array([I13, I23]) / (I13**2 + I23**2)
        if case % 3 == 0 and k == 0.0:  # l has all its digits
            I13, w = 0.0, np.array([rng.uniform(0.5, 2) * rng.choice([-1, 1]), distance])
    if "|k| = A" in regime:
        k = 0.0
        for _ in range(60):
            F = (I1 * w[0] ** 2 + I2 * w[1] ** 2) / (
                4 * I1 * I2 + (eps * (I13 * w[0] + I23 * w[1] + k)) ** 2
            )
            k = 2 * np.sqrt(F * (I13**2 * I2 + I23**2 * I1))
        k *= 1 + rng.choice([-1, 1]) * rng.choice([0.0, 10.0 ** rng.uniform(-14, -1)])
        k *= rng.choice([-1, 1])
    if "T >= 1" in regime:
        eps = rng.choice([3.0, 10.0, 100.0]) * rng.choice([-1, 1])
        n = int(np.clip(n, -1000, 1000))
        w = w * 10.0 ** rng.uniform(0, 4) if case % 4 == 0 else w
    if "g = 0" in regime:
        I13, I23, k = 0.0, 0.0, rng.choice([0.3, -2.0, 50.0])
    if "units" in regime:
        mass, rate = 10.0 ** rng.uniform(-15, 15, 2)
        I1, I2, I13, I23 = mass * np.array([I1, I2, I13, I23])
        w, eps, k = w * rate, eps / rate, rng.choice([0, 0.1, -3]) * mass * rate
    if "T = 1" in regime:  # exactly
        I1, I2, I13, I23, eps = 1.0, 1.0, 0.0, rng.choice([-1.0, 1.0]), 2.0
        w, n = np.array([rng.choice([-1.0, 1.0]), rng.uniform(-3, 3)]), int(rng.choice([1, 2, 10]))
    if "flow" in regime:
        n, eps = float(rng.uniform(-60, 60) * rng.choice([0.1, 1, 10])), 1.0
    return tuple(map(float, (I1, I2, I13, I23, k, eps, *w))), n


def body_of(I1, I2, I13, I23, k=0.0):
    return sf.SuslovGyrostat(I1, I2, I13, I23, k) if k else sf.Suslov3D(I1, I2, I13, I23)


def reference(inputs, n, flows):
    """The state and its condition; None if it is too ill conditioned to tell anything."""
    *body, eps, w1, w2 = inputs

    def distance(state, other):
        return naive.energy_error(inputs[:2], state, other)

    if flows:
        inputs = *body, n, w1, w2

        def solution(*changed):
            *body, time, w1, w2 = changed
            return naive.solution_with_rotor(*body, 1, w1, w2, time, flows=True)
    else:
        # For T = 1, (1 + e G)**n may be 0 exactly.
        inputs = *body, eps, w1 * (1 + naive.mpf(10) ** -40), w2

        def solution(*changed):
            return naive.solution_with_rotor(*changed, n)

    want, condition = naive.condition(solution, inputs, distance)
    return (want, condition) if condition < 1e-2 else None


def error_of(state, inputs, found):
    """Error of a state in units of the condition."""
    want, condition = found
    return naive.energy_error(inputs[:2], state, want) / condition


def error_of_exact(inputs, n):
    """Error of the closed form; 0 if the problem is too ill conditioned to tell anything."""
    found = reference(inputs, n, False)
    state = sf.exact(body_of(*inputs[:5]), inputs[6:], inputs[5], n)
    return error_of(state, inputs, found) if found else 0.0


def errors(regime, cases):
    """Yield the error of the closed form, and of steps relative to their number, in conditions."""
    rng, flows = np.random.default_rng(7), "flow" in regime
    for case in range(cases):
        inputs, n = problem(regime, rng, case)
        found = reference(inputs, n, flows)
        if found is None:
            continue
        body, eps, omega = body_of(*inputs[:5]), inputs[5], inputs[6:]
        state = sf.flow(body, omega, n) if flows else sf.exact(body, omega, eps, n)
        of_steps = 0.0
        if not flows and 0 < n <= 1000:
            final = sf.iterate(body, omega, eps, n, save_every=None).final
            of_steps = error_of(final, inputs, found) / max(1, n / 100)
        yield error_of(state, inputs, found), of_steps


@pytest.mark.parametrize("regime", REGIMES)
@pytest.mark.parametrize("cases", [60, pytest.param(400, marks=SLOW)])
def test_backward_error(regime, cases):
    closed_form, steps = zip(*errors(regime, cases), strict=True)
    assert len(steps) > 0.8 * cases
    assert max(closed_form) < 32
    assert max(steps) < 128
    assert np.median(closed_form) < 2


def independent_numbers(rng):
    """Parameters over 16 orders of magnitude, with X, Y and K up to 1e3."""
    signs = rng.choice([-1, 1], 5)
    I1, I2, I13, I23, k, w1, w2 = 10.0 ** rng.uniform(-8, 8, 7)
    k *= rng.choice([0, 1])
    e = 1 / (2 * np.sqrt(I1 * I2))
    X, Y = e * (I13 * w1 + I23 * w2 + k), (I23 / I2 * w1 + I13 / I1 * w2) / 2
    eps = 10.0 ** rng.uniform(-8, 3) / max(X, Y, e * k)
    I13, I23, k, w1, w2 = signs * [I13, I23, k, w1, w2]
    return tuple(map(float, (I1, I2, I13, I23, k, eps, w1, w2)))


def test_parameters_far_apart():
    rng = np.random.default_rng(3)
    for _ in range(150):
        inputs, n = independent_numbers(rng), int(rng.choice([1, -1, 3, 40, -1000]))
        assert error_of_exact(inputs, n) < 32


@pytest.mark.parametrize("n", [10**9, -(10**12), 2**53])
def test_n_up_to_2_to_the_53(n):
    for k, eps in ((0.0, 0.3), (0.0, 10 / n), (0.3, 1e-9), (2.0, 0.3), (2.0, -10 / n)):
        assert error_of_exact((2.3, 1.4, 0.5, -0.7, k, eps, 1.1, -0.4), n) < 32


@pytest.mark.parametrize("size", [1e3, 1e5, 1e8])
def test_large_dimensionless_numbers(size):
    """X, Y and K up to 1e8 keep seven digits; beyond, there is a warning."""
    rng = np.random.default_rng(2)
    I1, I2, I13, I23, eps = 2.0, 1.0, 0.5, 0.25, 0.5
    e, g = eps / (2 * np.sqrt(I1 * I2)), complex(I13 / np.sqrt(I1), I23 / np.sqrt(I2))
    for case in range(40):
        X, Y, K = size * 10.0 ** rng.uniform(-4, 0, 3) * rng.choice([-1, 1], 3) * [1, 1, case % 2]
        z, n = g * complex(X - K, -Y) / (e * abs(g) ** 2), int(rng.choice([1, -2, 30]))
        omega, k = [z.real / np.sqrt(I1), z.imag / np.sqrt(I2)], K / e
        bound = 32 if size == 1e3 else 1e-9 * 2.0**53
        assert error_of_exact((I1, I2, I13, I23, k, eps, *omega), n) < bound
        with pytest.warns(RuntimeWarning, match="1e8|1e\\+08|range"):
            beyond = sf.exact(body_of(I1, I2, I13, I23, 1e9 * k), 2e12 * np.array(omega), eps, n)
        assert np.isnan(beyond).all()


def test_the_reference_follows_the_implicit_equations():
    I1, I2, I13, I23, eps, omega = 2.3, 1.4, 0.5, -0.7, 0.35, (1.1, -0.4)
    for k in (0, 0.05, -3):
        inputs = naive.exactly(I1, I2, I13, I23, k, eps, *omega)
        orbit = naive.orbit(I1, I2, I13, I23, eps, omega, 7, k)
        assert naive.relative_error(naive.solution_with_rotor(*inputs, 7), orbit[-1]) < 1e-50
        start = naive.solution_with_rotor(*inputs[:6], *orbit[-1], -7)
        assert naive.relative_error(start, naive.exactly(*omega)) < 1e-45
        flow = partial(naive.solution_with_rotor, *inputs, flows=True)
        assert naive.relative_error(flow(0), inputs[6:]) < 1e-50
        for time in (0, 0.8, -30):
            slope = naive.derivative(lambda t, flow=flow: flow(*t), [time])
            field = naive.vector_field(I1, I2, I13, I23, flow(time), k)
            assert naive.relative_error([row[0] for row in slope], field) < 1e-25
