"""`values`: functions of the state and of parameters along runs, beside NumPy's."""

from functools import cache

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import Field, flow

FORCED = Field(lambda t, y, k: (y[1], -k * y[0] + np.cos(t)), "x v", k=np.array([1.0, 2.0]))
TIMES = np.linspace(0.0, 5.0, 11)
T, K = TIMES[:, np.newaxis] + 0.5, np.array([1.0, 2.0])


@cache
def a_motion():
    return flow(FORCED, [[1.0, 0.0], [0.0, 1.0]], time=TIMES, t0=0.5)


def filled(y, k):
    rows = np.zeros(2)
    rows[0] = k
    if y[1] > 0:
        rows[1] = y[0]
    return rows


# Functions, and their values of arrays x, v.
FUNCTIONS = {
    "time": (lambda t, y, k: k * y[0] + t, lambda x, v: K * x + T),
    "branches": (lambda y: np.where(y[0] > y[1], y[0], 0), lambda x, v: np.where(x > v, x, 0)),
    "arrays": (filled, lambda x, v: np.stack([K + 0 * x, np.where(v > 0, x, 0)], -1)),
    "norm": (lambda y: np.linalg.norm(y), np.hypot),
    "constant": (lambda y: 3.0, lambda x, v: np.full(x.shape, 3.0)),
    "formula": ("k*x + t", lambda x, v: K * x + T),
    "formulas": (["x*v", "k"], lambda x, v: np.stack([x * v, K + 0 * x], -1)),
    "a state": (lambda y, k: (y[1], -k * y[0]), lambda x, v: np.stack([v, -K * x], -1)),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_along_a_forced_family(name):
    f, of_arrays = FUNCTIONS[name]
    motion = a_motion()
    wanted, found = of_arrays(motion["x"], motion["v"]), motion.values(f)
    assert found.shape == wanted.shape
    np.testing.assert_allclose(found, wanted, rtol=1e-14, atol=1e-14)
    assert not found.flags.writeable


def test_functions_along_runs_of_maps_and_bodies():
    mcmillan = sf.Map(lambda s, a: (s[1], a * s[1] / (1 - s[1] ** 2) - s[0]), "x y", a=[2.0, 3.0])
    run = sf.iterate(mcmillan, [0.1, 0.2], steps=100)
    biquadratic = run.values(
        lambda s, a: (s[0] * s[1]) ** 2 + a * s[0] * s[1] - s[0] ** 2 - s[1] ** 2
    )
    assert np.ptp(biquadratic, axis=0).max() < 1e-10
    orbit = sf.iterate(sf.Suslov3D(4, 2, -0.5, -0.25), [1.0, 0.5], 0.2, 100)
    energy = orbit.values(lambda w: 2 * w[0] ** 2 + w[1] ** 2)
    np.testing.assert_allclose(energy, orbit.energy(), rtol=1e-14)
    complex = flow(Field(lambda z: 1j * z, "z", complex=True), [1 + 0j], time=TIMES)
    np.testing.assert_allclose(complex.values(lambda z: abs(z[0])), 1.0, rtol=1e-8)


def test_states_that_do_not_exist_have_no_values():
    with pytest.warns(sf.IntegrationWarning):
        motion = flow(lambda x: x**2, [[1.0], [-1.0]], time=[0.5, 2.0])
    found = motion.values(lambda x: 1.0 + 0 * x[0])
    assert np.isnan(found).tolist() == [[False, False], [True, False]]


WRONG = [
    (lambda y, q: y[0], "'q': the system has k"),
    (3, "a function of the state"),
    ("x + y", "names of this system are x, v, t or k"),
]


@pytest.mark.parametrize(("f", "said"), WRONG)
def test_what_is_no_function_of_the_state(f, said):
    with pytest.raises((TypeError, ValueError), match=said):
        a_motion().values(f)


def test_a_run_of_kahans_map_knows_the_time():
    prey = Field(lambda t, y: (y[0] * (1 - y[1]), y[1] * (y[0] - 1)), "x y")
    run = sf.iterate(prey, [1.0, 0.5], 0.1, 3, t0=2.0)
    np.testing.assert_array_equal(run.values(lambda t, y: y[0]), run["x"])
    np.testing.assert_array_equal(run.values(lambda t, y: t * y[0]), (2 + run.time) * run["x"])
    halves = sf.iterate(sf.Map(lambda x: (x[0] / 2,), 1), [1.0], steps=2)
    with pytest.raises(TypeError, match="takes no time"):
        halves.values(lambda t, y: t * y[0])
