"""The map against its implicit equations in 60 digits and in fractions."""

from fractions import Fraction
from itertools import product

import mpmath
import naive
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._bodies.paper import PICTURES
from suslov_fast._kernels.blocks import LANES
from suslov_fast._maps import map_of

METHODS = ("auto", "canonical", "ds2")
every_method = pytest.mark.parametrize("method", METHODS)
# Momenta of a rotor, 0 for the body without one.
each_rotor = pytest.mark.parametrize("k", [0.0, 1e-9, -0.05, 0.4, -3.0])


def random_problem(rng, k=0.0):
    """A body, a step size of either sign and a state; |t| may be below or above 1."""
    I1, I2 = 10 ** rng.uniform(-1, 1, 2)
    I13, I23 = rng.uniform(-0.5, 0.5, 2) * min(I1, I2)
    eps = 10 ** rng.uniform(-2, 0) * rng.choice([-1, 1])
    return (I1, I2, I13, I23, k), eps, rng.normal(size=2) * 10 ** rng.uniform(-1, 1)


def body_of(I1, I2, I13, I23, k=0.0):
    return sf.SuslovGyrostat(I1, I2, I13, I23, k) if k else sf.Suslov3D(I1, I2, I13, I23)


def exact_orbit(parameters, eps, omega, steps):
    return naive.orbit(*parameters[:4], eps, omega, steps, *parameters[4:])


def assert_follows(parameters, omega, eps, steps, bound, methods=METHODS):
    """Compare all states of methods and of `exact`, and the last state of `auto`."""
    body, exact = body_of(*parameters), exact_orbit(parameters, eps, omega, steps)
    methods = [each for each in methods if each in map_of(body).methods]
    runs = [sf.iterate(body, omega, eps, steps, method=method).omega for method in methods]
    for states in (*runs, sf.exact(body, omega, eps, np.arange(steps + 1))):
        assert naive.worst_error(states, exact) < bound
    final = sf.iterate(body, omega, eps, steps, save_every=None).final
    assert naive.relative_error(final, exact[-1]) < bound


@each_rotor
def test_subcritical_orbits(rng, k):
    for n in range(12):
        parameters, eps, omega = random_problem(rng, k)
        if n % 2:  # next to the steady states
            products = np.array(parameters[2:4])
            omega = products[::-1] * rng.choice([[1, -1], [-1, 1]])
            omega -= k * products / (products @ products)
            omega += 10.0 ** rng.uniform(-12, -3) * rng.uniform(-1, 1, 2)
        while abs(sf.criticality(body_of(*parameters), omega, eps)) > 0.95:
            eps /= 2
        assert_follows(parameters, omega, eps, 45, 5e-14)


@pytest.mark.parametrize("picture", PICTURES.values())
def test_the_bodies_of_the_pictures(picture):
    assert_follows(picture.body.parameters, [1.5, 0.25], picture.eps, 60, 8e-15)


@pytest.mark.parametrize("gap", [0.5, 1e-2, 1e-4, 1e-8, 1e-13])
def test_orbits_up_to_the_critical_line(rng, gap):
    """1 - Y is small, and later states are proportional to it; x is a tiny difference at first."""
    for _ in range(3):
        I1, I2, I13, I23 = parameters = (*rng.uniform(0.5, 4, 2), *rng.uniform(-0.5, 0.5, 2))
        y, eps = 2 * I1 * I2 * (1 - gap), rng.uniform(0.1, 1)
        omega = y / eps / (I13**2 * I2 + I23**2 * I1) * np.array([I23, -I13])
        omega *= 1 + rng.normal(size=2) * 10 ** rng.uniform(-14, -4) * gap
        assert sf.criticality(sf.Suslov3D(*parameters), omega, eps) < 1
        assert_follows(parameters, omega, eps, 60, 2e-14, ("auto",))


def test_moments_far_apart():
    """eps I13 / I1 is 1e-3, and Omega2 is constant to rounding."""
    with mpmath.workdps(900):
        exact = naive.orbit(1e-50, 1e50, 1, 1, 1e-53, [1.0, 1.0], 5)
        run = sf.iterate(sf.Suslov3D(1e-50, 1e50, 1, 1), [1.0, 1.0], 1e-53, 5)
        assert naive.worst_error(run.omega, exact) < 1e-14
        assert naive.worst_error(sf.exact(run.body, [1.0, 1.0], 1e-53, run.n), exact) < 1e-14


@each_rotor
def test_supercritical_orbits(rng, k):
    """Near a pole both the state and its error are large: the bound follows the largest state."""
    for _ in range(12):
        parameters, eps, omega = random_problem(rng, k)
        body = body_of(*parameters)
        while abs(sf.criticality(body, omega, eps)) < 1.05:
            omega = 2 * np.hypot(*omega) * rng.normal(size=2)
        exact = exact_orbit(parameters, eps, omega, 12)
        sizes = np.linalg.norm(np.array(exact, float), axis=1)
        bound = 1e-14 * max(sizes) / min(sizes)
        assert naive.worst_error(sf.exact(body, omega, eps, np.arange(13)), exact) < bound
        for method, save_every in (("auto", 1), ("auto", None), ("canonical", 1), ("ds2", 1)):
            if method in map_of(body).methods:
                orbit = sf.iterate(body, omega, eps, 12, save_every=save_every, method=method)
                assert orbit.status == sf.Status.SUPERCRITICAL
                assert naive.relative_error(orbit.final, exact[-1]) < bound


@each_rotor
def test_one_step_equals_the_paper(rng, k):
    problems = [random_problem(rng, k) for _ in range(30)]
    # Next to a pole, a relative error of 1e-16 in the data grows with the state.
    problems += [((1, 1, 1, 0, 0), 1.0, np.array([1, gap - 3])) for gap in (1e-3, 1e-6, 1e-9)]
    for parameters, eps, omega in problems:
        exact = exact_orbit(parameters, eps, omega, 1)[1]
        computed = sf.step(body_of(*parameters), omega, eps)
        growth = float(mpmath.norm(exact)) / np.hypot(*omega)
        assert naive.relative_error(computed, exact) < 1e-14 * max(1, growth)


def test_any_step_below_t_1(rng):
    """Numbers of all sizes, and zeros."""
    inertia, sizes = 20 ** rng.uniform(-1, 1, (2, 200)), [0.0, 1e-80, 1e-9, 1.0, 1.0, 1.0]
    more = rng.uniform(-1, 1, (5, 200)) * [[2], [2], [1], [5], [5]] * rng.choice(sizes, (5, 200))
    body, eps, omega = sf.Suslov3D(*inertia, *more[:2]), more[2], more[3:].T
    states, subcritical = sf.step(body, omega, eps), sf.criticality(body, omega, eps) <= 0.9
    assert subcritical.sum() > 100
    for k in np.flatnonzero(subcritical):
        exact = naive.step(*inertia[:, k], *more[:3, k], omega[k])
        assert naive.relative_error(states[k], exact) < 1e-13


def test_one_step_of_larger_states_in_fractions(rng):
    """For 2 < |X| < 40 and Y of that size, Y - X X' would lose the digits of Y'."""
    omega = rng.uniform(2, 40, (150, 2)) * rng.choice([-1, 1], (150, 2)) * [2, 4]
    X, Y = omega[:, 0] / 2, -omega[:, 1] / 4  # without rounding
    omega = omega[abs(1 - Y + X * X) > X * X / 2]  # not next to a pole
    assert len(omega) > 75
    states = sf.iterate(sf.Suslov3D(2, 1, 1, 0), omega, 1, 1, method="canonical").omega[1]
    for start, state in zip(omega, states, strict=True):
        exact = naive.rational_step(2, 1, 1, 0, 1, start)
        error = sum((Fraction(c) - e) ** 2 for c, e in zip(state, exact, strict=True))
        assert error <= Fraction(4, 2**52) ** 2 * sum(e * e for e in exact)


def test_orbits_tend_to_the_line(body):
    """Proposition 2, from both sides of the line."""
    final = sf.iterate(body, [[1, 0.5], [-1, -0.5]], 0.2, 3000, save_every=None).final
    x, y = sf.to_xy(body, final).T
    assert ((abs(x) < 1e-15) & (y < 0)).all()


@pytest.mark.compiled
@pytest.mark.parametrize("method", ["canonical", "ds2"])
def test_F_over_a_long_run(body, rng, method):
    omega = rng.uniform(-2, 2, (100, 2))
    states = sf.iterate(body, omega, 0.2, 100_000, save_every=5000, method=method).omega
    F = sf.first_integral(body, states, 0.2)
    assert abs(F / F[0] - 1).max() < 2e-13


SHRINKING = sf.Suslov3D(1, 1, 0, 1)


def shrinking_start(decay, size):
    """State of this body of which each step divides Omega2 by 2**decay; X = Omega2 / 2."""
    r = 2.0**-decay
    return [-2 * (1 - r) / (1 + r), size]


def test_no_subnormal_numbers_along_an_orbit():
    """Subnormal numbers are slow: x is flushed to 0 before it becomes subnormal."""
    omega = [shrinking_start(decay, 1e-3) for decay in (0.13, 0.15, 0.17)]
    run = sf.iterate(SHRINKING, omega, 1.0, 256, method="canonical", save_every=None)
    zeros = []
    for _ in range(39):
        run = run.extend(256)
        X = run._resume["state"][:, 0]
        assert not ((X != 0) & (abs(X) < 2.0**-1022)).any()
        zeros.append((X == 0).all())
    assert not zeros[10]
    assert zeros[-1]


@pytest.mark.parametrize("method", ["auto", "canonical"])
@pytest.mark.parametrize("k", [-900, -530, -515, -512, -510, -509, -400])
def test_steps_without_subnormal_squares(k, method):
    """Steps leave out a subnormal X**2, which changes no digit of the next state."""
    for omega in product((-1.0, 0.5, 2.0**-400), (1.25 * 2.0**k, -1.25 * 2.0**k)):
        exact = naive.step(1, 1, 0, 1, 1.0, omega)
        final = sf.iterate(SHRINKING, omega, 1.0, 1, method=method).final
        assert all(abs(c / e - 1) < 5e-16 for c, e in zip(final, exact, strict=True))


@pytest.mark.parametrize("batch", [1, LANES + 1])
def test_states_are_saved_before_they_are_flushed(batch):
    """X is flushed to 0 only after its state is saved, in any batch and division of the run."""
    body = sf.Suslov3D(2.351018099947861, 3.388972810861883, 0.0, -0.5920589833785945)
    omega, eps = np.tile([-0.43643524714322124, -1.169801907772864], (batch, 1)), 0.869683938565067
    states = sf.iterate(body, omega, eps, 3073, method="canonical").omega
    assert (states[3072, :, 1] != 0.0).all()
    assert (states[3073:, :, 1] == 0.0).all()
    for cut in (3072, 3000):
        first = sf.iterate(body, omega, eps, cut, method="canonical")
        assert (first.extend(3073 - cut).omega == states).all()


@pytest.mark.parametrize(("decay", "zero"), [(3.0, False), (3.6, False), (3.7, True)])
def test_only_negligible_numbers_are_flushed(decay, zero):
    """X is flushed to 0 below 2**-960."""
    omega, steps = shrinking_start(decay, 2.0**-20), 257
    final = sf.iterate(SHRINKING, omega, 1.0, steps, method="canonical", save_every=None).final
    exact = naive.far_state(1, 1, 0, 1, 1.0, omega, steps)
    assert (final[1] == 0) == zero
    assert zero or abs(final[1] / float(exact[1]) - 1) < 1e-12
    assert abs(final[0] / float(exact[0]) - 1) < 1e-14


def test_growth_from_tiny_distances_to_the_repelling_line():
    """A growing X is not flushed to 0, however small."""
    body, omega = sf.Suslov3D(2, 1, 0, 0.5), [1.5, 1e-300]
    orbit = sf.iterate(body, omega, 1.0, 1200, save_every=10, method="canonical")
    assert abs(orbit.omega[:, 1]).max() > 0.1
    np.testing.assert_allclose(orbit.omega, sf.exact(body, omega, 1.0, orbit.n), atol=1e-10)


@pytest.mark.parametrize("method", ["auto", "canonical"])
@pytest.mark.parametrize("size", [5e-324, 1e-310, 1e-290, 1e-150, 1e-14])
def test_slow_states(unit, method, size):
    """Steps so small that X and Y underflow, or nearly so."""
    omega = np.array([0.7, -0.4])
    final = sf.iterate(unit, omega, size, 3, method=method, save_every=None).final
    exact = naive.orbit(1, 1, 1, 0, size, omega, 3)[-1]
    assert naive.relative_error(final, exact) < 5e-16
    assert (final != omega).all() == (size > 1e-16)
    final = sf.iterate(unit, omega, size, 1000, method=method, save_every=None).final
    np.testing.assert_allclose(final, sf.flow(unit, omega, size * 1000), rtol=5e-12)


@pytest.mark.parametrize("method", ["canonical", "ds2"])
@pytest.mark.parametrize("size", [10.0, 1e3, 1e5, 1e12])
def test_large_states(unit, rng, size, method):
    """One step takes most large states to the order of 1; Y - X X' would cancel."""
    for omega in size * rng.uniform(-1, 1, (6, 2)):
        exact = np.array(naive.orbit(1, 1, 1, 0, 1, omega, 8), float)
        final = sf.iterate(unit, omega, 1, 8, method=method).final
        growth = np.linalg.norm(exact[1:], axis=1).max()
        assert np.hypot(*(final - exact[-1])) < 2e-15 * max(1, growth)


HUGE = [
    [1e3, 1e10], [1e10, 1e25], [3e14, 1e35], [1e16, -1e35], [1e18, -1e20], [1e61, 0.1],
    [1e90, -1e91], [1e95, 3e92], [1e98, 1e80], [1e-90, 1e98],
]  # fmt: skip


@pytest.mark.parametrize("omega", HUGE)
def test_huge_states(unit, omega):
    """Iteration goes on; the closed form is right, or NaN with a warning. The reference needs 700
    digits because of cancellation; squares overflow float64.
    """
    with mpmath.workdps(700):
        exact = naive.orbit(1, 1, 1, 0, 1, omega, 40)
        for method in ("auto", "canonical"):
            state = sf.iterate(unit, omega, 1, 40, method=method).final
            assert naive.relative_error(state, exact[-1]) < 2e-15
        for function, *n in ((sf.exact, [1, 40]), (sf.limits,)):
            with pytest.warns(RuntimeWarning, match="2 of 2 states: beyond the range"):
                assert np.isnan(function(unit, omega, 1, *n)).all()


@every_method
def test_mirror_images(unit, rng, method):
    """Bit for bit, the map commutes with x -> -x, and with (y, eps) -> -(y, eps)."""
    omega = rng.normal(size=(30, 2)) * 10 ** rng.uniform(-1, 2, (30, 1))
    orbit = sf.iterate(unit, omega, 1, 8, method=method).omega
    for signs in ([-1, 1], [1, -1], [-1, -1]):
        mirrored = sf.iterate(unit, omega * signs, signs[1], 8, method=method).omega
        assert (mirrored == orbit * signs).all()


def test_runs_copy_their_arguments(body):
    omega = np.array([[1.0, 0.5], [0.3, 0.2]])
    whole = sf.iterate(body, omega, 0.2, 60, save_every=None)
    half = sf.iterate(body, omega, 0.2, 10, save_every=None)
    omega[:] = 7.0  # the caller changes the array
    assert (half.extend(50).final == whole.final).all()


def test_batches_of_many_axes(body):
    """NumPy's limit on the number of axes is checked before any computation."""
    most = 29 if np.lib.NumpyVersion(np.__version__) < "2.0.0" else 32
    eps = np.full((1,) * most, 0.2)
    result = sf.iterate(body, [1.0, 0.5], eps[..., 0], 3, attitude=True)
    assert result.attitude.shape == (4, *eps.shape[1:], 3, 3)
    with pytest.raises(ValueError, match=r"that broadcast|maximum supported dimension"):
        sf.iterate(body, [1.0, 0.5], eps[np.newaxis], 3, attitude=True)
