"""Branches of f: one that is not taken counts for nothing."""

import numpy as np
import pytest

import suslov_fast as sf


def field(f, names="x t", **parameters):
    return sf.Field.from_function(f, names, **parameters)


# The integral of sin(t) / t from 0 to 1, and that of (1 - cos t) / t from 1 to 1.1.
SINE, COSINE = 0.946083070367183, 0.0478407252806422


@pytest.mark.parametrize(
    ("rate", "start", "exact"),
    [
        (lambda t: np.where(t < 1, 1 / (2 - t), 0), 0.0, np.log(2)),
        (lambda t: np.where(t < 1, -1 / (2 - t), 0), 0.0, -np.log(2)),
        (lambda t: (t < 1) / (2 - t), 0.0, np.log(2)),
        (lambda t: (t < 1) * (1 / (2 - t)), 0.0, np.log(2)),
        (lambda t: np.heaviside(1 - t, 0) / (2 - t), 0.0, np.log(2)),
        (lambda t: np.where(t < 1, np.sin(t) / np.cos(t), 0), 0.0, -np.log(np.cos(1))),
        (lambda t: np.where(t < 4, np.where(t < 1, 1 / (3 - t), 0), 1 / (t - 3)), 0.0,
         np.log(3)),
        (lambda t: sum(np.where(t < k / 12, 1 / (2 - t), 0) for k in range(12)), 0.0,
         sum(np.log(2 / (2 - k / 12)) for k in range(12))),
        # A zero of the dividend is no pole.
        (lambda t: np.where(t != 0, np.sin(t) / t, 1), -1.0, SINE * 2),
        (lambda t: np.where(t < 1, np.where(t == 0, 0, (1 - np.cos(t)) / t), 0), -1.1, -COSINE),
    ],
)  # fmt: skip
@pytest.mark.parametrize("stiff", [None, True])
def test_a_pole_that_is_not_taken(rate, start, exact, stiff):
    f = field(lambda s: (rate(s[1]), 1.0))
    time = 2.0 if start == -1.0 else 5.0
    motion = sf.flow(f, [[0.0, start]] * 2, time=time, stiff=stiff)
    np.testing.assert_allclose(motion.x[0, 0, 0], exact, rtol=1e-7)
    np.testing.assert_array_equal(motion.x[:, :1], motion.x[:, 1:])
    alone = sf.flow(f, [0.0, start], time=time, stiff=stiff)
    np.testing.assert_array_equal(alone.x, motion.x[:, 0])


@pytest.mark.parametrize(
    ("rate", "end"),
    [
        (lambda t: np.where(t < 3, 1 / (2 - t), 0), 2.0),
        (lambda t: np.where(t < 1, 0, -1 / (t - 2)), 2.0),
        (lambda t: np.cos(t) / np.sin(t), np.pi),
    ],
)
def test_a_pole_that_is_taken_ends_the_solution(rate, end):
    with pytest.warns(sf.PoleWarning):
        motion = sf.flow(field(lambda s: (rate(s[1]), 1.0)), [0.0, 0.5], time=5.0)
    assert motion.status == sf.Status.ENDED
    np.testing.assert_allclose(motion.end, end - 0.5, rtol=1e-8)


def test_members_of_a_family_whose_factor_is_0_have_no_pole():
    f = field(lambda s, a: (a * (1 / (2 - s[1])), 1.0), a=[0.0, 1.0])
    with pytest.warns(sf.PoleWarning):
        motion = sf.flow(f, [0.0, 0.0], time=5.0)
    np.testing.assert_array_equal(motion.x[0, 0], [0.0, 5.0])
    np.testing.assert_allclose(motion.end[1], 2.0, rtol=1e-8)


def test_derivatives_beside_a_pole_that_is_not_taken():
    f = field(lambda s, a: (np.where(s[1] < 1, -a * s[0] / (2 - s[1]), -s[0]), 1.0), a=1.0)
    motion = sf.flow(f, [1.0, 0.0], time=5.0, derivatives=("a", "x0"))
    end = np.exp(-4) / 2  # x = 1 - t/2 up to 1
    np.testing.assert_allclose(motion.x[0, 0], end, rtol=1e-8)
    np.testing.assert_allclose(motion.derivative("a")[0, 0], -np.log(2) * end, rtol=1e-7)
    np.testing.assert_allclose(motion.derivative("x0")[0, 0, 0], end, rtol=1e-7)
