"""Steps and closed form of bodies and gyrostats: one table, then what holds to the bit."""

from typing import NamedTuple

import naive
import numpy as np
import pytest
from children import TWO_THREADS
from numba import config
from promises import same

import suslov_fast as sf
from suslov_fast.core.numba import decorators
from suslov_fast.core.numba.status_codes import NONFINITE, OK, SINGULAR, SUPERCRITICAL
from suslov_fast.core.suslov import steps as steps_3d


class Problem(NamedTuple):
    """The tolerance is relative to the largest state of the orbit."""

    parameters: tuple  # I1, I2, I13, I23, and k of a rotor
    omega: tuple
    eps: float
    steps: int
    tolerance: float = 1e-14

    def body(self):
        return sf.Suslov3D(*self.parameters)

    def orbit(self, omega, steps):
        """The next states, in 60 digits."""
        *inertia, k = (*self.parameters, 0)[:5]
        return np.array(naive.orbit(*inertia, self.eps, omega, steps, k), float)


FIGURE, ROTOR = (4, 1, -0.5, -0.3), (2.3, 1.4, 0.5, -0.7)
UNIT = 1.0, 1.0, 1.0, 0.0  # X = eps Omega1 / 2 and Y = -eps Omega2 / 2
PROBLEMS = {
    "figure 1": Problem(FIGURE, (1.0, 0.5), 0.2, 60),
    "figure 1, backwards": Problem(FIGURE, (1.0, 0.5), -0.2, 60),
    "figure 2": Problem((4, 3, -0.4, -0.2), (1.5, 0.25), 0.2, 60),
    "figure 3": Problem((4, 2, 0, -0.2), (1.5, 0.25), 0.02, 60),
    "figure 4, T > 1": Problem((3, 3, -0.2, -0.2), (-40.0, -250.0), 1.0, 12, 1e-13),
    "long step, x < 0": Problem(FIGURE, (-1.0, -0.5), 4.0, 30),
    "small step": Problem(FIGURE, (1.0, 0.5), 1e-9, 40),
    "next to the line": Problem((2.0, 1.0, 0.0, 0.5), (1.5, 1e-9), 1.0, 60),
    "next to the line on its other side": Problem((2.0, 1.0, 0.0, 0.5), (-1.5, 1e-9), 1.0, 40),
    "at rest": Problem(UNIT, (0.0, 1.5), 0.5, 20, 0.0),
    "next to the critical line": Problem(UNIT, (1e-3, -0.999999), 2.0, 60),
    "T = 1": Problem(UNIT, (0.25, -1.0), 2.0, 2),
    "T = 1, collapse": Problem(UNIT, (0.25, 1.0), 2.0, 3),
    "large X": Problem(UNIT, (1e3, 0.5), 2.0, 8, 1e-13),
    "large X and Y": Problem(UNIT, (300.0, -2000.0), 1.0, 8, 1e-13),
    "next to a pole": Problem(UNIT, (1.0, -3.001), 1.0, 6, 1e-12),
    "moments far apart": Problem((1e-8, 1e8, 0.3, 0.2), (1.0, 1.0), 1e-4, 30, 1e-13),
    "no products of inertia": Problem((3, 2, 0, 0), (1.0, -2.0), 0.3, 10, 0.0),
    "no step": Problem(FIGURE, (1.0, 0.5), 0.0, 10, 0.0),
    "rotor, passes": Problem((*ROTOR, 0.05), (1.1, -0.4), 0.35, 60),
    "rotor, k next to A": Problem((*ROTOR, 0.9), (1.1, -0.4), 0.35, 60),
    "rotor, turns": Problem((*ROTOR, -3.0), (1.1, -0.4), -0.35, 60, 3e-14),
    "rotor, tiny": Problem((*ROTOR, 1e-9), (1.1, -0.4), 0.35, 60),
    "rotor, T > 1": Problem((*ROTOR, 0.3), (11.0, -4.0), 3.0, 12, 1e-12),
    "rotor, turns fast": Problem((*ROTOR, 300.0), (1.1, -0.4), 2.0, 60, 1e-13),
    "rotor alone, turns": Problem((2.0, 3.0, 0.0, 0.0, 1.5), (1.0, 1.0), 0.3, 60, 3e-14),
    "rotor, at rest": Problem((1, 1, 1, 0, 0.5), (-0.5, 0.75), 0.5, 20, 0.0),
}


def assert_close(states, orbit, tolerance):
    size = np.linalg.norm(orbit, axis=-1).max()
    assert np.linalg.norm(states - orbit, axis=-1).max() <= tolerance * size


@pytest.mark.parametrize("name", PROBLEMS)
def test_steps_closed_form_and_limits(name):
    problem = PROBLEMS[name]
    body, (_, omega, eps, steps, tolerance) = problem.body(), problem
    orbit = problem.orbit(omega, steps)
    found = sf.iterate(body, omega, eps, steps)
    assert_close(found.states, orbit, tolerance)
    for state in orbit[:3]:
        assert_close([state, sf.step(body, state, eps)], problem.orbit(state, 1), tolerance)
    final = sf.iterate(body, [omega] * 20, eps, steps, save_every=None).final
    assert (final == found.final).all()
    states = body.exact(omega, eps, found.n)
    assert_close(states, orbit, tolerance)
    assert (states[0] == omega).all()
    limits = np.array(body.limits(omega, eps))
    assert np.isnan(limits).any() == ("turns" in name)
    if "T = 1" in name:
        return  # state 0 is lost in a collapse
    assert_close(body.exact(omega, -eps, -found.n), orbit, tolerance)
    if eps and "turns" not in name:
        far = body.exact(omega, eps, [-(10**12), 10**12])
        assert_close(far, limits, 1e-5 if name == "small step" else 1e-14)


def test_three_components():
    """Equations (3), whose third says that Omega3 changes sign."""
    parameters, omega = (2.3, 1.4, 0.5, -0.7), [0.3, -0.8, 1.7]
    for eps, I3 in ((0.3, 1.8), (-2.0, 2.3)):
        exact = naive.step_full(*parameters, eps, I3, omega)
        following = sf.Suslov3D(*parameters).step_full(omega, eps, I3)
        assert naive.relative_error(following, exact) < 1e-14


# ------------------------------------------------------------------------------- to the bit
@pytest.fixture
def mixture(rng):
    """A batch of bodies and gyrostats of all kinds: body, states and eps."""
    B = 300
    I1, I2 = rng.uniform(1, 4, (2, B))
    I13, I23 = rng.uniform(-0.9, 0.9, (2, B))
    k, eps = rng.choice([0, 0, 0.05, 2.0], B), rng.choice([0.05, 0.3, 3.0, -0.3, 0.0], B)
    omega = rng.uniform(-2, 2, (B, 2))
    omega[7, 1], omega[8] = np.nan, np.nan
    I13[20:40], omega[20:40, 1], k[20:40] = 0.0, 0.0, 0.0  # at rest
    I13[40:44] = I23[40:44] = 0.0
    omega[50:53] *= [[1e100], [1e160], [1e200]]
    omega[60:90], k[60:90] = np.stack([I23, -I13], -1)[60:90], 0.0  # many have l = 0 in floats, too
    return sf.Suslov3D(I1, I2, I13, I23, k), omega, eps


def run(body, omega, eps, steps, save_every=1):
    return sf.iterate(body, omega, eps, steps, save_every=save_every, on_singular="ignore")


@pytest.mark.parametrize("size", [1, 3, steps_3d.FEW, steps_3d.FEW + 1, steps_3d.LANES + 1])
def test_parts_of_a_batch_change_no_bit(mixture, size):
    """A few trajectories are stepped one by one, others in blocks; all are restored at times."""
    whole = run(*mixture, 560, 7)
    for first in range(0, 300 - size, 145 if config.DISABLE_JIT else 29):
        some = slice(first, first + size)
        part = run(*(each[some] for each in mixture), 560, 7)
        results = whole.final, whole.status, whole.failed_at
        expected = whole.states[:, some], *(each[some] for each in results)
        same([part.states, part.final, part.status, part.failed_at], expected)


@pytest.mark.compiled
@pytest.mark.filterwarnings("ignore")  # of missing states
@pytest.mark.parametrize("size", [241, 242, 243, 297, 298, 299, 300])
def test_large_outputs(mixture, size, monkeypatch):
    """They leave past the caches, in whole cache lines, which begin within a trajectory.

    Of 241 and 242 trajectories the last block has 1 and 2, fewer than fill a line.
    """
    whole = [each[:size] for each in mixture]
    n, parts = np.arange(2200), np.array_split(np.arange(size), 3)
    few = [[each[part] for each in whole] for part in parts]
    states = np.concatenate([run(*each, 2200).states for each in few], 1)
    if not config.BOUNDSCHECK:  # with it parts run one after the other
        monkeypatch.setattr(decorators, "in_parts", None)
    for threads in (1, TWO_THREADS):
        saved = sf.iterate(*whole, 2200, threads=threads, on_singular="ignore").states
        same([saved], [states])
    exact = sf.Suslov3D.exact
    same([exact(*whole, n)], [np.concatenate([exact(*each, n) for each in few], 1)])


def test_statuses():
    """For eps = 2, the denominator is 1 + Omega2 + 2 Omega1**2. The first failure counts."""
    before = np.array(naive.step(1, 1, 1, 0, -2.0, (1.0, -3.0)), float)
    table = (
        ([1.0, -3.0], SINGULAR, 1),  # a pole
        (before, SINGULAR, 2),
        ([0.0, -1.0], SINGULAR, 1),  # 0 / 0
        ([0.0, -0.5], OK, -1),  # at rest
        ([0.5, 0.25], OK, -1),
        ([0.5, -7.0], SUPERCRITICAL, -1),
        ([1e200, 3.0], NONFINITE, 1),  # squares overflow
        ([np.nan, 1.0], NONFINITE, 0),
    )
    omega, status, failed_at = map(np.array, zip(*table, strict=True))
    found = run(sf.Suslov3D(*UNIT), omega, 2.0, 9)
    same([found.status, found.failed_at], [status, failed_at])
    assert np.isnan(found.states[2:, status < 0]).all()
    assert np.isfinite(found.states[:, status >= 0]).all()


@pytest.mark.compiled
@pytest.mark.sampled(1)
@pytest.mark.parametrize("k", [0.0, 1e-3, 0.3, 2.0, 30.0])
def test_F_over_a_million_steps(rng, k):
    I1, I2 = rng.uniform(1, 4, (2, 40))
    I13, I23 = rng.uniform(-0.9, 0.9, (2, 40))
    eps, omega = rng.choice([0.05, 0.3, -0.3, 3.0], 40), rng.uniform(-2, 2, (40, 2))
    body = sf.Suslov3D(I1, I2, I13, I23, k)
    final = run(body, omega, eps, 10**6, None).final
    before, after = body.first_integral([omega, final], eps)
    assert abs(after / before - 1).max() < 1e-12


def test_X_that_grows_is_never_flushed():
    """From a distance of 1e-160 to the line an orbit leaves it; towards it, X becomes 0."""
    body, omega = sf.Suslov3D(*UNIT), np.array([[1e-160, -0.9], [1e-160, 0.9]])
    saved = run(body, omega, 1.0, 500).states
    assert abs(saved[:, 0, 0]).max() > 0.1
    assert saved[-1, 1, 0] == 0.0
    with pytest.warns(RuntimeWarning, match="range"):
        states = body.exact(omega, 1.0, np.arange(501))
    assert np.isnan(states[2:, 0]).all()
    np.testing.assert_allclose(saved[:, 1], states[:, 1], atol=1e-13)
    omega = omega + np.array([1e-120, 0])
    states = body.exact(omega, 1.0, np.arange(501))
    np.testing.assert_allclose(run(body, omega, 1.0, 500).states, states, atol=1e-11)


def test_a_decayed_X_is_0_from_the_same_step_on_wherever_a_run_ends():
    """Runs of last states test at some steps only whether X has decayed."""
    fast = np.linspace(0.9, 0.99, 128)  # with X = Omega1 and Y = -Omega2, whose rates differ
    body, omega = sf.Suslov3D(*UNIT), np.stack([fast / 9, fast], axis=-1)
    saved = run(body, omega, 2.0, 140).states
    assert len({*(saved[..., 0] == 0.0).argmax(axis=0)}) > 16
    for n in range(60, 140, 7):
        same([run(body, omega, 2.0, n, None).final], [saved[n]])


@pytest.mark.parametrize(
    "omega", [[1e3, 1e10], [1e10, 1e25], [1e16, -1e35], [1e61, 0.1], [1e90, -1e91]]
)
def test_huge_states_without_a_rotor_are_right(omega):
    with naive.mp.workdps(400):
        exact = naive.orbit(*UNIT, 1, omega, 9)[-1]
    end = run(sf.Suslov3D(*UNIT), omega, 1.0, 9, None)
    assert end.status >= 0
    assert naive.relative_error(end.final, exact) < 1e-13


@pytest.mark.parametrize("size", [1e-100, 1e-155, 1e-200, 1e-290])
def test_small_states(size):
    """What counts as 0 is relative to the state: a body hardly moves, a rotor turns it as it is."""
    start = np.array([1.0, 0.5])
    body, omega = sf.Suslov3D(*FIGURE), size * start
    saved = run(body, omega, 0.2, 1200)
    same([saved.states, sf.step(body, omega, 0.2)], [np.tile(omega, (1201, 1)), omega])
    np.testing.assert_allclose(body.exact(omega, 0.2, [-5, 3]), [omega] * 2, rtol=1e-15)
    for k in (0.3, -3.0):
        body = sf.Suslov3D(*ROTOR, k)
        for states in (run(body, omega, 0.2, 1200).states, body.exact(omega, 0.2, saved.n)):
            larger = run(body, 1e-30 * start, 0.2, 1200).states
            np.testing.assert_allclose(states / size, larger / 1e-30, rtol=1e-10, atol=1e-12)


# ---------------------------------------------------------------------- of the closed form
def test_a_parabolic_orbit():
    """|k| = A exactly: both limits are the one steady state, which is met as 1 / n."""
    body = sf.Suslov3D(1, 1, 1, 0, 1.0)
    omega = [0.0, 1.0]  # R = 1 / sqrt(1 + e**2) < k; for the flow A = 1
    np.testing.assert_allclose(sf.flow(body, omega, time=1e9).states, [[-1, 0]], atol=1e-8)


def test_a_rotor_beyond_the_range_has_no_next_state():
    """Where X, Y or K is above 1e8, differences of them have lost their digits."""
    body = sf.Suslov3D(2.0, 1.0, 0.5, -0.3, [1e11, 1e3, -1e11])
    found = run(body, [1.0, 0.5], 0.1, 3)
    assert found.status.tolist() == [NONFINITE, OK, NONFINITE]
    assert found.failed_at.tolist() == [1, -1, 1]
    assert np.isnan(found.states[1:, [0, 2]]).all()
    assert np.isfinite(found.states[:, 1]).all()
    assert np.isfinite(found.states[0]).all()
