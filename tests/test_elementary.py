"""exp and log of the kernels against 60 digits."""

import numba
import numpy as np
import pytest
from naive import mpf, mpmath

from suslov_fast._formulas import elementary, twofold


def callable_from_python(formula):
    """Call a formula, which has no Python wrapper, without the warnings of interpreted code."""
    compiled = numba.njit(lambda *numbers: formula(*numbers), error_model="numpy")
    return np.errstate(all="ignore")(compiled)


exponential = callable_from_python(elementary.exponential)
logarithm_beyond = callable_from_python(elementary.logarithm_beyond)
logarithm_of_ratio = callable_from_python(twofold.logarithm_of_ratio)


def relative_error(computed, exact):
    return abs(computed / exact - 1)


@pytest.mark.parametrize("low", [-1e-12, -0.3, -2.0, -30.0, -700.0, -1e5])
def test_exponential(rng, low):
    for x in np.append(rng.uniform(low, 0, 50), [low, 0.0]):
        lost = 2.0**-54 * x
        p, k = exponential(x, lost)
        exact = mpmath.exp(mpf(float(x)) + mpf(float(lost)))
        assert relative_error(1.0 + p, exact / mpf(2) ** int(k)) < 3e-16
        if k == 0 and x < 0:
            assert relative_error(p, exact - 1) < 3e-16


def test_logarithm(rng):
    for s in rng.uniform(-0.171, 0.171, 50):
        exact = 2 * mpmath.atanh(mpf(float(s)))
        assert relative_error(2 * s + logarithm_beyond(s), exact) < 3e-16


@pytest.mark.parametrize("center", [0.0, 1.0])
def test_the_logarithm_of_a_ratio_has_more_digits(rng, center):
    """For T given as a sum of two numbers, the error of log((1 - T)/(1 + T)) is below 1e-17."""
    for _ in range(60):
        T = abs(center + 10.0 ** rng.uniform(-15, 1) * rng.choice([-1, 1]))
        lost = 2.0**-54 * T * rng.uniform(0.1, 1)
        exact_T = mpf(float(T)) + mpf(float(lost))
        ratio = (1 - exact_T) / (1 + exact_T)
        high, low = logarithm_of_ratio(T, lost, float(ratio))
        exact = mpmath.log(abs(ratio))
        assert abs(mpf(float(high)) + mpf(float(low)) - exact) < 1e-17 * abs(exact)
