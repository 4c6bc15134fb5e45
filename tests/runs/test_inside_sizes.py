"""Components of very different sizes, and rates near the ends of the range of numbers."""

import numpy as np
import pytest

import suslov_fast as sf


def field(f, names, **parameters):
    return sf.Field.from_function(f, names, **parameters)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("unit", [1e-3, 1e-8, 1e-14])
def test_a_component_beside_others_in_other_units(rtol, unit):
    """An oscillator of the size `unit` beside a temperature in kelvins that nothing depends on."""
    f = field(lambda s: (s[1], -s[0] - 0.1 * s[0] ** 3 / unit**2, -0.01 * s[2]), "x v T")
    alone = field(lambda s: (s[1], -s[0] - 0.1 * s[0] ** 3), "x v")
    both = sf.flow(f, [unit, 0.0, 300.0], time=20.0, rtol=rtol).x[0]
    exact = sf.flow(alone, [1.0, 0.0], time=20.0, rtol=1e-12).x[0]
    np.testing.assert_allclose(both[:2] / unit, exact, atol=100 * rtol)


@pytest.mark.parametrize("rate", [1e100, 1e160, 1e250, 1e300])
def test_decay_at_rates_whose_squares_overflow(rate):
    f = field(lambda s: (-rate * s[0], -s[1]), "x y")
    motion = sf.flow(f, [1.0, 1.0], time=[1.0, 2.0])
    np.testing.assert_allclose(motion.x[:, 1], np.exp([-1.0, -2.0]), rtol=1e-8)
    assert (abs(motion.x[:, 0]) < 1e-9).all()
    assert motion.steps < 2000
