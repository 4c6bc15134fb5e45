"""The map against the implicit equations (ds1), (ds) in 60 digits."""

import mpmath
import naive
import numba
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import suslov_fast as sf
from suslov_fast._kernels import tiles

METHODS = ("canonical", "ds2")
PICTURES = [
    (4, 1, -0.5, -0.3, 0.2),
    (4, 3, -0.4, -0.2, 0.2),
    (4, 2, 0, -0.2, 0.02),
    (3, 3, -0.2, -0.2, 1),
]


def random_problem(rng, spread=1.0):
    """A body, a step size of either sign and a state; |t| may be below or above 1."""
    I1, I2 = 10 ** rng.uniform(-spread, spread, 2)
    I13, I23 = rng.uniform(-0.5, 0.5, 2) * min(I1, I2)
    eps = 10 ** rng.uniform(-2, 0) * rng.choice([-1, 1])
    return (I1, I2, I13, I23), eps, rng.normal(size=2) * 10 ** rng.uniform(-1, 1)


def worst_error(orbit, exact):
    return worst_error_of(orbit.omega, exact)


def worst_error_of(states, exact):
    return max(map(naive.relative_error, states, exact))


@pytest.mark.parametrize("method", METHODS)
def test_reference_a(body, method):
    orbit = sf.iterate(body, [1, 0.5], 0.2, 25, method=method)
    np.testing.assert_allclose(orbit.final, [0.873325256997698741, -1.093093383546291025], 2e-15)
    np.testing.assert_allclose(
        sf.first_integral(body, orbit.omega, 0.2), 0.265344729629329021, rtol=3e-15
    )


@pytest.mark.parametrize("method", METHODS)
def test_reference_b_beyond_t_1(method):
    body = sf.Suslov3D(3, 3, -0.2, -0.2)
    orbit = sf.iterate(body, [-40, -250], 1, 7, method=method)
    np.testing.assert_allclose(orbit.final, [18.421539814306758, -18.421529611379469], 1e-12)
    assert orbit.status == sf.Status.SUPERCRITICAL
    assert orbit.ok


@pytest.mark.parametrize("method", METHODS)
def test_subcritical_orbits(rng, method):
    for _ in range(40):
        parameters, eps, omega = random_problem(rng)
        body = sf.Suslov3D(*parameters)
        if abs(sf.criticality(body, omega, eps)) < 0.95:
            exact = naive.orbit(*parameters, eps, omega, 60)
            orbit = sf.iterate(body, omega, eps, 60, method=method)
            assert worst_error(orbit, exact) < 5e-14


@pytest.mark.parametrize("steps", [60, 61])
def test_final_states_of_auto(rng, steps):
    for _ in range(40):
        parameters, eps, omega = random_problem(rng)
        body = sf.Suslov3D(*parameters)
        if abs(sf.criticality(body, omega, eps)) < 0.95:
            exact = naive.orbit(*parameters, eps, omega, steps)[-1]
            final = sf.iterate(body, omega, eps, steps, save_every=None).final
            assert naive.relative_error(final, exact) < 5e-14


@pytest.mark.parametrize("distance", [1e-3, 1e-8, 1e-15])
def test_orbits_that_leave_the_repelling_line(rng, distance):
    """x is a tiny difference at first, and all that follows is proportional to it."""
    for _ in range(10):
        (I1, I2, I13, I23), eps, _ = random_problem(rng)
        eps = abs(eps)
        body = sf.Suslov3D(I1, I2, I13, I23)
        repelling = np.array([I23, -I13]) * 2 * np.sqrt(I1 * I2) / np.hypot(I13, I23)
        omega = repelling * (1 + distance * rng.normal(size=2))
        if 0.02 < sf.criticality(body, omega, eps) < 0.95:
            exact = naive.orbit(I1, I2, I13, I23, eps, omega, 60)
            assert worst_error(sf.iterate(body, omega, eps, 60), exact) < 5e-14
            final = sf.iterate(body, omega, eps, 60, save_every=None).final
            assert naive.relative_error(final, exact[-1]) < 5e-14


@pytest.mark.parametrize("save_every", [1, None])
def test_supercritical_orbits(rng, save_every):
    """Near a pole both the state and its error are large: the bound follows the largest state."""
    seen = 0
    while seen < 25:
        parameters, eps, omega = random_problem(rng)
        body = sf.Suslov3D(*parameters)
        omega = omega * 3 / abs(sf.criticality(body, omega, eps))
        if abs(sf.criticality(body, omega, eps)) < 1.05:
            continue
        seen += 1
        exact = naive.orbit(*parameters, eps, omega, 12)
        orbit = sf.iterate(body, omega, eps, 12, save_every=save_every)
        assert orbit.status == sf.Status.SUPERCRITICAL
        sizes = [float(np.hypot(*map(float, state))) for state in exact]
        bound = 1e-14 * max(sizes) / min(sizes)
        assert naive.relative_error(orbit.final, exact[-1]) < bound


@pytest.mark.parametrize("parameters", PICTURES)
def test_the_bodies_of_the_pictures(parameters):
    omega = [1.5, 0.25]
    exact = naive.orbit(*parameters, omega, 60)
    orbit = sf.iterate(sf.Suslov3D(*parameters[:4]), omega, parameters[4], 60)
    assert worst_error(orbit, exact) < 5e-15


def test_one_step_equals_the_paper(rng):
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        exact = naive.step(*parameters, eps, naive.exactly(*omega))
        computed = sf.step(sf.Suslov3D(*parameters), omega, eps)
        growth = float(np.hypot(*map(float, exact))) / np.hypot(*omega)
        assert naive.relative_error(computed, exact) < 1e-14 * max(1, growth)


def test_a_step_next_to_a_pole(unit):
    """The matrix of (ds2) is nearly singular; a relative error of 1e-16 in the data grows."""
    for gap in (1e-3, 1e-6, 1e-9):
        omega = [1.0, -3.0 + gap]
        exact = naive.step(1, 1, 1, 0, 1, naive.exactly(*omega))
        assert naive.relative_error(sf.step(unit, omega, 1), exact) < 4e-15 / gap


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [1e-100, 1e-30, 1e30, 1e100])
def test_scales_of_the_body(body, scale, method):
    """The map knows ratios of inertia only."""
    scaled = sf.Suslov3D(*(scale * parameter for parameter in body.parameters))
    expected = sf.iterate(body, [1, 0.5], 0.2, 30, method=method).omega
    computed = sf.iterate(scaled, [1, 0.5], 0.2, 30, method=method).omega
    np.testing.assert_allclose(computed, expected, rtol=1e-13)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [2.0**-500, 2.0**-100, 2.0**100, 2.0**490])
def test_scales_of_time(body, scale, method):
    """omega times eps is all that matters; with powers of two, bit for bit."""
    expected = sf.iterate(body, [1, 0.5], 0.25, 30, method=method).omega
    computed = sf.iterate(body, np.array([1, 0.5]) * scale, 0.25 / scale, 30, method=method).omega
    np.testing.assert_allclose(computed / scale, expected, rtol=4e-15)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [2.0**-600, 2.0**600])
def test_scales_of_the_products_of_inertia(body, scale, method):
    I1, I2, I13, I23 = body.parameters
    scaled = sf.Suslov3D(I1, I2, I13 * scale, I23 * scale)
    expected = sf.iterate(body, [1, 0.5], 0.25, 30, method=method).omega
    computed = sf.iterate(scaled, [1, 0.5], 0.25 / scale, 30, method=method).omega
    assert (computed == expected).all()


@pytest.mark.parametrize("save_every", [1, None])
@pytest.mark.parametrize("method", ["auto", *METHODS])
def test_identity_without_products_of_inertia(rng, method, save_every):
    omega = rng.normal(size=(5, 2))
    result = sf.iterate(
        sf.Suslov3D(2, 3, 0, 0), omega, 0.5, 9, method=method, save_every=save_every
    )
    assert (result.omega == omega).all()
    assert (result.final == omega).all()
    assert (result.status == sf.Status.OK).all()


@pytest.mark.parametrize("save_every", [1, None])
@pytest.mark.parametrize("method", ["auto", *METHODS])
def test_identity_without_step(body, rng, method, save_every):
    omega = rng.normal(size=(5, 2))
    result = sf.iterate(body, omega, 0.0, 9, method=method, save_every=save_every)
    assert (result.omega == omega).all()


@pytest.mark.parametrize("save_every", [1, None])
def test_steady_states_stay(body, save_every):
    omega = np.array([[0.3, -0.5], [-0.3, 0.5], [0.0, 0.0]])
    result = sf.iterate(body, omega, 0.2, 500, save_every=save_every)
    np.testing.assert_allclose(result.final, omega, rtol=1e-13, atol=0)


def test_negative_eps_inverts(rng):
    for _ in range(20):
        parameters, eps, omega = random_problem(rng)
        body = sf.Suslov3D(*parameters)
        if abs(sf.criticality(body, omega, eps)) < 0.5:
            back = sf.step(body, sf.step(body, omega, eps), -eps)
            np.testing.assert_allclose(back, omega, rtol=0, atol=2e-14 * np.hypot(*omega))


def test_orbits_tend_to_the_line(body):
    """The last proposition of Section 4, from both sides of the line."""
    final = sf.iterate(body, [[1, 0.5], [-1, -0.5]], 0.2, 3000, save_every=None).final
    x, y = sf.to_xy(body, final).T
    assert (abs(x) < 1e-15).all()
    assert (y < 0).all()


@pytest.mark.compiled
@pytest.mark.parametrize("method", METHODS)
def test_F_over_a_long_run(body, rng, method):
    omega = rng.uniform(-2, 2, (200, 2))
    states = sf.iterate(body, omega, 0.2, 100_000, save_every=5000, method=method).omega
    F = sf.first_integral(body, states, 0.2)
    assert abs(F / F[0] - 1).max() < 2e-13


def near_criticality(rng, t):
    """A problem that starts next to the repelling half of the line, with a given t."""
    I1, I2 = rng.uniform(0.5, 4, 2)
    I13, I23 = rng.uniform(-0.5, 0.5, 2)
    eps = rng.uniform(0.1, 1)
    y = 2 * I1 * I2 / eps * t
    omega = y / (I13**2 * I2 + I23**2 * I1) * np.array([I23, -I13])
    omega = omega * (1 + rng.normal(size=2) * 10 ** rng.uniform(-14, -4) * (1 - t))
    return (I1, I2, I13, I23), eps, omega


@pytest.mark.parametrize("gap", [0.5, 0.2, 0.05, 1e-2, 1e-4, 1e-8, 1e-13])
def test_orbits_up_to_the_critical_line(rng, gap):
    """There 1 - Y is small, and what follows is proportional to it."""
    seen = 0
    for _ in range(30):
        parameters, eps, omega = near_criticality(rng, 1 - gap)
        body = sf.Suslov3D(*parameters)
        if sf.criticality(body, omega, eps) < 1:
            seen += 1
            exact = naive.orbit(*parameters, eps, omega, 60)
            assert worst_error(sf.iterate(body, omega, eps, 60), exact) < 1e-14
            final = sf.iterate(body, omega, eps, 60, save_every=None).final
            assert naive.relative_error(final, exact[-1]) < 1e-14
            assert worst_error_of(sf.exact(body, omega, eps, np.arange(61)), exact) < 2e-14
    assert seen > 10


@pytest.mark.parametrize("method", ["auto", "canonical"])
def test_a_repelled_orbit_leaves_however_close_it_starts(method):
    """X is as small as what is flushed to 0 elsewhere, but it grows."""
    body, omega, steps = sf.Suslov3D(2, 1, 0, 0.5), [1.5, 1e-300], 1200
    orbit = sf.iterate(body, omega, 1.0, steps, save_every=10, method=method)
    exact = sf.exact(body, omega, 1.0, orbit.n)
    assert abs(orbit.omega[:, 1]).max() > 0.1
    np.testing.assert_allclose(orbit.omega, exact, atol=1e-10)


@pytest.mark.parametrize("method", ["auto", *METHODS])
def test_the_identity_holds_for_every_number(method):
    for still, eps in ((sf.Suslov3D(1, 2, 0, 0), 0.5), (sf.Suslov3D(1, 2, 0.1, 0.2), 0.0)):
        result = sf.iterate(still, [1e305, -1e-305], eps, 5, method=method)
        assert (result.omega == [1e305, -1e-305]).all()
    huge = sf.Suslov3D(1e-300, 1e-300, 1e300, 0)
    assert (sf.step(huge, [1, 1], 0) == 1).all()
    assert (sf.step(sf.Suslov3D(1e200, 1e-200, 0, 0), [1, 1], 1) == 1).all()


@pytest.mark.compiled
def test_subnormal_states_are_flushed():
    """x decays by a fixed factor each step; it ends at 0, not among slow subnormal numbers."""
    picture3 = sf.Suslov3D(4, 2, 0, -0.2)  # Omega2 is proportional to x
    orbit = sf.iterate(picture3, [5.0, 1.0], 1.0, 20_000)
    x = orbit.omega[:, 1]
    assert x[-1] == 0
    exact = sf.exact(picture3, [5.0, 1.0], 1.0, orbit.n)[:, 1]
    seen = abs(exact) > 1e-280
    np.testing.assert_allclose(x[seen], exact[seen], rtol=1e-9)
    assert np.count_nonzero((x != 0) & (abs(x) < 2.0**-1022)) < 256


@pytest.mark.parametrize("batch", [1, 127, 128, 129])
def test_flushed_states_are_shown(batch):
    """X becomes 0 after a state that is shown as it was, in whatever batch and cut."""
    body = sf.Suslov3D(2.351018099947861, 3.388972810861883, 0.0, -0.5920589833785945)
    omega, eps = np.tile([-0.43643524714322124, -1.169801907772864], (batch, 1)), 0.869683938565067
    states = sf.iterate(body, omega, eps, 3073, method="canonical").omega
    assert (states[3072, :, 1] != 0.0).all()
    assert (states[3073:, :, 1] == 0.0).all()
    apart = sf.iterate(body, omega, eps, 3073, method="canonical", save_every=2).omega
    assert (apart == states[::2]).all()
    gone_on = sf.iterate(body, omega, eps, 3072, method="canonical").extend(1).omega
    assert (gone_on == states).all()


@pytest.mark.parametrize(("decay", "zero"), [(3.0, False), (3.6, False), (3.7, True)])
def test_only_what_is_negligible_is_flushed(decay, zero):
    """Omega2 becomes 2**decay times smaller at each step, and 0 below 2**-960."""
    r = 2.0**-decay
    t = (1 - r) / (1 + r)
    body, steps = sf.Suslov3D(1, 1, 0, 1), 257
    omega = [-2 * t, 2.0**-20]
    final = sf.iterate(body, omega, 1.0, steps, method="canonical", save_every=None).final
    exact = naive.orbit(1, 1, 0, 1, 1.0, omega, steps)[-1]
    assert (final[1] == 0) == zero
    assert zero or abs(final[1] / float(exact[1]) - 1) < 1e-12
    assert abs(final[0] / float(exact[0]) - 1) < 1e-14
    half = sf.iterate(body, omega, 1.0, 100, method="canonical", save_every=None)
    assert (half.extend(steps - 100).final == final).all()


@pytest.mark.parametrize("method", ["auto", "canonical"])
@pytest.mark.parametrize("size", [5e-324, 1e-310, 1e-290, 1e-200, 1e-150, 1e-100, 1e-30, 1e-14])
def test_slow_states(unit, method, size):
    """Too slow to be held in the coordinates of the map, or just not."""
    omega = np.array([0.7, -0.4])
    final = sf.iterate(unit, omega, size, 3, method=method, save_every=None).final
    exact = naive.orbit(1, 1, 1, 0, size, omega, 3)[-1]
    assert naive.relative_error(final, exact) < 5e-16
    assert (final != omega).all() == (size > 1e-16)
    many = 10**4
    final = sf.iterate(unit, omega, size, many, method=method, save_every=None).final
    flow = sf.flow(unit, omega, size * many)
    np.testing.assert_allclose(final, flow, rtol=5e-12)


@given(
    st.floats(0.05, 20), st.floats(0.05, 20), st.floats(-2, 2), st.floats(-2, 2),
    st.floats(-1, 1), st.floats(-5, 5), st.floats(-5, 5),
)  # fmt: skip
def test_one_step_satisfies_ds1(I1, I2, I13, I23, eps, omega1, omega2):
    body = sf.Suslov3D(I1, I2, I13, I23)
    assume(abs(sf.criticality(body, [omega1, omega2], eps)) <= 0.9)
    following = sf.step(body, [omega1, omega2], eps)
    residual = naive.ds1(
        *naive.exactly(I1, I2, I13, I23, eps),
        naive.exactly(omega1, omega2),
        naive.exactly(*following),
    )
    largest = max(abs(omega1), abs(omega2), *abs(following))
    size = max(I1, I2) * largest + abs(eps) * max(abs(I13), abs(I23)) * largest**2
    assert max(map(abs, residual)) <= 1e-13 * size * max(1, I1 / I2, I2 / I1)


def test_step_full_against_ds(rng):
    for _ in range(30):
        parameters, eps, _ = random_problem(rng, spread=0.5)
        omega, I3 = rng.normal(size=3), float(rng.uniform(1, 5))
        exact = naive.step_full(*parameters, eps, I3, omega)
        computed = sf.step_full(sf.Suslov3D(*parameters), omega, eps, I3)
        assert naive.relative_error(computed, exact) < 1e-13
        assert computed[2] == -omega[2]


def test_step_full_on_the_constraint_is_step(body, rng):
    omega = rng.normal(size=(6, 2))
    full = sf.step_full(body, np.column_stack([omega, np.zeros(6)]), 0.2, I3=3)
    np.testing.assert_allclose(full[:, :2], sf.step(body, omega, 0.2), rtol=1e-14)
    assert (full[:, 2] == 0).all()


def test_step_full_broadcasts(body, rng):
    omega = rng.normal(size=(4, 1, 3))
    result = sf.step_full(body, omega, [0.1, 0.2], I3=[3.0, 4.0])
    assert result.shape == (4, 2, 3)
    assert (result[2, 1] == sf.step_full(body, omega[2, 0], 0.2, 4.0)).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [10.0, 1e3, 1e5, 1e8, 1e12])
def test_large_states(unit, rng, size, method):
    """One step takes most of them back to the order of 1: Y - X X' would cancel."""
    for _ in range(20):
        omega = size * rng.uniform(-1, 1, 2)
        exact = naive.orbit(1, 1, 1, 0, 1, omega, 8)
        growth = float(max(np.hypot(*map(float, state)) for state in exact[1:]))
        orbit = sf.iterate(unit, omega, 1, 8, method=method)
        error = np.hypot(*(orbit.final - np.array(exact[-1], float)))
        assert error < 2e-15 * max(1, growth)


@pytest.mark.parametrize("method", ["auto", *METHODS])
@pytest.mark.parametrize("save_every", [1, None])
def test_states_that_are_0_or_nearly(unit, method, save_every):
    omega = np.array([[0.0, 0.0], [5e-324, 0.0], [0.0, -5e-324], [2.0**-1022, -(2.0**-1023)]])
    result = sf.iterate(unit, omega, 1, 9, method=method, save_every=save_every)
    assert (result.omega == omega).all()
    assert (result.status == sf.Status.OK).all()


@pytest.mark.parametrize("method", METHODS)
def test_mirror_images(unit, rng, method):
    """x changes sign and nothing else, bit for bit; so do y and the step size together."""
    for omega in rng.normal(size=(30, 2)) * 10 ** rng.uniform(-1, 2, (30, 1)):
        orbit = sf.iterate(unit, omega, 1, 8, method=method).omega
        for signs in ([-1, 1], [1, -1], [-1, -1]):
            mirrored = sf.iterate(unit, omega * signs, signs[1], 8, method=method).omega
            assert (mirrored == orbit * signs).all()


@pytest.mark.parametrize(
    "omega", [[1e3, 1e10], [1e10, 1e25], [3e14, 1e35], [1e16, -1e35], [1e18, -1e20], [1e61, 0.1]]
)
def test_far_too_large_states(unit, omega):
    """What cancels here leaves nothing of 60 digits."""
    states = [
        sf.iterate(unit, omega, 1, 40, save_every=None).final,
        sf.iterate(unit, omega, 1, 40, method="canonical").final,
        sf.exact(unit, omega, 1, 40),
    ]
    with mpmath.workdps(300):
        exact = naive.orbit(1, 1, 1, 0, 1, omega, 40)[-1]
        for state in states:
            assert naive.relative_error(state, exact) < 1e-15


@pytest.mark.parametrize("k", [-900, -600, -300, -1, 300, 600])
@pytest.mark.parametrize("method", METHODS)
def test_any_unit_of_time(rng, method, k):
    """Scaled by powers of two, states are scaled and no bit of them changes."""
    omega = rng.normal(size=(50, 2)) * 10 ** rng.uniform(-2, 2, (50, 1))
    body = sf.Suslov3D(*rng.uniform(0.5, 4, (2, 50)), *rng.normal(size=(2, 50)))
    expected = sf.iterate(body, omega, 0.3, 20, method=method, on_singular="ignore")
    scaled = sf.iterate(
        body, np.ldexp(omega, k), np.ldexp(0.3, -k), 20, method=method, on_singular="ignore"
    )
    assert np.array_equal(np.ldexp(scaled.omega, -k), expected.omega, equal_nan=True)
    assert (scaled.status == expected.status).all()


def test_at_the_ends_of_float64(unit):
    np.testing.assert_allclose(
        sf.step(unit, [1e301, 0.5e301], 1e-301), [30e300 / 7, 65e300 / 7], rtol=1e-15
    )
    assert (sf.step(unit, [1e200, 1e200], 1e-310) == [1e200, 1e200]).all()
    body = sf.Suslov3D(1, 1, 1, 0)
    tiny = sf.iterate(body, [5e-310, 3e-310], 1e308, 3).omega
    usual = sf.iterate(body, [5e-2, 3e-2], 1, 3).omega
    np.testing.assert_allclose(tiny * 1e308, usual, rtol=1e-13)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("batch", [9, 128, 300, 1001])
@pytest.mark.parametrize("shift", [0, 2, 3])
def test_memory_past_the_caches(body, rng, monkeypatch, method, batch, shift):
    """Wherever rows begin, states are those of a batch that stays in the caches; no others move."""
    rows = 5 if numba.config.DISABLE_JIT else tiles._LARGE // (2 * batch) + 2
    room = np.full(2 * batch * rows + 16, np.pi)
    out = room[8 + shift : 8 + shift + 2 * batch * rows].reshape(rows, batch, 2)
    omega = rng.normal(size=(batch, 2))
    parts = np.array_split(np.arange(batch), 8)
    few = [sf.iterate(body, omega[some], 0.2, rows - 1, method=method) for some in parts]
    monkeypatch.setattr(tiles, "_LARGE", 0)  # for kernels that are not compiled
    sf.iterate(body, omega, 0.2, rows - 1, method=method, out=out)
    for some, expected in zip(parts, few, strict=True):
        assert (out[:, some] == expected.omega).all()
    assert (room[: 8 + shift] == np.pi).all()
    assert (room[8 + shift + out.size :] == np.pi).all()
