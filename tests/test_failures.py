"""Poles and overflow, and the warnings and errors about them."""

import dataclasses
import itertools
import pickle

import naive
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import threads

# No body has the I3 of some runs of the scheme in three components.
pytestmark = pytest.mark.filterwarnings("ignore:I3")
METHODS = ("auto", "canonical", "ds2")

# With the body `unit` and eps = 1: X**2 = Omega1**2 / 2 and Y = -Omega2 / 2.
ON_THE_POLE = [1.0, -3.0]
UNDEFINED = [0.0, -2.0]
HEALTHY = [0.3, 0.1]


@pytest.mark.parametrize("along", [1, 2])
@pytest.mark.parametrize("rounded", [False, True])
def test_poles(rng, along, rounded):
    """On the parabola y = 2a/eps + eps x**2, the denominator is a rounding error, and so zero."""
    I, x = np.meshgrid([1.0, 2.0, 3.0, 5.0], [0.5, 1.0, 3.0, 10.0, 1e3, 1e5])
    if rounded:
        I, x = rng.uniform(0.5, 4, I.shape), 10 ** rng.uniform(-2, 5, I.shape)
    body = sf.Suslov3D(I, 1, 1, 0) if along == 1 else sf.Suslov3D(1, I, 0, 1)
    omega = np.stack([x, -(2 * I + x * x)], axis=-1)
    omega = omega if along == 1 else -omega[..., ::-1]
    for method in METHODS:
        result = sf.iterate(body, omega, 1, 3, method=method, on_singular="ignore")
        failed = result.status == sf.Status.SINGULAR
        assert (result.failed_at == np.where(failed, 1, -1)).all()
        if method != "auto" or not rounded:
            assert failed.all()
        for k in np.argwhere(~failed):  # the closed form finds some states of rounded ones
            parameters = [np.broadcast_to(each, I.shape)[tuple(k)] for each in body.parameters]
            exact = naive.step(*parameters, 1, omega[tuple(k)])
            assert naive.relative_error(result.omega[(1, *k)], exact) < 0.5
    with pytest.warns(sf.SingularStepWarning, match="singular step"):
        assert np.isnan(sf.step_full(body, np.insert(omega, 2, 0.0, axis=-1), 1, 3)).all()
    for function, *steps in ((sf.jacobian,), (sf.lyapunov_exponents, 1)):
        with pytest.warns(sf.SingularStepWarning):
            assert np.isnan(function(body, omega, 1, *steps)).all()


def test_poles_in_n_dimensions(rng):
    """A pivot of the size of its rounding errors counts as zero; a larger one does not."""
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
    omega = [[0.0, -2.0 * (1 - 2.0**-k)] for k in (40, 50, 51, 52)]
    for method in ("auto", "canonical"):
        result = sf.iterate(unit, omega, 1, 5, method=method)
        assert (result.status == sf.Status.OK).all()
        assert (result.omega == omega).all()


@pytest.mark.parametrize("method", METHODS)
def test_supercritical_orbits(unit, method):
    """Orbits with |Y| >= 1 are supercritical; the identity (I13 = I23 = 0) never is."""
    omega = np.array([[1e-3, each] for each in (-3.0, -2.5, -1.99, 0.0, 1.99, 2.0, 2.5, 300.0)])
    status = sf.iterate(unit, omega, 1, 2, method=method).status
    assert status.tolist() == [1, 1, 0, 0, 0, 1, 1, 1]
    still = sf.Suslov3D(1, 1, 0, 0)
    assert (sf.iterate(still, omega * 1e9, 1, 2, method=method).status == 0).all()


@pytest.mark.parametrize("method", METHODS)
def test_overflow(body, unit, method):
    """Division by an overflowed denominator does not give 0."""
    large = [[1e200, 1e200], [1e160, 0.5], [1e155, 1e155], [-1e300, 1e290], [1e200, 0]]
    for each in (body, unit):
        with pytest.warns(sf.SingularStepWarning, match="5 of 6 trajectories: non-finite step"):
            result = sf.iterate(each, [*large, HEALTHY], 1, 5, method=method)
        assert result.status.tolist() == [sf.Status.NONFINITE] * 5 + [sf.Status.OK]
        assert result.failed_at.tolist() == [1] * 5 + [-1]
        assert np.isnan(result.omega[1:, :5]).all()
        assert (result.omega[:, 5] == sf.iterate(each, HEALTHY, 1, 5, method=method).omega).all()


def test_the_closed_form_beyond_float64(unit):
    """For overflowing squares, `exact` warns and returns NaN, and `iterate` saves no infinity."""
    with pytest.warns(RuntimeWarning, match="1 of 2 states: beyond the range of float64"):
        states = sf.exact(unit, [[1e200, 0.0], HEALTHY], 1, 1)
    assert np.isnan(states[0]).all()
    body = sf.Suslov3D(1, 1e-20, 0, 1)
    orbit = sf.iterate(body, [-1e300, 1e305], 5e-321, 60, on_singular="ignore")
    last = sf.iterate(body, [-1e300, 1e305], 5e-321, 60, save_every=None, on_singular="ignore")
    assert not np.isinf(orbit.omega).any()
    assert orbit.status == last.status
    assert orbit.ok == bool(np.isfinite(orbit.omega).all())


@pytest.mark.parametrize("save_every", [1, 2, None])
@pytest.mark.parametrize("method", METHODS)
def test_failures_in_a_batch(unit, method, save_every):
    """One warning has both kinds of failures, and names trajectories by their indices."""
    omega, options = np.tile(HEALTHY, (3, 4, 1)), {"method": method, "save_every": save_every}
    omega[1, 2], omega[2, 0], omega[0, 3] = ON_THE_POLE, UNDEFINED, [1e200, 0]
    with pytest.warns(sf.SingularStepWarning) as caught:
        result = sf.iterate(unit, omega, 1, 10, **options)
    assert str(caught[0].message) == (
        "2 of 12 trajectories: singular step, first: (1, 2) at step 1; "
        "1 of 12 trajectories: non-finite step, first: (0, 3) at step 1"
    )
    failed = result.failed_at == 1
    assert np.argwhere(failed).tolist() == [[0, 3], [1, 2], [2, 0]]
    assert result.status[failed].tolist() == [-2, -1, -1]
    assert not result.ok
    assert np.isnan(result.final[failed]).all()
    if save_every:
        assert (result.omega[0] == omega).all()
        assert np.isnan(result.omega[1:, failed]).all()
    healthy = sf.iterate(unit, HEALTHY, 1, 10, **options)
    assert (result.omega[:, ~failed] == healthy.omega[:, np.newaxis]).all()


# States and step sizes whose next state overflows in one component, the other, or both: next to
# poles with X of the order of 1, small X and large X.
OVERFLOWING = [
    ([0.1, -2.01], 3e-12, 1e-298), ([1.0, -3.0], 1e-11, 1e-298), ([16.0, -258.0], 2e-8, 1e-298),
    ([1e-3, -2 - 1e-6], 2e-14, 1e-298), ([1e3, -2 - 1e6], 2e-3, 1e-295),
]  # fmt: skip


@pytest.mark.parametrize("save_every", [1, 2, None])
@pytest.mark.parametrize("method", METHODS)
def test_overflow_of_an_intermediate_state(unit, method, save_every):
    """An orbit ends at a state beyond float64, even if later states would be in range."""
    for (near, gap, eps), *signs in itertools.product(OVERFLOWING, *[(1, -1)] * 3):
        omega = np.add(near, [0, signs[0] * gap]) / eps * signs[1:]
        result = sf.iterate(
            unit, omega, eps * signs[2], 5,
            method=method, save_every=save_every, on_singular="ignore",
        )  # fmt: skip
        assert result.status == sf.Status.NONFINITE
        assert result.failed_at == 1
        assert np.isnan(result.final).all()


def test_the_first_of_several_states_beyond_float64(unit):
    omega, unit_of_omega = np.array([0.5, -9.0]), 2.0**1019
    exact = naive.orbit(1, 1, 1, 0, 1, omega, 9)
    beyond = [max(map(abs, state)) * unit_of_omega > 2**1024 for state in exact]
    options = {"save_every": None, "on_singular": "ignore"}
    run = sf.iterate(unit, omega * unit_of_omega, 1 / unit_of_omega, 60, **options)
    assert run.status == sf.Status.NONFINITE
    assert run.failed_at == beyond.index(True)
    assert sum(beyond) > 1


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


@pytest.mark.parametrize("method", ["auto", "canonical"])
@pytest.mark.parametrize("save_every", [1, 7, None])
def test_skipped_trajectories_are_detected(body, monkeypatch, method, save_every):
    monkeypatch.setattr(threads, "call_kernel", lambda *arguments: None)
    with pytest.raises(RuntimeError, match="a kernel skipped trajectories"):
        sf.iterate(body, [1.0, 0.5], 0.2, 100, method=method, save_every=save_every)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class OfUser(sf.Suslov3D):
    """A body of a user, whose constructor is generated in this module."""


UNIT, FOUR = sf.Suslov3D(1, 1, 1, 0), sf.SuslovND([2, 2, 2, 3], [1, 0, 0.5, 0.25])
TRIPLE, BAD = [*ON_THE_POLE, 0.0], {"I1": 4, "I2": 2, "I13": -0.5, "I23": -0.3, "I3": 20}
WARNING_CALLS = {
    "step": lambda: sf.step(UNIT, ON_THE_POLE, 1),
    "iterate": lambda: sf.iterate(UNIT, ON_THE_POLE, 1, 2),
    "extend": lambda: sf.iterate(UNIT, ON_THE_POLE, 1, 0).extend(1),
    "step_full": lambda: sf.step_full(UNIT, TRIPLE, 1, 2.0),
    "step_full with I3": lambda: sf.step_full(UNIT, [0.1, 0.1, 0.0], 1, I3=9.0),
    "iterate_full": lambda: sf.iterate_full(UNIT, TRIPLE, 1, 1, 2.0),
    "jacobian": lambda: sf.jacobian(UNIT, ON_THE_POLE, 1),
    "jacobian of n": lambda: sf.jacobian(FOUR, [2, 1, 3, 2], 1.0),
    "reaction": lambda: sf.reaction(UNIT, ON_THE_POLE, 1),
    "reaction of n": lambda: sf.reaction(FOUR, [2, 1, 3, 2], 1.0),
    "run.reaction": lambda: sf.iterate(UNIT, ON_THE_POLE, 1, 0).reaction(),
    "lyapunov_exponents": lambda: sf.lyapunov_exponents(UNIT, ON_THE_POLE, 1, 1),
    "exact": lambda: sf.exact(UNIT, [0.5, -9.0], 1, 2.5),
    "a body": lambda: sf.Suslov3D(**BAD),
    "a body of a user": lambda: OfUser(**BAD),
    "replace": lambda: dataclasses.replace(sf.Suslov3D(4, 2, -0.5, -0.3), I3=20),
    "from_dict": lambda: sf.Suslov3D.from_dict({"body": "Suslov3D", **BAD}),
    "body_from_dict": lambda: sf.body_from_dict({"body": "SuslovGyrostat", "k": 1, **BAD}),
}


@pytest.mark.filterwarnings("default:I3")
@pytest.mark.parametrize("name", WARNING_CALLS)
def test_warnings_point_at_the_line_of_the_user(name):
    with pytest.warns((UserWarning, RuntimeWarning)) as caught:
        WARNING_CALLS[name]()
    lines = WARNING_CALLS[name].__code__
    assert {(each.filename, each.lineno) for each in caught} == {(__file__, lines.co_firstlineno)}
