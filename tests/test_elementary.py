"""exp and log of the kernels against 60 digits."""

import mpmath
import numpy as np
import pytest

from suslov_fast._core.formulas.elementary import is_integer, logarithm, times_exponential


def relative_error(computed, exact):
    return float(abs((mpmath.mpf(float(computed)) - exact) / exact))


@pytest.mark.parametrize("low", [-1e-12, -0.3, -2.0, -30.0, -700.0, -1300.0])
def test_exponential(rng, low):
    """v keeps the product in range where exp(x) alone is not."""
    v = 2.0**900
    for x in np.append(rng.uniform(low, 0, 200), [low, 0.0]):
        exact = mpmath.mpf(v) * mpmath.exp(mpmath.mpf(float(x)))
        product, less_one = times_exponential(v, x)
        assert relative_error(product, exact) < 5e-16
        if x < 0:
            assert relative_error(less_one, mpmath.expm1(mpmath.mpf(float(x)))) < 5e-16


def test_exponential_out_of_range():
    assert times_exponential(1.0, -1401.0) == (0, -1)
    assert times_exponential(-3.0, -1e300) == (0, -1)
    assert np.isnan(times_exponential(1.0, np.nan)).all()


@pytest.mark.parametrize("exponent", [-18, -9, -3, -1])
def test_logarithm_next_to_1(rng, exponent):
    for distance in rng.uniform(0.01, 1, 200) * 10.0**exponent:
        exact = mpmath.log1p(-mpmath.mpf(float(distance)))
        assert relative_error(logarithm(1.0 - distance, distance), exact) < 6e-16


def test_logarithm_far_from_1(rng):
    for value in np.append(10.0 ** rng.uniform(-300, -0.2, 300), [0.5, 2.0**-1022]):
        exact = mpmath.log(mpmath.mpf(float(value)))
        assert relative_error(logarithm(value, 1.0 - value), exact) < 6e-16


def test_is_integer():
    for v in (0.0, 1.0, 7.0, 2.0**51 + 1, 2.0**52 + 1, 2.0**53, 1e300):
        assert is_integer(v)
    for v in (0.5, 1e-300, 7.25, 2.0**51 + 0.5):
        assert not is_integer(v)
