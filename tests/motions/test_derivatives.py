"""Derivatives of motions by starts and parameters, against Taylor series."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from children import TWO_THREADS
from systems import lorenz, oregonator, robertson, van_der_pol

import suslov_fast as sf
from suslov_fast import Field, flow, lyapunov_exponents


def predators(x, a, b):
    return x[0] * (a - x[1]), x[1] * (b * x[0] - 1)


def pendulum(x, g, c):
    return x[1], -g * np.sin(x[0]) - c * x[1]


def kepler(x, mu):
    factor = -mu / np.hypot(x[0], x[1]) ** 3
    return x[2], x[3], factor * x[0], factor * x[1]


def hires(y, k):
    pair = k * y[5] * y[7]
    return (
        -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
        1.71 * y[0] - 8.75 * y[1],
        -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
        8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
        -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
        -pair + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
        pair - 1.81 * y[6],
        -pair + 1.81 * y[6],
    )


# f, start, time, parameters.
CASES = {
    "lorenz": (lorenz, [1.0, 1.0, 20.0], 1.5, {"sigma": 10.0, "rho": 28.0, "beta": 2.5}),
    "predators": (predators, [1.0, 2.0], 6.0, {"a": 1.0, "b": 0.8}),
    "pendulum": (pendulum, [2.0, 0.0], 5.0, {"g": 1.5, "c": 0.1}),
    "kepler": (kepler, [1.0, 0.0, 0.0, 1.2], 4.0, {"mu": 1.0}),
}
STIFF = {
    "robertson": (robertson, [1.0, 0.0, 0.0], 0.05, {"k1": 0.04, "k3": 3e7}),
    "van_der_pol": (van_der_pol, [2.0, -0.6], 0.1, {"mu": 300.0}),
    "hires": (hires, [1, 0, 0, 0, 0, 0, 0, 0.0057], 2.0, {"k": 280.0}),
    "oregonator": (oregonator, [1.0, 2.0, 3.0], 0.2, {"s": 77.27, "q": 8.375e-6}),
}
# Ends by mpmath's Taylor series, with derivatives by central differences in 30 digits.
WANTED = json.loads((Path(__file__).parents[1] / "data" / "derivatives.json").read_text())


def errors(name, rtol, **options):
    """Return the largest errors of states, and of derivatives by starts and by parameters."""
    f, x, time, parameters = (CASES | STIFF)[name]
    field, wanted = Field(f, len(x), **parameters), WANTED[name]
    by = ["x0", *parameters]
    motion = flow(field, x, time=time, rtol=rtol, derivatives=by, **options)
    found = {"x": motion.states[0]} | {each: motion.derivatives[each][0] for each in by}
    return [abs(found[k] - wanted[k]).max() / abs(np.array(wanted[k])).max() for k in ("x", *by)]


@pytest.mark.parametrize("name", CASES)
def test_derivatives_beside_taylor_series(name):
    for rtol in (1e-4, 1e-9, 1e-12):
        assert max(errors(name, rtol)) < 1e3 * rtol
    assert max(errors(name, 1e-9, stiff=True)) < 1e-6


@pytest.mark.parametrize("name", STIFF)
@pytest.mark.parametrize("stiff", [None, True])
def test_stiff_derivatives_beside_taylor_series(name, stiff):
    for rtol in (1e-4, 1e-6, 1e-9):
        assert max(errors(name, rtol, stiff=stiff)) < 1e3 * rtol
    assert max(errors(name, 1e-12, stiff=stiff)) < 1e-10


@pytest.mark.parametrize(
    ("f", "start", "time"), [(robertson, [1.0, 0.0, 0.0], 1e4), (van_der_pol, [2.0, 0.0], 1500.0)]
)
def test_stiff_derivatives_take_about_the_steps_of_states(f, start, time):
    parameters = {"k1": 0.04} if f is robertson else {"mu": 1000.0}
    ((name, value),) = parameters.items()
    field, h = Field(f, len(start), **parameters), 1e-4
    states, columns = (
        flow(field, start, time=time, rtol=1e-8, derivatives=by) for by in ((), ("x0", name))
    )
    assert columns.steps < 2.2 * states.steps
    of = field.with_parameters(**{name: [value * (1 + h), value * (1 - h)]})
    above, below = flow(of, start, time=time, rtol=1e-12).states[0]
    wanted = (above - below) / (2 * h * value)
    found = columns.derivatives[name][0]
    np.testing.assert_allclose(found, wanted, rtol=3e-3, atol=2e-6 * abs(wanted).max())


PREDATORS = Field(predators, "u v", a=[1.0, 1.5], b=0.8)


def test_batches_and_families(rng):
    x, times = rng.uniform(0.5, 2.0, (5, 2, 2)), [3.0, 0.0, 1.0]
    motion = flow(PREDATORS, x, time=times, derivatives="b x0")
    assert motion.derivatives["x0"].shape == (3, 5, 2, 2, 2)
    assert motion.derivatives["b"].shape == (3, 5, 2, 2)
    assert (motion.derivatives["x0"][1] == np.eye(2)).all()
    assert [*motion.derivatives] == ["b", "x0"]
    assert not motion.derivatives["b"][1].any()
    for k in (0, 1):
        options = {"derivatives": ("x0", "b"), "threads": TWO_THREADS}
        alone = flow(PREDATORS[k], x[2, k], time=times, **options)
        for name in ("x0", "b"):
            assert (alone.derivatives[name] == motion.derivatives[name][:, 2, k]).all()
    there = flow(PREDATORS[0], x[0, 0], time=2.0, rtol=1e-12, derivatives="x0")
    back = flow(PREDATORS[0], there.states[0], time=-2.0, rtol=1e-12, derivatives="x0")
    product = back.derivatives["x0"][0] @ there.derivatives["x0"][0]
    np.testing.assert_allclose(product, np.eye(2), atol=1e-10)


def test_bodies_by_starts():
    body = sf.Suslov3D(4, 1, -0.5, -0.3)
    found = flow(body, [1.0, 0.5], time=2.0, rtol=1e-12, derivatives="x0").derivatives["x0"][0]
    h = 1e-5 * np.eye(2)
    ends = [flow(body, [1.0, 0.5] + sign * h, time=2.0).states[0] for sign in (1, -1)]
    np.testing.assert_allclose(found, (ends[0] - ends[1]).T / 2e-5, atol=1e-8)


def test_a_steady_state_at_a_tie():
    field = Field(lambda x: (np.log(2.0) - np.logaddexp(0.0, x[0]),), "x")
    motion = flow(field, [0.0], time=[0.5, 1.0], derivatives="x0")
    assert (motion.states == 0.0).all()
    found = motion.derivatives["x0"].ravel()
    np.testing.assert_allclose(found, np.exp([-0.25, -0.5]), rtol=1e-8)
    assert lyapunov_exponents(field, [0.0], time=1.0) == pytest.approx(-0.5, rel=1e-8)


def test_atol_for_each_component():
    f, x, _, parameters = STIFF["robertson"]
    field = Field(f, 3, **parameters)
    options = {"rtol": 1e-7, "atol": [1e-8, 1e-13, 1e-8], "derivatives": "k1"}
    found = flow(field, x, time=4e4, **options).derivatives["k1"][0]
    h = 1e-6
    ends = [
        flow(field.with_parameters(k1=0.04 + k * h), x, time=4e4, rtol=1e-12).states[0]
        for k in (1, -1)
    ]
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / (2 * h), rtol=1e-3)


def test_solutions_that_end():
    family = Field(lambda x, a: (a * x[0] ** 2,), 1, a=[0.1, 2.0])
    with pytest.warns(sf.IntegrationWarning):
        motion = flow(family, [1.0], time=[0.2, 1.0], derivatives=("a", "x0"))
    exact = 1 / (1 - np.outer([0.2, 1.0], [0.1, 2.0])) ** 2
    by_start = motion.derivatives["x0"][..., 0, 0]
    np.testing.assert_allclose(by_start[:, 0], exact[:, 0], rtol=1e-8)
    np.testing.assert_allclose(by_start[0, 1], exact[0, 1], rtol=1e-7)
    assert np.isnan(by_start[1, 1])
    assert np.isnan(motion.derivatives["a"][1, 1, 0])


def test_states_keep_their_tolerance_beside_large_derivatives():
    """Derivatives of a jump are 1e9 times as large as the states, and do not loosen theirs."""
    field = Field(lambda x: (x[1], 1e3 * (1 - x[0] ** 2) * x[1] - x[0]), 2)
    x0, T = [-1.74548624, 8.52819734e-4], 1614.4011258
    wanted = flow(field, x0, time=T, rtol=1e-12).states[0]
    found = flow(field, x0, time=T, rtol=1e-8, derivatives="x0")
    assert found.states[0] == pytest.approx(wanted, rel=2e-6)


def test_derivatives_of_crossings_and_their_files(tmp_path):
    """Of x'' = -w**2 x from (1, v): three crossings of x = c upward after t = 15."""
    w, c, v = np.array([1.0, 2.5]), 0.25, 0.5
    field = Field(lambda s, w, c: (s[1], -(w**2) * s[0]), "x v", w=w, c=c)
    wanted = {"direction": "up", "transient": 15.0, "most": 3, "derivatives": ("c", "x0", "w")}
    met = sf.crossings(field, [1.0, v], lambda s, c: s[0] - c, time=25.0, **wanted)
    assert met.count.ravel().tolist() == [3, 3]
    own, t = w[met.trajectory], met.time
    sin, cos = np.sin(own * t), np.cos(own * t)
    rate = v * cos - own * sin  # with x = cos(w t) + v / w sin(w t) = c
    of_w = (v / own * cos - sin) * t - v / own**2 * sin
    found = met.derivatives
    np.testing.assert_allclose(found["c"].time, 1 / rate, rtol=1e-6)
    np.testing.assert_allclose(found["w"].time, -of_w / rate, rtol=1e-6)
    by_start = -np.stack([cos, sin / own], axis=-1) / rate[:, np.newaxis]
    np.testing.assert_allclose(found["x0"].time, by_start, rtol=1e-6)
    np.testing.assert_allclose(found["c"].states[:, 0], 1.0, rtol=1e-6)
    np.testing.assert_allclose(found["w"].before[:, 0], 0.0, atol=1e-6)
    kick = sf.Event("x - 0.5", to=("x", "2*v"), direction="up")
    motion = flow(field, [1.0, v], time=[3.0, 9.0], events=kick, derivatives=("w", "x0"))
    for result in (met, motion):
        result.save(tmp_path / "result.npz", overwrite=True)
        loaded = sf.load(tmp_path / "result.npz")
        assert loaded == result
        events = getattr(loaded, "events", loaded)
        assert events != replace(events, _time_by=np.zeros((len(events.time), 4)))
    alone = motion.member(1).events.derivatives["x0"].time
    np.testing.assert_array_equal(alone, motion.events.derivatives["x0"].time[-len(alone) :])


def test_fields_that_were_computed_before_do_not_matter():
    """They differ in a branch beyond a surface, in the number of variables, or in a lag."""
    for factor in (0.3, 2.0):
        field = Field(lambda x, c=factor: (np.where(x[0] > 1.0, c, 0.7) * x[0],), 1)
        found = flow(field, [0.5], time=3.0, derivatives="x0").final
        np.testing.assert_allclose(found, [np.exp(factor * (3 - np.log(2) / 0.7))], rtol=1e-8)
    flow(Field(lambda x: (-x[0],), 1), [1.0], time=1.0, derivatives="x0")
    found = flow(Field(lambda x: (-x[0], -x[1]), 2), [1.0, 2.0], time=1.0).final
    np.testing.assert_allclose(found, np.exp(-1) * np.array([1, 2]), rtol=1e-8)

    knots, heights = np.arange(4.0), [0.0, 1.0, 5.0, 0.0]

    def lagged(height):
        def f(s, a, b):
            return (0.1 * (s[1] - a) + 0.01 * (s[1] - b)) * s[0] + height(s[1], a, b), 1.0

        return flow(Field(f, "x t", a=0.5, b=2.0), [0.0, 0.1], time=6.0).final[0]

    for place, lag in enumerate((0.5, 2.0)):
        found = lagged(lambda t, *lags, k=place: np.interp(t - lags[k], knots, heights))
        right = lagged(lambda t, a, b, lag=lag: np.interp(t, knots + lag, heights))
        assert abs(found / right - 1) < 1e-8
