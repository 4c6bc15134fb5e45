"""Derivatives of maps, and Lyapunov exponents: against naive ones, and against each other."""

import warnings
from itertools import pairwise

import children
import naive
import numpy as np
import pytest
from scipy.linalg import expm
from systems import LORENZ, exponents_by_qr, lorenz, lorenz_96, rubbing

import suslov_fast as sf
from suslov_fast.maps import derivatives
from suslov_fast.maps.ordered_algebra import dual_product, orthonormal

# Long steps on purpose, from states with det A < 0.
pytestmark = pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")

THREE = sf.Suslov3D(4, 1, -0.5, -0.3)
GYROSTAT = sf.Suslov3D(2.3, 1.4, 0.5, -0.7, 0.9)
# Orbits with t > 1 jump through infinity.
BEYOND = sf.Suslov3D(3, 3, -0.2, -0.2)


def linear(rates):
    return sf.Field.from_terms(np.zeros((4, 4, 4)), rates * np.eye(4))


@pytest.mark.sampled(8)
@pytest.mark.parametrize(
    ("body", "omega", "eps", "steps", "tolerance"),
    [(THREE, [1.0, 0.5], eps, steps, 1e-13) for eps in (0.2, -0.2) for steps in (1, 2, 40)]
    + [(GYROSTAT, [1.0, 0.5], 0.4, 40, 1e-13)]
    + [(BEYOND, omega, 1.0, 12, 1e-11) for omega in ((-40, -250), (35, -20), (-300, 500))]
    + [(m, None, eps, 25, 1e-12) for m in (1, 2, 3, 4, 7) for eps in (0.3, -0.3)]
    + [(LORENZ, [1.0, 2.0, 20.0], eps, 100, 1e-12) for eps in (1 / 64, 0.5)]
    + [(m, None, 1.6, 8, 1e-11) for m in (10, 12)]  # negative pivots, and rows exchanged
    # A factor of 2.5e-10 at each step; columns that leave the range of numbers.
    + [
        (linear(np.negative(a)), np.zeros(4), 1.0, 40, 1e-13)
        for a in ([1, 1, 1, 2 - 1e-9], 1.9999999)
    ],
)
def test_against_derivatives_one_by_one(rng, body, omega, eps, steps, tolerance):
    if isinstance(body, int):
        J, I, omega = rng.uniform(1, 3, body), *rng.normal(size=(2, body))
        body = sf.SuslovND(J=J, I=I)
    assert body is not BEYOND or body.criticality(omega, eps) > 1
    exponents = sf.lyapunov_exponents(body, omega, eps, steps)
    expected, tolerance = exponents_by_qr(body, omega, eps, steps=steps), tolerance / abs(eps)
    np.testing.assert_allclose(exponents, expected, atol=tolerance)
    np.testing.assert_allclose(exponents.sum(), expected.sum(), atol=tolerance)


@pytest.mark.compiled  # interpreted, a million steps take more than half an hour
def test_tangent_vectors_go_through_the_transient(rng):
    """From vectors that start with the mean the exponent that is 0 has the bias -1.1 / T."""
    x0 = sf.iterate(LORENZ, rng.normal((1, 1, 20), size=(400, 3)), 1 / 128, 3840, save_every=None)
    found = sf.lyapunov_exponents(LORENZ, x0.final, 1 / 128, 1280, transient=1280).mean(axis=0)
    assert abs(found[1]) < 0.02


def test_batches_and_a_transient():
    starts, run = np.random.default_rng(0).uniform(-5, 5, (3, 3)), (1 / 64, 40)
    starts[2] = np.nan
    expected = sf.lyapunov_exponents(LORENZ, starts, *run, 30)
    assert np.isnan(expected[2]).all()
    # Their sums are those of all steps, less those of the transient.
    whole, first = (sf.lyapunov_exponents(LORENZ, starts, 1 / 64, n).sum(1) for n in (70, 30))
    np.testing.assert_allclose(40 * expected.sum(1), 70 * whole - 30 * first, rtol=1e-12)
    for arguments in ({"eps": 1 / 64, "steps": 9}, {"time": 1.0}):
        assert sf.lyapunov_exponents(LORENZ, np.empty((0, 3)), **arguments).shape == (0, 3)
    still = sf.lyapunov_exponents(sf.Suslov3D(4, 1, 0, [0, 0]), [1.0, 0.5], 0.2, 5)
    assert abs(still).max() <= 1e-15  # of the identity map
    square = sf.Field.from_terms([[[1]]])
    with pytest.warns(sf.IntegrationWarning, match="1 of 1"):  # a pole in the transient
        sf.lyapunov_exponents(square, [1.0], 1.0, 5, 3)
    with pytest.warns(sf.IntegrationWarning, match="1 of 2"):  # and later
        found = sf.lyapunov_exponents(square, [[2.0], [-1.0]], 0.5, 5)
    assert np.isnan(found).ravel().tolist() == [True, False]


def test_steps_that_are_not_invertible(unit):
    """The map takes the line y = -2a / eps to a point."""
    exponents = sf.lyapunov_exponents(unit, [0.5, 2.0], 1.0, 3)
    assert exponents[1] == -np.inf
    assert np.isfinite(exponents[0])
    field = sf.Field.from_terms(np.zeros((2, 2, 2)), [[-2, 0], [0, 1]])
    exponents = sf.lyapunov_exponents(field, [[1.0, 2.0]], 1.0, 3)
    np.testing.assert_allclose(exponents, [[np.log(3), -np.inf]], atol=1e-15)


def log_of_step(f, eps, x, following):
    """log |det DPhi| from 1 - (eps/2) f'(x) and 1 + (eps/2) f'(x_next), in 60 digits."""
    dets = []
    for state, half in ((x, -eps / 2), (following, eps / 2)):
        slope = naive.mpmath.matrix(naive.derivative(f, state))
        dets.append(naive.mpmath.det(naive.mpmath.eye(len(x)) + half * slope))
    return naive.mpmath.log(abs(dets[1] / dets[0]))


@pytest.mark.parametrize(
    ("start", "eps", "steps"),
    [
        ((1.0, 2.0, 20.0), 1 / 64, 40),
        ((1.0, 2.0, 20.0), 0.5, 12),  # with pivots
        ((1.0, 2.0, 20.0), -4.0, 12),
    ],
)
def test_the_sum_is_that_of_determinants(start, eps, steps):
    """To rounding of the mean modulus of their logarithms, or of columns."""
    states = naive.iterated(lambda x: naive.kahan_step(lorenz, eps, x), start, steps)
    logs = [log_of_step(lorenz, naive.mpf(eps), *each) for each in pairwise(states)]
    modulus = float(sum(map(abs, logs)))
    total = sf.lyapunov_exponents(LORENZ, start, eps, steps).sum()
    assert abs(total * abs(eps) * steps - float(sum(logs))) < max(3e-11 * modulus, 1e-15 * steps)


def everything(D):
    """All products in most equations, as of a Galerkin system: more than a list is made for."""
    products = np.random.default_rng(8).normal(size=(D, D, D)) / D
    products[::5] = 0.0
    return sf.Field.from_terms(products, -np.eye(D))


@pytest.mark.compiled
@pytest.mark.parametrize(
    "field",
    [sf.Field(lorenz_96, 17), pytest.param(everything(44), marks=pytest.mark.slow)],
    ids=["ring", "everything"],
)
def test_many_variables(rng, monkeypatch, field):
    """By NumPy: as its QR of each derivative, and a call for each step has the same bits."""
    x, run = 1.0 + 0.1 * rng.normal(size=(2, field.dimension)), (1 / 64, 40)
    seen, found = [], sf.lyapunov_exponents(field, x, *run)
    np.testing.assert_allclose(
        found[0], exponents_by_qr(field, x[0], run[0], steps=run[1]), atol=1e-10
    )
    np.testing.assert_array_equal(sf.lyapunov_exponents(field, x[1], *run), found[1])
    monkeypatch.setattr(derivatives, "WORK_OF_CALL", 1)
    again = sf.lyapunov_exponents(field, x, *run, progress=lambda *done: seen.append(done))
    np.testing.assert_array_equal(again, found)
    assert seen == [(n, 40) for n in range(1, 41)]
    until_9 = sf.lyapunov_exponents(field, x, *run, progress=lambda done, _: done < 9)
    np.testing.assert_array_equal(until_9, sf.lyapunov_exponents(field, x, 1 / 64, 9))


# -------------------------------------------------------------------------------- along the motion
@pytest.mark.compiled  # interpreted, more than 20 seconds
def test_motion_of_lorenz(rng):
    x = rng.normal(size=(64, 3)) * 5 + [0, 0, 20]
    found = sf.lyapunov_exponents(LORENZ, x, time=50.0, transient=10.0, rtol=1e-6)
    assert abs(found.sum(axis=1) + 41 / 3).max() < 1e-6  # the trace of f'
    assert abs(found.mean(axis=0) - [0.9056, 0.0, -14.5723]).max() < 0.02
    for k in (0, 63):
        alone = sf.lyapunov_exponents(LORENZ, x[k], time=50.0, transient=10.0, rtol=1e-6)
        assert (alone == found[k]).all()


@pytest.mark.parametrize(
    ("f", "exact"),
    [
        (lambda x, a: (-2 * x[0], 1 + 0 * a), [[-2], [-2]]),  # nothing depends on it
        (lambda x, a: (-2 * x[0], 1 - a * x[1]), [[0, -2], [-2, -3]]),  # one member has no clock
        (lambda x, a: (1.0, 2.0), [[], []]),
    ],
)
def test_motion_leaves_out_variables_that_drift_in_all_members(f, exact):
    family = sf.Field(f, 2, a=[0.0, 3.0])
    found = sf.lyapunov_exponents(family, [1.0, 1.0], time=40.0, transient=20.0)
    np.testing.assert_allclose(found, exact, atol=1e-12)


def test_motion_of_families_that_end():
    family = sf.Field(lambda x, a: (a * x[0] ** 2 - x[0],), 1, a=[0, 2])
    with pytest.warns(sf.IntegrationWarning, match=r"1 of 2 .* at t = 0\.693"):
        found = sf.lyapunov_exponents(family, [1.0], time=3.0)
    assert found[0] == pytest.approx(-1.0)
    assert np.isnan(found[1])


def test_motion_that_slides():
    block = sf.Field(rubbing, "x v", k=0.4)
    with pytest.warns(sf.IntegrationWarning, match="slide.* exponents"):
        found = sf.lyapunov_exponents(block, [0.0, 0.3], time=5.0)
    assert np.isnan(found).all()


def test_motion_of_families_that_progress_stops():
    linear = np.array([[[-1.0, 0.0], [1.0, -2.0]], [[-1.0, 0.5], [1.0, -2.0]]])
    family = sf.Field.from_terms(np.zeros((2, 2, 2, 2)), linear=linear)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = sf.lyapunov_exponents(family, [1.0, 0.5], time=200.0, progress=lambda *of: False)
    assert np.isnan(found).all(axis=1).tolist() == [False, True]


TURN = np.linalg.qr(np.cos(np.arange(64.0) ** 2).reshape(8, 8))[0]
APART = [-1.0, -3.0, -30.0, -100.0, -300.0, -1e3, -1e4, -3e4]


@pytest.mark.parametrize(
    ("f", "exact"),
    [
        (lambda x: (-1e4 * x[0], -x[1]), [-1.0, -1e4]),
        (lambda x: (-x[0], -1e4 * x[1] + 1e4 * x[0]), [-1.0, -1e4]),
        (lambda x: (-1e5 * (x[0] - x[1] * x[2]), -0.5 * x[1] + x[2], -x[1] - 0.5 * x[2]),
         [-0.5, -0.5, -1e5]),
        (lambda x: (-1e4 * x[0], -2e4 * x[1], -x[2]), [-1.0, -1e4, -2e4]),
        pytest.param(lambda x: (TURN * APART) @ (TURN.T @ x), APART, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_motion_with_directions_that_decay_fast(f, exact):
    """They need no more segments than the slow ones, and frames where there are several."""
    field = sf.Field(f, len(f(np.ones(8))))
    starts = np.array([[1.0, 1.0, 0.5, 0.2] * 2, [0.3, -1.0, 2.0, 0.0] * 2])[:, : field.dimension]
    calls, times = [], {"time": 100.0, "transient": 20.0}
    found = sf.lyapunov_exponents(
        field, starts, progress=lambda done, _: calls.append(done), **times
    )
    np.testing.assert_allclose(found, [exact] * 2, rtol=1e-7)
    assert len(calls) < 1000
    alone = sf.lyapunov_exponents(field, starts[1], **times)
    np.testing.assert_array_equal(alone, found[1])


# ---------------------------------------------------------------------- with changes of the state
A = np.array([[-0.3, 1.0], [-1.0, -0.1]])
KICK = np.array([[1.5, 0.2], [0.7, -0.4]])
KICKS = {"times": np.arange(0.0, 81.0)}
OF_KICKS = np.sort(np.log(abs(np.linalg.eigvals(KICK @ expm(A)))))[::-1]
E = np.array([0.5, 0.9, 1.0])  # the part of its speed that an oscillator keeps at a wall
# f, starts, an event, a time and a transient, exponents and the digits of their error.
KNOWN = {
    # No other direction reaches it, so it would keep a column of its own for a long time.
    "a direction that is the slowest at the start alone": (
        lambda s: (-0.5 * s[0], 1.0, -(1 + 2 * np.cos(s[1])) * s[2]), [1.0, 3.0, 1.0], (),
        32 * np.pi, 8 * np.pi, [-0.5, -1.0], 5,
    ),
    # Tangent vectors become shorter than the tolerance, and states than the least number.
    **{
        f"to an equilibrium at the rate {r}": (
            lambda x, r=r: (-x[0], np.sin(x[0]) - r * x[1]), [1.0, 0.5], (), T, 10.0, [-1, -r], 5,
        )
        for r, T in ((2.0, 2000.0), (1000.0, 100.0))
    },
    "kicks at times": (
        lambda x: A @ x, [[1.0, 0.5], [0.2, -1.0]], sf.Event(**KICKS, to=lambda x: KICK @ x),
        50.0, 30.0, [OF_KICKS] * 2, 7,
    ),
    "a direction that is taken away": (
        lambda x: A @ x, [1.0, 0.5], sf.Event(**KICKS, to=("x1/2", "0")), 40.0, 5.0,
        [np.log(expm(A)[0, 0] / 2), -np.inf], 6,
    ),
    "both directions": (
        lambda x: A @ x, [1.0, 0.5], sf.Event(**KICKS, to=("0", "0")), 40.0, 5.0, [-np.inf] * 2, 6,
    ),
    "a wall that takes all speed": (
        lambda x: (x[1], -0.1 * x[1]), [-1.0, 1.0], sf.Event("x1", to=("x1", 0)), 10.0, 0,
        [-np.inf] * 2, 6,
    ),
    # It meets the wall at multiples of half the time of a turn.
    **{
        f"an impact oscillator, {way}": (
            lambda x, e: (x[1], -x[0]), [1.0, 0.0],
            sf.Event("x1", direction=way, to=lambda x, e: (x[0], -e * x[1])),
            16 * np.pi, 2 * np.pi, np.outer(np.log(E) / np.pi, [1, 1]), 8,
        )
        for way in ("both", "down")
    },
    "a logistic map": (
        lambda x: (0.0 * x[0],), [[0.3], [0.4]],
        sf.Event(times=np.arange(1.0, 3001.0), to=lambda x: (4 * x[0] * (1 - x[0]),)), 3000.5, 0,
        np.log(2.0), 2.7,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KNOWN)
def test_known_exponents_of_motions(name):
    f, x0, event, time, transient, exact, digits = KNOWN[name]
    given = {"e": E} if "impact" in name else {}
    field = sf.Field(f, np.shape(x0)[-1], **given)
    found = sf.lyapunov_exponents(field, x0, time=time, transient=transient, events=event)
    np.testing.assert_allclose(found, np.broadcast_to(exact, found.shape), rtol=0, atol=10**-digits)


ROESSLER = sf.Field(lambda x: (-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7)), 3)


@pytest.mark.parametrize("n", [1, 2, 3, 12])
def test_orthonormal_columns(n, rng):
    """They are those of LAPACK up to signs; zero and equal columns, and any scale, have some."""
    V = rng.normal(size=(6, n, n))
    V[1] *= 2.0**900
    V[2] *= 2.0**-900
    V[3, :, -1], V[4, :, 0], V[5] = 0.0, V[4, :, -1], 0.0
    Q, diagonal = orthonormal(V)
    assert abs(dual_product(Q, Q) - np.eye(n)).max() < 2e-15
    R = dual_product(Q, V) / np.maximum(abs(V).max(axis=(1, 2), keepdims=True), 1e-300)
    assert abs(np.tril(R, -1)).max() < 2e-15
    expected, upper = np.linalg.qr(V[:3])
    signs = np.sign((Q[:3] * expected).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(Q[:3] * signs, expected, atol=1e-13)
    of_lapack = abs(np.diagonal(upper, axis1=1, axis2=2))
    np.testing.assert_allclose(diagonal[:3], of_lapack, rtol=1e-12)
    for k in range(6):
        np.testing.assert_array_equal(orthonormal(V[k : k + 1])[0][0], Q[k])


@pytest.mark.parametrize("x0", [[1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
def test_last_digits_of_lapack_do_not_choose_the_orbit(x0, monkeypatch):
    """Processors differ in them, and a chaotic orbit would go elsewhere."""
    expected = sf.lyapunov_exponents(ROESSLER, x0, time=200)
    for name in ("eig", "eigvals", "qr", "svd", "pinv", "solve"):
        monkeypatch.setattr(np.linalg, name, with_other_digits(getattr(np.linalg, name)))
    np.testing.assert_array_equal(sf.lyapunov_exponents(ROESSLER, x0, time=200), expected)


def with_other_digits(function):
    def changed(*arguments, **keywords):
        found = function(*arguments, **keywords)
        results = found if isinstance(found, tuple) else (found,)
        others = [
            each * (1 + 3e-16 * np.cos(np.arange(each.size)).reshape(each.shape))
            for each in results
        ]
        return tuple(others) if isinstance(found, tuple) else others[0]

    return changed


@pytest.mark.slow
@pytest.mark.parametrize("core", ["Nehalem", "Haswell", "Katmai", "SkylakeX"])
def test_exponents_have_the_same_bits_on_other_processors(core):
    code = "import numpy as np, suslov_fast as sf"
    code += "; f = lambda x: (-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7))"
    code += "; print(sf.lyapunov_exponents(sf.Field(f, 3), [1, 1, 0], time=1000).tolist())"
    assert children.run(code, OPENBLAS_CORETYPE=core) == children.run(code)
