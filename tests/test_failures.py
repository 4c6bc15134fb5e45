"""Poles and overflow, and the warnings and errors about them."""

import itertools
import pickle

import naive
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import run, threads

METHODS = ("auto", "canonical", "ds2")

# With the body `unit` and eps = 1: X**2 = Omega1**2 / 2 and Y = -Omega2 / 2.
ON_THE_POLE = [1.0, -3.0]
UNDEFINED = [0.0, -2.0]
HEALTHY = [0.3, 0.1]


def before_the_pole(steps):
    """Return a state that the map takes to a pole in this many steps, up to rounding."""
    omega = np.array(ON_THE_POLE)
    for _ in range(steps):
        omega = sf.step(sf.Suslov3D(1, 1, 1, 0), omega, -1)
    return omega


@pytest.mark.parametrize("save_every", [1, 2, None])
@pytest.mark.parametrize("method", METHODS)
def test_singular_steps(unit, method, save_every):
    omega = [HEALTHY, ON_THE_POLE, UNDEFINED, HEALTHY]
    with pytest.warns(sf.SingularStepWarning) as caught:
        result = sf.iterate(unit, omega, 1, 10, method=method, save_every=save_every)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert str(caught[0].message) == "2 of 4 trajectories: singular step, first: 1 at step 1"
    assert result.status.tolist() == [0, -1, -1, 0]
    assert result.failed_at.tolist() == [-1, 1, 1, -1]
    assert not result.ok
    assert np.isnan(result.final[1:3]).all()
    if save_every:
        assert (result.omega[0, 1:3] == omega[1:3]).all()
        assert np.isnan(result.omega[1:, 1:3]).all()
    healthy = sf.iterate(unit, HEALTHY, 1, 10, method=method, save_every=save_every)
    assert (result.omega[:, 0] == healthy.omega).all()
    assert (result.omega[:, 3] == healthy.omega).all()


@pytest.mark.parametrize("x", [0.5, 1.0, 3.0, 10.0, 1e3, 1e5])
@pytest.mark.parametrize("I1", [1.0, 2.0, 3.0, 5.0])
def test_poles_of_exact_data(I1, x):
    """Poles on the parabola y = 2a/eps + eps x**2, with inexact sqrt(2a).

    A difference of the size of the rounding errors of its terms counts as zero.
    """
    body, omega = sf.Suslov3D(I1, 1, 1, 0), [x, -(2 * I1 + x * x)]
    for method in METHODS:
        result = sf.iterate(body, omega, 1, 3, method=method, on_singular="ignore")
        assert result.status == sf.Status.SINGULAR
        assert result.failed_at == 1
    assert_no_next_state(body, omega, 1, "singular step")


def assert_no_next_state(body, omega, eps, message):
    """`step_full`, `jacobian` and `lyapunov_exponents` warn and return NaN."""
    full = np.insert(omega, 2, 0.0, axis=-1)
    with pytest.warns(sf.SingularStepWarning, match=message):
        assert np.isnan(sf.step_full(body, full, eps, 3)).all()
    with pytest.warns(sf.SingularStepWarning):
        assert np.isnan(sf.jacobian(body, omega, eps)).all()
    with pytest.warns(sf.SingularStepWarning):
        assert np.isnan(sf.lyapunov_exponents(body, omega, eps, 1)).all()


@pytest.mark.parametrize("along", [1, 2])
def test_poles_of_rounded_states(rng, along):
    """Rounded states on a pole: their denominators are the largest that count as zero."""
    I, x = rng.uniform(0.5, 4, 100), 10 ** rng.uniform(-2, 5, 100)
    body = sf.Suslov3D(I, 1, 1, 0) if along == 1 else sf.Suslov3D(1, I, 0, 1)
    omega = np.column_stack([x, -(2 * I + x * x)])
    omega = omega if along == 1 else -omega[:, ::-1]
    for method in ("canonical", "ds2"):
        result = sf.iterate(body, omega, 1, 3, method=method, on_singular="ignore")
        assert (result.status == sf.Status.SINGULAR).all()
        assert (result.failed_at == 1).all()
    # The closed form finds some of these states, as accurately as the rounded state allows.
    result = sf.iterate(body, omega, 1, 3, on_singular="ignore")
    for k in np.flatnonzero(result.status != sf.Status.SINGULAR):
        parameters = [np.broadcast_to(each, 100)[k] for each in body.parameters]
        exact = naive.step(*parameters, 1, omega[k])
        assert naive.relative_error(result.omega[1, k], exact) < 0.5
    assert (result.failed_at[result.status < 0] == 1).all()
    assert_no_next_state(body, omega, 1, "singular step")


def test_poles_in_n_dimensions(rng):
    """A pivot of the size of its rounding errors counts as zero; a larger one does not.

    With two variables, the map is that of three dimensions.
    """
    I, x = rng.uniform(0.5, 4, 200), 10 ** rng.uniform(0, 5, 200)
    body = sf.SuslovND(np.column_stack([np.ones(200), I]), [-1.0, 0.0])
    omega = np.column_stack([-(2 * I + x * x), -x])
    simple = sf.SuslovND([1.0, 1.0], [-1.0, 0.0])  # with a pole at X = 0.5, Y = 1.25
    next_to = [-2 * (1.25 - 2.0**-47), -0.5 * np.sqrt(2)]
    for method in ("rank2", "gauss"):
        run = sf.iterate(body, omega, 1, 1, method=method, on_singular="ignore")
        assert np.count_nonzero(run.status == sf.Status.SINGULAR) > 190
        assert sf.iterate(simple, next_to, 1, 1, method=method).status == sf.Status.OK
    with pytest.warns(sf.SingularStepWarning):
        exponents = sf.lyapunov_exponents(body, omega, 1, 1)
    assert np.count_nonzero(np.isnan(exponents).all(axis=1)) > 190
    assert np.isfinite(sf.lyapunov_exponents(simple, next_to, 1, 1)).all()


@pytest.mark.parametrize("x", [1.0, 16.0])
def test_no_state_next_to_a_pole_is_lost(unit, x):
    """A few ulps away from a pole, the next state exists and is accurate."""
    for gap in 2.0 ** np.arange(-47, -40):
        omega = np.array([x, -(2 + x * x) * (1 - gap)])
        exact = naive.step(1, 1, 1, 0, 1, omega)
        bound = 4e-15 / gap
        for method in METHODS:
            final = sf.iterate(unit, omega, 1, 1, method=method).final
            assert naive.relative_error(final, exact) < bound
        assert naive.relative_error(sf.step_full(unit, [*omega, 0.0], 1, 3)[:2], exact) < bound
        assert np.isfinite(sf.jacobian(unit, omega, 1)).all()


def test_steady_states_next_to_the_critical_one(unit):
    """1 - Y is as small as its rounding errors, but the step does not divide by it."""
    for k, method in itertools.product((40, 50, 51, 52), ("auto", "canonical")):
        omega = [0.0, -2.0 * (1 - 2.0**-k)]
        result = sf.iterate(unit, omega, 1, 5, method=method)
        assert result.status == sf.Status.OK
        assert (result.omega == omega).all()


@pytest.mark.parametrize("method", METHODS)
def test_failures_are_found_in_parts_of_a_run(unit, monkeypatch, small_parts, method):
    """`failed_at` counts from the start of the run, not of the part."""
    omega = np.array([before_the_pole(3), HEALTHY, ON_THE_POLE, before_the_pole(1), [1e200, 0]])
    omega = np.concatenate([omega, [[np.nan, 0.0]]])
    whole = sf.iterate(unit, omega, 1, 9, method=method, on_singular="ignore")
    assert whole.failed_at.tolist() == [4, -1, 1, 2, 1, 0]
    assert whole.status.tolist() == [-1, 0, -1, -1, -2, -2]
    expected = (whole.failed_at >= 0) & (np.arange(10)[:, None] >= whole.failed_at)
    assert (np.isnan(whole.omega).all(axis=-1) == expected).all()
    for steps in (1, 2, 3):
        monkeypatch.setattr(run, "_PART", 5 * steps)
        cut = sf.iterate(unit, omega, 1, 9, method=method, on_singular="ignore", save_every=None)
        assert (cut.failed_at == whole.failed_at).all()
        assert (cut.status == whole.status).all()


@pytest.mark.parametrize("method", METHODS)
def test_supercritical_orbits(unit, method):
    """Orbits with |Y| >= 1 are supercritical; the identity (I13 = I23 = 0) never is."""
    omega2 = np.array([-3.0, -2.5, -1.99, 0.0, 1.99, 2.0, 2.5, 300.0])
    omega = np.column_stack([np.full(8, 1e-3), omega2])
    status = sf.iterate(unit, omega, 1, 2, method=method).status
    assert status.tolist() == [1, 1, 0, 0, 0, 1, 1, 1]
    still = sf.Suslov3D(1, 1, 0, 0)
    assert (sf.iterate(still, omega * 1e9, 1, 2, method=method).status == 0).all()


def test_passing_a_pole_is_no_failure(unit):
    """Next to a pole the orbit jumps far away and comes back."""
    omega = np.array([1.0, -3.0 + 1e-9])
    result = sf.iterate(unit, omega, 1, 10)
    assert result.status == sf.Status.SUPERCRITICAL
    assert abs(result.omega[1]).max() > 1e8
    F = sf.first_integral(unit, result.omega, 1)
    np.testing.assert_allclose(F, F[0], rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("omega", [[1e200, 1e200], [1e160, 0.5], [1e155, 1e155], [-1e300, 1e290]])
def test_overflow(body, method, omega):
    with pytest.warns(sf.SingularStepWarning, match="1 of 2 trajectories: non-finite step"):
        result = sf.iterate(body, [omega, HEALTHY], 1, 5, method=method)
    assert result.status.tolist() == [sf.Status.NONFINITE, sf.Status.OK]
    assert result.failed_at.tolist() == [1, -1]
    assert np.isnan(result.omega[1:, 0]).all()
    assert (result.omega[:, 1] == sf.iterate(body, HEALTHY, 1, 5, method=method).omega).all()


@pytest.mark.parametrize("method", ["canonical", "ds2"])
@pytest.mark.parametrize("omega", [[1e200, 0], [1e155, 1e100]])
def test_overflow_of_the_denominator(unit, method, omega):
    """Division by an overflowed denominator must not give 0; `step_full` rescales instead."""
    result = sf.iterate(unit, omega, 1, 5, method=method, on_singular="ignore")
    assert result.status == sf.Status.NONFINITE
    assert result.failed_at == 1
    with naive.mp.workdps(900):
        exact = naive.step_full(1, 1, 1, 0, 1, 3, [*omega, 0.0])
    assert naive.relative_error(sf.step_full(unit, [*omega, 0.0], 1, 3), exact) < 1e-14


def test_the_closed_form_beyond_float64(unit):
    """For overflowing squares, `exact` warns and returns NaN, and `iterate` saves no infinity."""
    with pytest.warns(RuntimeWarning, match="1 of 2 states: .* exceeds the range of float64"):
        states = sf.exact(unit, [[1e200, 0.0], HEALTHY], 1, 1)
    assert np.isnan(states[0]).all()
    body = sf.Suslov3D(1, 1e-20, 0, 1)
    orbit = sf.iterate(body, [-1e300, 1e305], 5e-321, 60, on_singular="ignore")
    last = sf.iterate(body, [-1e300, 1e305], 5e-321, 60, save_every=None, on_singular="ignore")
    assert not np.isinf(orbit.omega).any()
    assert orbit.status == last.status
    assert orbit.ok == bool(np.isfinite(orbit.omega).all())


def test_large_but_representable():
    """A state with t < 1 has a next state if X**2 is in range."""
    unit = sf.Suslov3D(1, 1, 1, 0)
    for x in (1e20, 1e70, 1e150):
        result = sf.iterate(unit, [x, -1.0], 1, 5, save_every=None)
        assert result.status == sf.Status.OK
        np.testing.assert_allclose(result.final, [0, 2], atol=1e-15)


def test_both_kinds_in_one_message(unit):
    """The warning names trajectories of a batch with several axes by their indices."""
    omega = np.tile(HEALTHY, (3, 4, 1))
    omega[1, 2], omega[2, 0], omega[0, 3] = ON_THE_POLE, UNDEFINED, [1e200, 0]
    with pytest.warns(sf.SingularStepWarning) as caught:
        result = sf.iterate(unit, omega, 1, 3, method="canonical")
    assert str(caught[0].message) == (
        "2 of 12 trajectories: singular step, first: (1, 2) at step 1; "
        "1 of 12 trajectories: non-finite step, first: (0, 3) at step 1"
    )
    assert np.argwhere(result.failed_at == 1).tolist() == [[0, 3], [1, 2], [2, 0]]


def overflowing():
    """States and step sizes whose next state overflows in one component, the other, or both."""
    for omega in ([0.1, -2.01 + 3e-12], [1.0, -3.0 + 1e-11], [16.0, -258.0 + 2e-8]):
        yield np.array(omega) / 1e-298, 1e-298
    # Poles with small and with large X.
    for omega, gap, eps in (([1e-3, -2 - 1e-6], 2e-14, 1e-298), ([1e3, -2 - 1e6], 2e-3, 1e-295)):
        for side, sign1, sign2 in itertools.product((1, -1), repeat=3):
            yield np.add(omega, [0, side * gap]) / eps * [sign1, sign2], eps * sign2


@pytest.mark.parametrize(("omega", "eps"), list(overflowing()))
def test_overflow_of_an_intermediate_state(unit, omega, eps):
    """An orbit ends at a state beyond float64, even if later states would be in range."""
    for method, save_every in itertools.product(METHODS, (1, 2, None)):
        options = {"method": method, "save_every": save_every, "on_singular": "ignore"}
        result = sf.iterate(unit, omega, eps, 5, **options)
        assert result.status == sf.Status.NONFINITE
        assert result.failed_at == 1
        assert np.isnan(result.final).all()


@pytest.mark.parametrize("method", METHODS)
def test_as_large_as_float64_allows(unit, method):
    """An orbit through states of 1e306 equals the orbit in smaller units, bit for bit."""
    eps = 2.0**-990
    omega = np.array([1.0, -3.0 + 2.0**-26])
    small = sf.iterate(unit, omega, 1, 5, method=method).omega
    orbit = sf.iterate(unit, omega / eps, eps, 5, method=method)
    assert 1e305 < abs(orbit.omega).max() < 1e307
    assert orbit.status == sf.Status.SUPERCRITICAL
    assert (orbit.omega * eps == small).all()


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("method", ["canonical", "ds2"])
def test_overflow_of_one_component(method, swapped):
    """One component overflows although t < 1, since I1 and I2 are far apart; the other does not."""
    body, omega = sf.Suslov3D(1, 2.0**-66, 0, 1), np.array([2.0**997, 2.0**997])
    if swapped:
        body, omega = sf.Suslov3D(2.0**-66, 1, 1, 0), omega[::-1] * [1, -1]
    eps = 2.0**-1063
    assert abs(sf.criticality(body, omega, eps)) < 0.6
    alone = sf.iterate(body, omega, eps, 60, method=method, on_singular="ignore")
    assert alone.status == sf.Status.NONFINITE
    assert np.isnan(alone.final).all()
    assert np.isnan(alone.omega[alone.failed_at :]).all()
    assert np.isfinite(alone.omega[: alone.failed_at]).all()
    guarded = [2.0**990, 2.0**1000][:: -1 if swapped else 1]
    batch = sf.iterate(body, [omega, guarded], eps, 60, method=method, on_singular="ignore")
    assert np.array_equal(batch.omega[:, 0], alone.omega, equal_nan=True)


def test_raise(unit):
    """The error carries the run and survives pickling."""
    with pytest.raises(sf.SingularStepError, match="1 of 2 trajectories: singular step") as caught:
        sf.iterate(unit, [HEALTHY, ON_THE_POLE], 1, 4, on_singular="raise")
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value)
    assert again.trajectories.status.tolist() == [0, -1]
    assert np.isfinite(again.trajectories.omega[:, 0]).all()


def test_status_messages():
    assert {status.name for status in sf.Status} == {
        "OK", "SUPERCRITICAL", "SINGULAR", "NONFINITE",
    }  # fmt: skip
    assert all(status.message for status in sf.Status)
    assert all((status < 0) == ("step:" in status.message) for status in sf.Status)


@pytest.mark.parametrize("method", ["auto", "canonical"])
@pytest.mark.parametrize("save_every", [1, 7, None])
def test_skipped_trajectories_are_detected(body, monkeypatch, method, save_every):
    monkeypatch.setattr(threads, "run", lambda *arguments: None)
    with pytest.raises(RuntimeError, match="a kernel skipped trajectories"):
        sf.iterate(body, [1.0, 0.5], 0.2, 100, method=method, save_every=save_every)
