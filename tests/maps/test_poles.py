"""Steps over a pole, from a state with det A < 0, are told; nothing else is."""

import math
import re
import warnings

import numpy as np
import pytest
from systems import HENON_HEILES as HENON, PREY

import suslov_fast as sf
from suslov_fast import Field, IntegrationWarning, Status, SuslovND, iterate, kahan

quiet = pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")
SQUARE = Field.from_terms([[[1]]])  # x' = x**2: 1 / x decreases by eps in a step
ESCAPES = [0.0, 0.9, 0.0, 0.7]  # a state whose motion ends at t = 3.27
BOUNDED = [0.0, 0.1, 0.4, 0.0]
LONG_BODY = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
LINEAR = Field.from_terms([[[0]]], [[3]])


def told(call, *arguments, **options):
    """Return the result of a call, and the messages of its warnings, all of poles."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = call(*arguments, **options)
    assert all(each.category is IntegrationWarning for each in caught)
    return found, [str(each.message) for each in caught]


def beyond(*conditions):
    """Return the number of the first state after a step where conditions (steps, B) hold, or -1."""
    holds = np.logical_or.reduce(conditions)
    return np.where(holds.any(axis=0), holds.argmax(axis=0) + 1, -1)


def random_fields(rng, D, B):
    """Return fields, of which many lack terms or half of the coefficients, and step sizes."""
    some, most = rng.random((3, B)) < 0.7, 0.5 if D > 1 else 1.0
    tables = [rng.normal(size=(B, *(D,) * k)) for k in (3, 2, 1)]
    tables = [
        each * (rng.random(each.shape[1:]) < most) * k.reshape(B, *(1,) * (each.ndim - 1))
        for each, k in zip(tables, some, strict=True)
    ]
    return Field.from_terms(*tables), rng.uniform(0.05, 3, B) * rng.choice([-1, 1], B)


# ------------------------------------------------------------------------------- what is a finding
def changed(field, x):
    """Whether components changed their signs whose equations have no nonzero term without them."""
    indices, values = field.terms
    lacking = np.zeros((x.shape[1], field.dimension), bool)
    for (i, j, k), v in zip(indices.T, values.T, strict=True):
        lacking[:, i] |= (v != 0) & (j != i) & (k != i)
    return ((x[1:] * x[:-1] < 0) & ~lacking).any(axis=-1)


def random_bodies(rng, D, B):
    bodies = SuslovND(J=rng.uniform(0.5, 4, (B, D)), I=rng.uniform(-1, 1, (B, D)))
    return bodies, rng.uniform(0.1, 3, B) * rng.choice([-1, 1], B)


@pytest.mark.sampled(3)
@quiet
@pytest.mark.parametrize("D", [2, 3, 5, 6, pytest.param(9, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("systems", "method"),
    [(random_fields, "auto"), (random_bodies, "auto"), (random_bodies, "gauss")],
)
def test_statuses_are_signs_of_determinants(rng, systems, method, D):
    """Or of components; counted by NumPy along the saved states, at steps that are far too long."""
    system, eps = systems(rng, D, 60)
    x = rng.normal(size=(60, D)) * (3 if systems is random_bodies else 1)
    run = iterate(system, x, eps, 25, method=method, on_singular="ignore")
    good = run.status >= 0
    negative = np.linalg.det(kahan.matrix(system, run.states[:-1], eps)[:, good]) < 0
    signs = changed(system, run.states)[:, good] if systems is random_fields else negative
    first = beyond(negative, signs)
    assert (run.failed_at[good] == first).all()
    assert (run.status[good] == np.where(first > 0, Status.PASSED_POLE, Status.OK)).all()
    assert len({*run.status[good]}) == 2


@pytest.mark.parametrize("c", [1, -1])
def test_rows_that_are_exchanged_change_no_sign(c):
    """At eps = 2 the first pivot of A = [[0, -1], [-c, 1]] is 0, and the determinant -c."""
    field = Field(lambda x: (x[0] + x[1], c * x[0]), 2)
    back = np.array([[2.0, 1.0], [c, 1.0]])  # A for -eps
    run, texts = told(iterate, field, [1.0, 0.5], 2.0, 3)
    np.testing.assert_allclose(
        run.states[1], np.linalg.solve([[0, -1], [-c, 1]], back @ run.states[0])
    )
    assert (len(texts), run.first_pole) == ((1, 1) if c > 0 else (0, -1))
    exponents, texts = told(sf.lyapunov_exponents, field, [1.0, 0.5], 2.0, 3)
    assert len(texts) == (c > 0)
    assert 2 * exponents.sum() == pytest.approx(np.log(abs(np.linalg.det(back))), abs=1e-14)


def test_the_number_of_the_step_is_the_time_of_escape():
    """x' = x**2 + a."""
    for a, x, eps in ((0.0, 1.0, 0.03), (1.0, 0.0, 0.01), (1.0, -5.0, 0.002), (4.0, 1.0, 0.01)):
        root = math.sqrt(a)
        end = (math.pi / 2 - math.atan(x / root)) / root if a else 1 / x
        run, messages = told(iterate, Field.from_terms([[[1]]], None, [a]), [x], eps, 2000)
        assert run.status == Status.PASSED_POLE
        assert 0 <= run.failed_at - end / eps < 2
        assert len(messages) == 1


def test_the_last_state_is_not_looked_at():
    """No step is taken from it; a longer run finds it, and tells."""
    run = iterate(SQUARE, [1.0], 0.03, 33)
    assert (run.status, run.failed_at) == (Status.OK, -1)
    longer, messages = told(iterate, SQUARE, [1.0], 0.03, 34)
    assert (longer.status, longer.failed_at) == (Status.PASSED_POLE, 34)
    assert len(messages) == 1


# ------------------------------------------------------------------------------------ what is said
DECAY = Field(lambda x: (-2000 * x[0],), 1)
SIX, THREE = np.tile(BOUNDED, (2, 3, 1)), np.tile([0.05, 0.05], (3, 1))
SIX[1, 1:] = ESCAPES
# A run, the numbers of its one warning, and a word of the cause.
SAID = {
    "some escape": ((HENON, SIX, 1 / 16, 400), "2 of 6 (1, 1) 52 3.25", "escapes"),
    # The energy of a body is constant; a linear motion is there at all times.
    "a body": ((LONG_BODY, [1.0, 2.0, 30.0], 1.0, 50), "1 of 1 0 1", "too long$"),
    "linear": ((LINEAR, [1.0], 1.0, 50), "1 of 1 0 1", "too long$"),
    "a sign": ((DECAY, [1.0], 0.01, 5), "1 of 1 0 1", "change its sign"),
    "failures, too": ((PREY, THREE, 0.1, 1000), "3 of 3 0 100 3", "had passed a pole before"),
}


@pytest.mark.parametrize("name", SAID)
def test_one_warning_for_all(name):
    problem, numbers, cause = SAID[name]
    run, (message,) = told(iterate, *problem)
    parts = re.compile(r"\(\d, \d\)|\d[.\d]*(?: of \d)?")
    assert parts.findall(message) == parts.findall(numbers)
    assert re.search(cause, message)
    if run.ok.all():
        assert told(sf.lyapunov_exponents, *problem)[1] == [message]


def test_what_says_nothing():
    given = HENON, ESCAPES, 1 / 16, 100
    run, messages = told(iterate, *given, on_singular="ignore")
    assert messages == []
    assert run.status == Status.PASSED_POLE
    # An error is for failures alone.
    assert len(told(iterate, *given, on_singular="raise")[1]) == 1
    # In three dimensions SUPERCRITICAL tells.
    for body in (sf.Suslov3D(1, 1, 1, 0), sf.Suslov3D(1, 1, 1, 0, 0.5)):
        run = iterate(body, [1.0, -9.0], 1.0, 20)
        assert (run.status, run.failed_at) == (Status.SUPERCRITICAL, -1)
        assert told(iterate, body.field(), [1.0, -9.0], 1.0, 20)[0].status == Status.PASSED_POLE


def test_a_failure_has_a_status_of_its_own():
    """The warning of poles comes before the error."""
    field = Field(lambda x: (x[0] ** 2, x[1] ** 2), 2)
    pole = iterate(SQUARE, [4.0], -0.25, 11).final[0]  # its next states end after 12 steps
    starts = [[0.7, 0.0], [0.7, pole], [0.05, pole], [0.05, 0.0]]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with pytest.raises(
            sf.SingularStepError, match=r"^2 of 4 .* 1 at step 12; 1 of them"
        ) as error:
            iterate(field, starts, 0.25, 20, on_singular="raise")
    (warning,) = caught
    assert str(warning.message).startswith(
        "1 of 4 trajectories passed a pole (first: trajectory 0 at "
    )
    run = error.value.trajectories
    assert run.status.tolist() == [Status.PASSED_POLE, Status.SINGULAR, Status.SINGULAR, Status.OK]
    assert run.failed_at.tolist() == [6, 12, 12, -1]


# ---------------------------------------------------------------- components that keep their signs
def test_a_failure_does_not_hide_the_pole_before_it():
    run = iterate(PREY, THREE, 0.1, 1000, on_singular="ignore")
    assert (run.status == Status.SINGULAR).all()
    assert run.failed_at.tolist() == [100] * 3
    assert run.first_pole.tolist() == [17] * 3
    assert run.valid.sum(axis=0).tolist() == [17] * 3
    assert abs(run.states[run.valid]).max() < 60
    few = iterate(PREY, [0.05, 0.05], 0.1, 1000, save_every=10, on_singular="ignore")
    assert few.valid.sum() == 2
    body = SuslovND(J=[2, 2], I=[0, 0])
    alive = iterate(body, [np.nan, 0.0], 0.1, 3, on_singular="ignore")
    assert alive.first_pole == -1
    assert not alive.valid.any()


@quiet
def test_signs_in_steps_of_several_stages(rng):
    method = "order4"
    fields = Field(lambda x, s: (-60 * x[0], s - 60 * x[1]), 2, s=[0.0, 1.0])
    x = rng.uniform(0.5, 1, (13, 2, 2))
    for eps in (0.12, 0.2):
        run = iterate(fields, x, eps, 9, method=method)
        alone = Field.from_terms([[[0]]], [[-60]])
        if sf.kahan.multipliers(alone, [0.0], eps, method=method)[0].real < 0:
            assert (run.first_pole[:, 0] == 1).all()
        assert (run.first_pole[0] == iterate(fields, x[0], eps, 9, method=method).first_pole).all()
    prey = iterate(
        PREY, rng.uniform(0.05, 4, (40, 2)), 0.25, 60, method=method, on_singular="ignore"
    )
    first = beyond(changed(PREY, prey.states))
    assert (prey.first_pole == first)[first >= 0].mean() > 0.9
    assert ((first == -1) | (prey.first_pole >= 0) & (prey.first_pole <= first)).all()
    assert (first >= 0).any()


@quiet
def test_components_of_one_sign_are_those_of_the_member(rng):
    """Of a family some members have a source, and their components may change their signs."""
    source = np.array([0.0, 0.3] * 10)
    fields = Field(lambda x, s: (s - 9 * x[0], x[0] - x[1]), 2, s=source)
    run = iterate(fields, [1.0, 0.5], 0.5, 20)
    assert ((run.first_pole == 1) == (source == 0)).all()
    assert (run.states[:, 1::2, 0].min(axis=0) < 0).all()


@quiet
def test_zeros_and_negative_components_keep_their_signs(rng):
    """0 stays 0, an underflow is no change of sign, and what is negative may not rise above 0."""
    for x, first in (([0.0, 1.0], -1), ([-1.0, 1.0], 1), ([1.0, 0.0], 1), ([0.0, 0.0], -1)):
        field = Field(lambda x: (-50 * x[0], -0.5 * x[1]), 2)
        assert iterate(field, x, 0.1, 5).first_pole == first, x
    fading = Field.from_terms([[[0]]], [[-1.9999]])
    assert iterate(fading, [[-1.0], [1.0]], 1.0, 400).first_pole.tolist() == [-1, -1]
    assert abs(iterate(fading, [[-1.0], [1.0]], 1.0, 400).final).max() < 1e-300
    tiny = Field.from_terms([[[0]]], [[-3]])
    assert iterate(tiny, [[-1e-300], [1e-300]], 1.0, 1).first_pole.tolist() == [1, 1]
