"""`flow` of fields: the solution of the differential equation to a tolerance."""

import functools
import re
import warnings

import numpy as np
import pytest
from children import TWO_THREADS
from numba import config
from scipy.integrate import solve_ivp
from test_orders import FLOWS, HENON_HEILES, LORENZ, SQUARE, motion

import suslov_fast as sf
from suslov_fast import PoleWarning, QuadraticField, flow
from suslov_fast.core import flow as core_flow
from suslov_fast.core import operations, single_motion, tolerance
from suslov_fast.core.sparse_flow import sums_of_terms
from suslov_fast.engine import threads


def of(f, dimension, **parameters):
    return QuadraticField.from_function(f, dimension, **parameters)


SQUARES = of(lambda z: (z[0] ** 2 - z[1] ** 2, 2 * z[0] * z[1]), 2)  # z' = z**2


def robertson(x):
    slow, back, fast = 0.04 * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
    return back - slow, slow - back - fast, fast


def hires(y, k=280):
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


HIRES = [1, 0, 0, 0, 0, 0, 0, 0.0057]
# At t = 321.8122, from the test set for initial value problems.
HIRES_END = [
    0.7371312573325668e-3, 0.1442485726316185e-3, 0.5888729740967575e-4, 0.1175651343283149e-2,
    0.2386356198831331e-2, 0.6238968252742796e-2, 0.2849998395185769e-2, 0.2850001604814231e-2,
]  # fmt: skip


def oregonator(y):
    s, q, w = 77.27, 8.375e-6, 0.161
    return (
        s * (y[1] - y[0] * y[1] + y[0] - q * y[0] ** 2),
        (-y[1] - y[0] * y[1] + y[2]) / s,
        w * (y[0] - y[2]),
    )


def chain(n, alpha=0.25):
    """Masses between springs, with fixed ends."""

    def f(x):
        q, p = [0, *x[:n], 0], x[n:]
        d = [q[i + 1] - q[i] for i in range(n + 1)]
        force = [each + alpha * each**2 for each in d]
        return [*p, *(force[i + 1] - force[i] for i in range(n))]

    return of(f, 2 * n)


def ring(n, alpha=0.25):
    """The same without ends."""

    def f(x):
        d = [x[(i + 1) % n] - x[i] for i in range(n)]
        force = [each + alpha * each**2 for each in d]
        return [*x[n:], *(force[i] - force[i - 1] for i in range(n))]

    return of(f, 2 * n)


def by_scipy(field, start, time, method="DOP853"):
    """States after a time; those of a batch are one system."""
    start = np.array(start)

    def slopes(t, y):
        return sf.vector_field(field, y.reshape(start.shape)).ravel()

    run = solve_ivp(slopes, (0, time), start.ravel(), method, rtol=1e-13, atol=1e-16)
    return run.y[:, -1].reshape(start.shape)


# -------------------------------------------------------------------------------------- accuracy
@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", FLOWS)
def test_series(name):
    """Against power series in long doubles; forward and back."""
    field, start, time = FLOWS[name]
    end, largest = motion(name).astype(float), abs(motion(name)).max()
    errors = [
        abs(flow(field, start, time, rtol=rtol) - end).max() / largest
        for rtol in (1e-4, 1e-6, 1e-9, 1e-12)
    ]
    factor = 3e3 if name == "Lorenz" else 20
    assert (np.array(errors) < factor * np.array([1e-4, 1e-6, 1e-9, 1e-12])).all(), errors
    assert errors[3] < errors[2] < errors[1] < errors[0]
    back = flow(field, end, -time, rtol=1e-12)
    assert abs(back - start).max() < (1e-5 if name == "Lorenz" else 1e-10)


def test_henon_heiles(rng):
    x = rng.uniform(-0.25, 0.25, (4, 4))
    wanted = by_scipy(HENON_HEILES, x, 20.0)
    for rtol in (1e-6, 1e-9, 1e-12):
        assert abs(flow(HENON_HEILES, x, 20.0, rtol=rtol) - wanted).max() < 10 * rtol + 1e-12


def test_a_periodic_orbit_of_lorenz_returns():
    """The orbit AB, with the printed period."""
    guess = [-13.763610682134, -19.578751942452, 27.0]
    period = 1.558652210716175
    default = flow(LORENZ, guess, period)
    assert abs(default - guess).max() < 1e-6
    exact = flow(LORENZ, guess, period, rtol=1e-13)
    assert abs(exact - guess).max() < 1e-11


def test_exact_solutions_of_bodies(rng):
    start, times = rng.normal(size=(40, 2)), [-20.0, 20.0, 3.0]
    for body in (sf.Suslov3D(4, 1, -0.5, -0.3), sf.SuslovGyrostat(2, 1, -0.5, -0.3, 0.1)):
        found = flow(QuadraticField.of(body), start, times)
        assert abs(found - flow(body, start, times)).max() < 1e-8


def test_components_reached_through_others():
    ramp = of(lambda x: [*x[1:], 1], 12)
    found = flow(ramp, np.zeros(12), 1.0)
    factorials = np.cumprod(np.arange(1.0, 13))[::-1]
    assert abs(found - 1 / factorials).max() < 1e-9
    lattice, kicked = ring(12), np.zeros(24)
    kicked[12] = 1.0
    assert abs(flow(lattice, kicked, 2.0) - by_scipy(lattice, kicked, 2.0)).max() < 1e-8

    def epidemic(x):
        """Susceptible, eight exposed stages, infected."""
        new, *rest = 2 * x[0] * x[9], *(4 * each for each in x[1:9])
        return [-new, *(a - b for a, b in zip([new, *rest], rest, strict=False)), rest[-1] - x[9]]

    field, start = of(epidemic, 10), [1.0, *[0] * 8, 1e-3]
    assert abs(flow(field, start, 10.0) - by_scipy(field, start, 10.0)).max() < 1e-8


@pytest.mark.parametrize("shift", [1.0, 0.1, 1e6])
def test_a_chain_displaced_uniformly_stays(shift):
    displaced = np.zeros(24)
    displaced[:12] = shift
    assert abs(flow(ring(12), displaced, 5.0) - displaced).max() < 1e-9 * shift


# ---------------------------------------------------------------------------------------- stiff
@pytest.mark.parametrize("rtol", [1e-4, 1e-9, 1e-12])
def test_populations_stay_positive(rtol):
    """They fall to 1e-27 and below 1e-200; one below 0 would end at -1e80."""
    field = of(lambda x: (x[0] * (1 - x[1] / 2), x[1] * (x[0] / 2 - 1)), 2)
    times = np.linspace(0, 300, 61)[1:]
    found = flow(field, [[100.0, 50.0], [2.0, 1e-250], [-100.0, 50.0]], times, rtol=rtol)
    assert (np.sign(found) == [[1, 1], [1, 1], [-1, 1]]).all()
    [exact] = np.exp(
        solve_ivp(
            lambda t, u: (1 - np.exp(u[1]) / 2, np.exp(u[0]) / 2 - 1),
            (0, 5), np.log([100.0, 50.0]), "DOP853", [5.0], rtol=1e-12, atol=1e-12,
        ).y.T
    )  # fmt: skip
    assert abs(found[0, 0] - exact).max() < 100 * rtol


@pytest.mark.parametrize("start", [1e-320, 1e-316, 1e-310, 1e-300])
def test_subnormal_states(start):
    """Relative digits are those that the start has; 5e-324 is no solution that ends."""
    times = np.array([1.0, 100.0, 700.0])
    found = flow(of(lambda x: (x[0],), 1), [[start], [-start]], times)[..., 0] / start
    error = max(1e-8, 20 * 2.0**-1074 / start)
    np.testing.assert_allclose(found, np.exp(times)[:, None] * [1, -1], rtol=error)
    turned = flow(of(lambda x: (x[1], -x[0]), 2), [5e-324, 0], [1.0, 100.0])
    assert abs(turned).max() < 1e-319


def test_hires():
    field = of(hires, 8)
    for rtol, bound in ((1e-4, 1e-3), (1e-6, 3e-6), (1e-8, 2e-8)):
        found = flow(field, HIRES, 321.8122, rtol=rtol)
        assert abs(found / HIRES_END - 1).max() < bound


def test_robertson():
    field = of(robertson, 3)
    found = flow(field, [1, 0, 0], [0.0, 40.0, 4e5], rtol=1e-6)
    wanted = [0.7158270687193941, 9.185534764557338e-06, 0.2841637457458131]
    assert abs(found[1] - wanted).max() < 1e-8
    assert abs(found[1] / wanted - 1).max() < 1e-4
    # By Radau at 1e-12.
    assert abs(found[2, [0, 2]] - [4.93829e-3, 0.9950617]).max() < 1e-5
    assert abs(found.sum(axis=1) - 1).max() < 1e-12


def test_oregonator():
    found = flow(of(oregonator, 3), [1, 2, 3], 360.0, rtol=1e-6)
    wanted = [0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3]
    assert abs(found / wanted - 1).max() < 4e-3


def test_batches_of_rates():
    """Each member takes its own steps; with the bits of a single field."""
    rates = np.geomspace(28, 2800, 19)
    family = of(hires, 8, k=rates)
    found = flow(family, HIRES, 321.8122, rtol=1e-6)
    assert abs(found[9] / HIRES_END - 1).max() < 3e-6
    for k in (0, 7, 18):
        assert (flow(family[k], HIRES, 321.8122, rtol=1e-6) == found[k]).all()


def test_fast_decay():
    found = flow(of(lambda x, a: (-a * x[0],), 1, a=np.logspace(-1, 9, 41)), [1.0], [0.1, 1.0])
    wanted = np.exp(-np.outer([0.1, 1.0], np.logspace(-1, 9, 41)))
    assert abs(found[..., 0] - wanted).max() < 2e-9


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7, 1e-9])
def test_fast_modes_that_begin_away_from_their_equilibrium(rtol):
    """Extrapolated steps multiply very fast modes by almost 1, so an estimate does not see them."""
    found = flow(of(lambda x: (1 - 1e9 * x[0],), 1), [0.0], [1e2, 1e4], rtol=rtol)
    assert abs(1e9 * found - 1).max() < rtol
    found = flow(of(lambda x: (-x[0], x[0] - 1e7 * x[1]), 2), [1.0, 0.0], 1.0, rtol=rtol)
    assert abs(found - np.exp(-1) * np.array([1.0, 1 / (1e7 - 1)])).max() < rtol * 1e-2
    follower = of(lambda x: (-x[1], x[0], -1e6 * (x[2] - x[0]) - x[1]), 3)
    start = np.ones((5, 3)) * [1.0, 0.0, 1.0]
    start[:, 2] += np.geomspace(1e-8, 1e-2, 5)
    found = flow(follower, start, 5.0, rtol=rtol)
    assert abs(found - [np.cos(5), np.sin(5), np.cos(5)]).max() < 20 * rtol


# ------------------------------------------------------------------------------------------ ends
@pytest.mark.parametrize(
    ("field", "start", "end"),
    [
        (SQUARE, [1.0], 1.0),
        (SQUARES, [1.0, 0.0], 1.0),
        (of(lambda x: (1 + x[0] ** 2,), 1), [0.0], np.pi / 2),
        (of(lambda x: (x[0] ** 2, x[1] ** 2), 2), [1.0, 1.0], 1.0),
        (of(lambda x: (-(x[0] ** 2),), 1), [4.0], -0.25),
    ],
)
def test_solutions_that_end(field, start, end):
    times = np.array([0.5, 0.99, 1.01, 2.0]) * end
    with pytest.warns(PoleWarning, match="1 of 1 solutions end") as record:
        found = flow(field, start, times)
    [told] = re.findall(r"near t = (\S+)$", str(record[0].message))
    assert abs(float(told) - end) < 1e-6
    assert np.isfinite(found[:2]).all()
    assert np.isnan(found[2:]).all()


def test_of_two_ends_the_one_after_the_start_is_told():
    with pytest.warns(PoleWarning, match=r"near t = 1\.5707"):
        found = flow(of(lambda x: (1 + x[0] ** 2,), 1), [0.0], [-2.0, -1.0, 1.0, 2.0])
    assert np.isnan(found[:, 0]).tolist() == [True, False, False, True]


def test_a_solution_that_passes_a_pole_by_does_not_end():
    z = 1 + 0.1j
    found = flow(SQUARES, [z.real, z.imag], [1.0, 2.0])
    exact = z / (1 - z * np.array([1.0, 2.0]))
    assert abs(found - np.stack([exact.real, exact.imag], axis=-1)).max() < 1e-7


def test_one_warning_names_the_first():
    start = np.array([[-1.0], [0.5], [1.0], [np.nan], [0.1]])
    with pytest.warns(PoleWarning, match=r"2 of 5 solutions end; first: 1 near t = 2$") as record:
        found = flow(SQUARE, start, [3.0, 0.0])
    assert len(record) == 1
    assert np.isnan(found[0, :, 0]).tolist() == [False, True, True, True, False]
    assert np.isnan(found[1, :, 0]).tolist() == [False, False, False, True, False]
    with pytest.warns(PoleWarning, match="1 of 1 solutions end"):
        assert np.isnan(flow(LORENZ, [1e200, 1e200, 1.0], 1.0)).all()  # f overflows at the start


# --------------------------------------------------------------------------------------- contract
def test_times(rng):
    x = rng.normal(size=(2, 3, 4)) / 8
    times = [3.0, -1.0, 0.0, 3.0, 0.5, -2.0, -1.0]
    found = flow(HENON_HEILES, x, times)
    assert found.shape == (7, 2, 3, 4)
    assert (found[0] == found[3]).all()
    assert (found[1] == found[6]).all()
    assert (found[2] == x).all()
    for time, states in zip(times, found, strict=True):
        alone = flow(HENON_HEILES, x, time)
        assert alone.shape == (2, 3, 4)
        assert abs(alone - states).max() < 1e-8
    assert flow(HENON_HEILES, x, []).shape == (0, 2, 3, 4)
    assert flow(HENON_HEILES, x[:0], [1.0]).shape == (1, 0, 3, 4)


def test_bits_do_not_depend_on_batch_and_threads(rng, monkeypatch):
    a = np.array([0.0, 1.0, 0.3, -0.2, 0.5] * 12)
    family = of(lambda x, a: (x[1] - a * x[0] * x[2], -x[0] + x[0] * x[1], a - x[2]), 3, a=a)
    cases = (
        (LORENZ, rng.normal(size=(60, 3)) * 8 + [0, 0, 25]),
        (family, rng.normal(size=(60, 3)) / 9),
    )
    for field, x in cases:
        whole = flow(field, x, [0.3, 1.0])
        for part in (slice(0, 1), slice(3, 5), slice(7, 12), slice(20, 60), slice(None, None, -1)):
            own = field[part] if field.shape else field
            assert (flow(own, x[part], [0.3, 1.0]) == whole[:, part]).all()
        assert (flow(LORENZ, 1e-6 * x[0], 0.3) == flow(LORENZ, 1e-6 * x, 0.3)[0]).all()
        with monkeypatch.context() as patch:
            patch.setattr(core_flow, "ACTIVE", 1)  # four lines at once, then the others
            assert (flow(field, x, [0.3, 1.0]) == whole).all()
            patch.setattr(threads, "CROSSOVER", 0)
            assert (flow(field, x, [0.3, 1.0], threads=TWO_THREADS) == whole).all()
            patch.setattr(core_flow, "BUDGET", 1)  # a pause after each step
            given, returned = core_flow.call, []

            def call(*arguments, given=given, returned=returned):
                returned.append(given(*arguments))
                return returned[-1]

            patch.setattr(core_flow, "call", call)
            assert (flow(field, x, [0.3, 1.0]) == whole).all()
            assert returned.count(0) > 10 or config.DISABLE_JIT


def test_lengths_follow_from_the_rounding_of_each_member():
    """Of a fast exchange, whose terms cancel: in several lines and columns of members."""
    a = 10.0 ** (np.arange(20) % 5)
    family = of(lambda x, a: (a * (x[1] - x[0]) - x[0] * x[1], a * (x[0] - x[1]) + x[0]), 2, a=a)
    x = np.linspace(1.0, 3.0, 20)[:, np.newaxis] * np.ones(2)
    whole = flow(family, x, [0.3, 1.0], rtol=1e-13)
    for k in range(20):
        assert (flow(family[k], x[k], [0.3, 1.0], rtol=1e-13) == whole[:, k]).all()


def test_rounding_of_terms_that_cancel_shortens_no_step():
    """Of a faster exchange, whose terms leave 1e-8: with s = x_0 = x_1, 2 s' = s - s**2."""
    fast = of(lambda x: (1e8 * (x[1] - x[0]) - x[0] * x[1], 1e8 * (x[0] - x[1]) + x[0]), 2)
    indices, values = fast.terms
    run = core_flow.Motion(
        tolerance.stage_of(indices, 2), np.atleast_2d(values), np.full((1, 2), 0.5), 1e-13, 1, 1.0
    )
    with np.errstate(all="ignore"):
        run._begin()
        for _ in range(40):
            run._step_to(1.0)
    assert run.rows[0, run.places.time, 0] == 1.0
    found = run.rows[0, run.places.base : run.places.base + 2, 0]
    np.testing.assert_allclose(found, 1 / (1 + np.exp(-0.5)), rtol=0, atol=5e-8)  # 1e8 * 2**-53


@pytest.mark.filterwarnings("ignore::suslov_fast.PoleWarning")
@pytest.mark.slow
def test_numpy_takes_the_same_steps(rng, monkeypatch):
    cases = (
        (LORENZ, rng.normal(size=(11, 3)) * 8 + [0, 0, 25], [0.1, 0.5, -0.1]),
        (SQUARE, [[1.0], [-1.0], [np.nan], [1e200]], [0.5, 2.0]),
        (of(robertson, 3), [1.0, 0, 0], [40.0]),
    )
    expected = [flow(*case) for case in cases]
    monkeypatch.setattr(core_flow, "code_of", lambda *arguments, **options: None)
    monkeypatch.setattr(single_motion, "_prepared", lambda *arguments: None)
    for case, wanted in zip(cases, expected, strict=True):
        np.testing.assert_array_equal(flow(*case), wanted)


@pytest.mark.slow_to_compile
def test_a_field_without_a_plan(rng, monkeypatch):
    """By elimination with pivoting, to rounding."""
    start = np.array([[1.0, 1, 20], [3, -2, 25]])
    wanted = flow(LORENZ, start, 0.5)
    monkeypatch.setattr("suslov_fast.core.operations.MOST", -1)
    tolerance._stage_of.cache_clear()
    try:
        found = flow(LORENZ, start, 0.5)
        with pytest.warns(PoleWarning):
            assert np.isnan(flow(SQUARE, [1.0], 2.0)).all()
    finally:
        tolerance._stage_of.cache_clear()
    assert abs(found - wanted).max() < 1e-7


@pytest.mark.compiled
@pytest.mark.slow
def test_one_state_of_many_variables_compiles_no_code_of_its_own(monkeypatch):
    monkeypatch.setattr("suslov_fast.core.operations.WHOLE", 10)
    monkeypatch.setattr("suslov_fast.core.operations.PIECE", 10)
    monkeypatch.setattr("suslov_fast.core.flow.MOST", 1)
    monkeypatch.setattr(
        "suslov_fast.core.single_motion.code_of", lambda *_: pytest.fail("compiled")
    )
    turn = QuadraticField.from_function(lambda x: (x[1], -x[0], -x[2]), 3)
    found = flow(turn, [1.0, 0.0, 1.0], 1.0)
    assert found == pytest.approx([np.cos(1.0), -np.sin(1.0), np.exp(-1.0)], abs=1e-8)


@pytest.mark.compiled
@pytest.mark.parametrize("has_plan", [True, False])
def test_many_variables(rng, monkeypatch, has_plan):
    """Loops in place of code: the same to rounding; bits over batches, fields and pieces."""
    family = QuadraticField.from_function(lambda x, a: (x[1], -a * x[0] - x[0] ** 2), 2, a=[1, 2])
    x, pair = rng.uniform(0, 0.3, (11, 4)), rng.uniform(0, 0.3, (9, 2, 2))
    times = [0.5, 0.0, -1.0, 2.0]
    wanted = flow(HENON_HEILES, x, times), flow(family, pair, times)
    stage_of = functools.cache(tolerance._stage_of.__wrapped__)
    monkeypatch.setattr(tolerance, "_stage_of", stage_of)
    monkeypatch.setattr("suslov_fast.core.flow.MOST", 1)
    monkeypatch.setattr("suslov_fast.core.flow.code_of", lambda *_: pytest.fail("compiled"))
    if not has_plan:
        monkeypatch.setattr("suslov_fast.core.operations.MOST", -1)
        monkeypatch.setattr("suslov_fast.core.operations.PART_OF_DENSE", 0)
    found = flow(HENON_HEILES, x, times), flow(family, pair, times)
    for one, other in zip(found, wanted, strict=True):
        assert abs(one - other).max() < 1e-10  # lengths of steps differ by rounding
    assert (flow(HENON_HEILES, x[3], times) == found[0][:, 3]).all()
    assert (flow(HENON_HEILES, x[:2], times) == found[0][:, :2]).all()
    assert (flow(family[1], pair[:, 1], times) == found[1][:, :, 1]).all()
    with pytest.warns(PoleWarning):
        assert np.isnan(flow(SQUARE, [[1.0], [0.1]], 2.0)).ravel().tolist() == [True, False]
    # Near rest the first step is long, and its stages pass the pole at t = 5.3.
    a = np.sqrt(0.9999)
    e = (1 - a) / (1 + a) * np.exp(8 * a)
    near_rest = flow(QuadraticField([[[1.0]]], None, [-0.9999]), [1.0], 4.0, rtol=1e-3)[0]
    assert near_rest == pytest.approx(a * (1 + e) / (1 - e), rel=1e-5)


def test_sums_of_terms(rng):
    """Of each component, in lanes with terms of their own or common ones; of the moduli, too."""
    D, W, T = 3, 4, 9
    indices = rng.integers(0, D + 1, (3, T)).astype(np.int64)
    indices[0] %= D
    for lanes in (1, W):
        values, x, sums = rng.normal(size=(T, lanes)), rng.normal(size=(D, W)), np.empty((D, W))
        one = np.append(x, np.ones((1, W)), axis=0)
        terms = values * one[indices[1]] * one[indices[2]]
        for of_moduli in (False, True):
            sums_of_terms.serial(indices, values, x, sums, of_moduli)
            for i in range(D):
                own = terms[indices[0] == i]
                expected = (abs(own) if of_moduli else own).sum(axis=0)
                np.testing.assert_allclose(sums[i], expected, rtol=1e-14, atol=1e-15)


def test_states_that_no_memory_holds_are_told_at_once():
    with pytest.raises(MemoryError, match="compute fewer states at a time"):
        flow(LORENZ, np.ones((10**6, 3)), np.arange(1e6))


def test_progress():
    seen = []

    def stop(done, total):
        seen.append((done, total))
        return done < 4

    times = [0.0, 1.0, 1.0, 2.0, 3.0, -1.0]
    found = flow(HENON_HEILES, [[0.1, 0, 0, 0.2], [0, 0.1, 0.1, 0]], times, progress=stop)
    assert seen == [(3, 6), (4, 6)]
    assert np.isnan(found).all(axis=(1, 2)).tolist() == [False, False, False, False, True, True]
    whole = flow(HENON_HEILES, [[0.1, 0, 0, 0.2], [0, 0.1, 0.1, 0]], times)
    assert (found[:4] == whole[:4]).all()


def test_bad_input():
    body = sf.Suslov3D(4, 1, -0.5, -0.3)
    for rtol in (0, 1e-14, 0.1, np.nan, [1e-6, 1e-7]):
        with pytest.raises(ValueError, match=r"^rtol must be"):
            flow(SQUARE, [1.0], 1.0, rtol=rtol)
    with pytest.raises(TypeError, match="rtol needs a field"):
        flow(body, [1, 0.5], 1.0, rtol=1e-9)
    with pytest.raises(TypeError, match="progress needs a field"):
        flow(body, [1, 0.5], 1.0, progress=True)
    for time in (np.inf, np.nan, [[1.0]]):
        with pytest.raises(ValueError, match=r"^time must"):
            flow(SQUARE, [1.0], time)
    with pytest.raises(ValueError, match=r"^x must"):
        flow(SQUARE, [1.0, 2.0], 1.0)
    for options in {}, {"rtol": 1e-6}:
        with pytest.raises(sf.NotIntegrableError, match=r"flow\(QuadraticField\.of\(body\)"):
            flow(sf.SuslovND([1.0, 2, 3], [0.1, 0.2, 0.3]), [1, 1, 1], 1.0, **options)


def test_no_warning_for_ordinary_motion():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flow(LORENZ, [1.0, 1, 20], [1.0, -0.1])
        flow(of(lambda x: (0 * x[0],), 1), [1.0], 3.0)


def test_first_lengths_follow_from_the_rates(rng):
    """Also of a component without terms, at rest, and where f has no value."""
    field = of(lambda x: (x[0] * x[1] - 2, 0 * x[0], x[2] - x[0] + 3 * x[1] ** 2), 3)
    (indices, values), rtol = field.terms, 1e-12
    stage, x = tolerance.stage_of(indices, 3), rng.normal(size=(4, 3))
    x[1:] = [2.0, 1.0, -1.0], [1e200, 1e200, 0.0], [1.0, np.nan, 0.0]
    a, b, c = x[0]
    rate, size = max(abs(a * b - 2), abs(c - a + 3 * b**2)), abs(x[0]).max()
    wanted = np.array([5 * rtol ** (1 / 8) * size / rate, 0.25, 0.0, 0.0])
    for states, last in ((x, 0.25), (x[:1], 0.001)):
        run = core_flow.Motion(stage, np.atleast_2d(values), states, rtol, 1, last)
        with np.errstate(all="ignore"):
            run._begin()
        found, first = run.rows[0, [run.places.wanted, run.places.first]]
        expected = np.minimum(wanted[: len(states)], last)
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        assert (first == found * 2.0**-60).all()
        base, largest = run.rows[0, run.places.base :][:3], run.rows[0, run.places.largest :][:3]
        assert (np.isnan(base) == (found == 0.0)).all()
        np.testing.assert_array_equal(largest, abs(states.T))
    tiny = tolerance.Beginning(None, 2, 2)  # of the state (1e-6, 2e-6), which moves slowly
    found = dict(enumerate(map(np.float64, (1e-6, 2e-6, 1e-7, -3e-7, 1e9, rtol))))
    operations.evaluate(tiny.operations, found)
    assert found[tiny.results[4]] == pytest.approx(5 * rtol ** (1 / 8) * 2 / 0.3)


def test_threads_take_no_step_after_one_has_failed():
    indices, values = LORENZ.terms
    run = core_flow.Motion(
        tolerance.stage_of(indices, 3), np.atleast_2d(values), np.ones((1, 3)), 1e-9, 1, 2.0
    )
    out = np.full((1, 1, 3), np.nan)
    core_flow._advance(run, np.array([2.0]), out, ["an error"])
    assert np.isnan(out).all()
    run._advance_in_numpy(np.array([2.0]), out, ["an error"])
    assert (out == 1.0).all()


def test_after_a_refused_step_the_next_is_not_longer():
    indices, values = LORENZ.terms
    run = core_flow.Motion(
        tolerance.stage_of(indices, 3), np.atleast_2d(values), np.ones((1, 3)), 1e-9, 1, 2.0
    )
    places = [run.places.time, run.places.wanted, run.places.taken]
    run._begin()
    time, was_refused, count = 0.0, False, 0
    while time < 2.0:
        before = time
        run._step_to(2.0)
        time, wanted, taken = run.rows[0, places, 0]
        if was_refused and before < time < 2.0:
            assert wanted <= taken
        was_refused = time == before
        count += was_refused
    assert count > 0


USUAL = {"t": 0.25, "wanted": 0.125, "longest": 3.0, "steps": 7.0, "taken": 0.125}
USUAL |= {"first": 0.125, "least": 0.5, "end": 1.0, "rtol": 1e-6}


def chosen(
    total,
    error=(0.0, 0.0),
    signs=(),
    largest=(0.0, 0.0),
    sums=(0.0, 0.0),
    difference=(0.0, 0.0),
    **options,
):
    """Return what `Choice` makes of a step from (1, 2), `all_chosen` without the steps."""
    return all_chosen(total, error, signs, largest, sums, difference, **options)[:-1]


def all_chosen(total, error, signs, largest, sums, difference, words=(), **numbers):
    """Return what `Choice` makes of a step: state, largest, time, length, longest, steps."""
    choice, total = tolerance.Choice(None, 2 + len(words), 2, signs), np.array(total)
    rows = total, total - error, difference, largest, sums
    given = [1.0, 2.0, *words, *np.ravel(rows), *(USUAL | numbers).values()]
    found = dict(enumerate(map(np.float64, given)))
    with np.errstate(all="ignore"):
        operations.evaluate(choice.operations, found)
    return [float(found[number]) for number in choice.results]


@pytest.mark.parametrize(
    ("step", "is_taken", "factor"),
    [
        (([0.5, 1.0], [0.5e-6, 0.0]), True, 0.8 * 3 ** (1 / 8)),
        (([0.5, 1.0], [0.0, 6e-6]), False, 0.8 * 2 ** (-1 / 8)),
        (([0.5, 1.0], [0.0, -5.99e-6], (), (0.0, 6.0)), True, 0.8),
        (([-1.0, 1.0], [2.99e-6 * 2.0**-20, 0.0]), True, 0.8),  # of the other component
        (([0.5, 1.0], [0.124 * 2.0**-16, 0.0], (), (0.0, 0.0), (2.0**30, 0.0)), True, 0.8),
        (([0.5, 1.0],), True, 3.0),
        (([0.5, 1.0], [1.0, 1.0]), False, 0.2),
        (([np.inf, 1.0],), False, 0.2),
        (([0.5, 1.0], [0.0, np.nan]), False, 0.2),
    ],
)
def test_the_next_length_follows_from_the_error(step, is_taken, factor):
    """It is 0.8 rho**(-1/8) times the length, but at least 0.2, and 3 at most."""
    *state, first, second, time, length, longest = chosen(*step)
    assert state == [1.0 + is_taken * step[0][0], 2.0 + is_taken * 1.0] if is_taken else [1.0, 2.0]
    largest = [*step[3]] if len(step) > 3 else [0.0, 0.0]
    if is_taken:
        largest = np.maximum(np.abs(state), largest)
    np.testing.assert_array_equal([first, second], largest)
    assert time == (0.375 if is_taken else 0.25)
    assert length == pytest.approx(0.125 * factor, rel=2e-3)
    assert longest == (3.0 if is_taken else 1.0)


def test_what_is_left_of_fast_modes():
    """It is subtracted where terms of 1024 times a component cancel; an eighth of it is error."""
    left = {"difference": (0.0, 4e-6)}
    for sums, is_fast in (((0.0, 8 * 3071.0), False), ((0.0, 8 * 3073.0), True)):
        *state, _, _, _, length, _ = chosen([0.5, 1.0], sums=sums, **left)
        assert state == [1.5, 3.0 - 4e-6 * is_fast]
        assert length == pytest.approx(0.125 * 0.8 * 6 ** (1 / 8), rel=2e-3)
    *state, _, _, _, _, _ = chosen([0.5, 1.0], sums=(8 * 1537.0, 0.0), **left)
    assert state == [1.5, 3.0 - 4e-6]  # one fast component is enough, so that sums are conserved
    assert chosen([0.5, 1.0], difference=(0.0, 25e-6))[:2] == [1.0, 2.0]
    left["difference"] = 0.0, 2e-6  # of lifted fields, all of it is error
    *state, _, _, _, length, _ = chosen([0.5, 1.0], sums=(0.0, 8 * 3073.0), words=(0.0,), **left)
    assert state == [1.5, 3.0]
    assert length == pytest.approx(0.125 * 0.8 * 1.5 ** (1 / 8), rel=2e-3)


def test_steps_are_counted_from_one_time_to_the_next():
    def steps_after(error=0.0, **numbers):
        nothing = 0.0, 0.0
        found = all_chosen([0.5, 1.0], [error, 0.0], (), *[nothing] * 3, **numbers)
        return found[-1], found[-3] == 0.0, np.isnan(found[0])

    most = tolerance.MOST_STEPS
    assert steps_after() == (8.0, False, False)
    assert steps_after(error=1.0) == (8.0, False, False)  # a refused step is one as well
    assert steps_after(end=0.375) == (0.0, False, False)
    assert steps_after(end=0.375, error=1.0) == (8.0, False, False)
    assert steps_after(taken=0.0) == (7.0, False, False)
    assert steps_after(steps=most - 2.0) == (most - 1, False, False)
    assert steps_after(steps=most - 1.0) == (most, True, True)
    assert steps_after(steps=most - 1.0, end=0.375) == (0.0, False, False)
    assert steps_after(steps=float(most), taken=0.0)[0] == most  # a trajectory that has ended


@pytest.mark.compiled
def test_solutions_that_need_ever_shorter_steps():
    """Backward in time Lorenz's y and z turn at the rate x, which grows like exp(-10 t)."""
    start, last = [[1.0, 1.0, 1.0], [0.0, 0.0, 1.0]], -50.0
    told = "1 of 2 solutions take more than 250,000 steps .*; first: 0 at t = (-1.3\\d*)"
    told += r".*np.linspace\(0, -50, 101\)"
    with pytest.warns(RuntimeWarning, match=told) as record:
        found = flow(LORENZ, start, [last, -1.0])
    time = float(re.search(told, str(record[0].message))[1])
    assert np.isnan(found[0, 0]).all()
    np.testing.assert_allclose(found[0, 1, 2], np.exp(8 / 3 * 50.0), rtol=1e-6)
    with pytest.warns(RuntimeWarning, match="1 of 1 solutions take"):
        alone = flow(LORENZ, start[0], [-1.0, 1.02 * time])  # steps count from the last time
    assert (alone[0] == found[1, 0]).all()
    assert np.isnan(alone[1]).all()
    assert np.isfinite(flow(LORENZ, start[0], [0.99 * time, 1.005 * time])).all()


def test_steps_that_a_test_refuses_are_halved():
    """A component changes a sign that it keeps along the motion, or a pivot is small."""
    turned = [-3.0, 1.0]
    for signs, numbers in (((0,), {}), ((), {"least": 2.0**-6}), ((1, 0), {"least": 0.1})):
        found = chosen(turned, signs=signs, **numbers)
        assert found == [1.0, 2.0, 0.0, 0.0, 0.25, 0.0625, 1.0]
    for signs in (), (1,):
        assert chosen(turned, signs=signs)[:2] == [-2.0, 3.0]
    assert chosen([-1.0, 1.0], signs=(0,))[:2] == [0.0, 3.0]  # 0 is no change
    # What rounding leaves gets its sign back: 2**-46 h times the sum of moduli of terms.
    left = chosen([-1.0 - 2.0**-44, 1.0], signs=(0,), sums=(2.0**5 + 1, 0.0))
    assert left[:2] == [2.0**-44, 3.0]
    left = chosen([-1.0 - 2.0**-44, 1.0], signs=(0,), sums=(2.0**5 - 1, 0.0))
    assert left[:2] == [1.0, 2.0]


def test_lengths_at_the_end_of_time_and_of_a_solution():
    # A step that was cut says nothing against the length wanted; it reaches the end exactly.
    cut = {"t": 0.1, "taken": 0.3 - 0.1, "end": 0.3, "wanted": 0.5}
    assert chosen([0.5, 1.0], **cut)[4:6] == [0.3, 0.5]
    assert chosen([0.5, 1.0], [0.0, 6e-6], **cut)[4:6] == [
        0.1,
        pytest.approx(0.2 * 0.8 * 2 ** (-1 / 8), rel=2e-3),
    ]
    # A step of length 0 changes nothing, even if f has no value.
    for total in ([0.0, 0.0], [np.nan, 0.0]):
        found = chosen(total, taken=0.0, longest=10.0)
        assert found[:2] == [1.0, 2.0]
        assert found[4:] == [0.25, 0.125, 10.0]
    # Lengths below 2**-42 of the time, or of the first length, end the solution.
    for t, first, size, ends in (
        (0.25, 0.125, 2.0**-42, True),
        (0.25, 0.125, 2.0**-40, False),
        (0.0, 0.25, 2.0**-42, True),
        (0.0, 0.25, 2.0**-40, False),
    ):
        found = chosen([np.inf, 0.0], t=t, first=first, taken=size, wanted=size)
        assert np.isnan(found[:2]).tolist() == [ends, ends]
        assert found[5] == (0.0 if ends else pytest.approx(0.2 * size))
