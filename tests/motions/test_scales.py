"""Components of very different sizes, and rates near the ends of the range of numbers."""

import numpy as np
import pytest
from scipy.linalg import expm
from systems import field, van_der_pol

import suslov_fast as sf


@pytest.mark.parametrize(("rtol", "unit"), [(1e-4, 1e-14), (1e-6, 1e-3), (1e-9, 1e-8)])
def test_a_component_beside_others_in_other_units(rtol, unit):
    """An oscillator of the size `unit` beside a temperature in kelvins that nothing depends on."""
    f = field(lambda s: (s[1], -s[0] - 0.1 * s[0] ** 3 / unit**2, -0.01 * s[2]), "x v T")
    alone = field(lambda s: (s[1], -s[0] - 0.1 * s[0] ** 3), "x v")
    both = sf.flow(f, [unit, 0.0, 300.0], time=20.0, rtol=rtol).states[0]
    exact = sf.flow(alone, [1.0, 0.0], time=20.0, rtol=1e-12).states[0]
    np.testing.assert_allclose(both[:2] / unit, exact, atol=100 * rtol)


@pytest.mark.parametrize("rate", [1e100, 1e300])
def test_decay_at_rates_whose_squares_overflow(rate):
    f = field(lambda s: (-rate * s[0], -s[1]), "x y")
    motion = sf.flow(f, [1.0, 1.0], time=[1.0, 2.0])
    np.testing.assert_allclose(motion.states[:, 1], np.exp([-1.0, -2.0]), rtol=1e-8)
    assert (abs(motion.states[:, 0]) < 1e-9).all()
    assert motion.steps < 2000


# ------------------------------------------------------ f that is rounded as coarsely as its clocks
@pytest.mark.parametrize("stiff", [None, True])
def test_ramps_of_any_width(stiff):
    """x' = ramp - x from rest, where the ramp goes from 0 to 1 around t = 1."""
    widths = 10.0 ** -np.arange(1, 16)

    def ramp(s, w):
        return np.clip((s[1] - 1 + w) / (2 * w), 0, 1) - s[0], 1.0

    def table(w):
        return field(lambda s: (np.interp(s[1], [1 - w, 1 + w], [0, 1]) - s[0], 1.0), "x t")

    fields = [(field(ramp, "x t", w=widths), widths), *((table(w), w) for w in widths[[0, 8, 14]])]
    for f, width in fields:
        exact = 1 - np.exp(-2.0) * np.sinh(width) / width
        for start in (0.0, 0.3, -7.0):
            motion = sf.flow(f, [0.0, start], time=3.0 - start, stiff=stiff)
            np.testing.assert_allclose(motion.states[0, ..., 0], exact, rtol=3e-8)
            assert (motion.steps < 150).all()


def test_what_decays_for_good_and_what_flows_in_is_not_told_of():
    decays = field(lambda s: (-s[0], s[0] - 20 * s[1], -1e4 * s[2]), "x y z")
    sf.flow(decays, [1.0, 0.0, 1.0], time=[10.0, 100.0])
    doses = field(
        lambda s: (np.where(np.mod(s[1], 24.0) < 0.5, 10.0, 0.0) - 1.5 * s[0], 1.0), "c t"
    )
    sf.flow(doses, [0.0, 0.0], time=[100.0, 240.0])
    sf.flow(field(lambda s: (s[1], -s[0]), "x v"), [1.0, 0.0], time=np.linspace(0.0, 50.0, 200))


TURNS = np.array([[0, 0.3, 0.7], [1.57, -0.43, 0], [-0.92, 0, 0.22], [0.1, 0.2, 0.3]]) / 2
TURNING = field(
    lambda q, a, b, c: (
        -a * q[1] - b * q[2] - c * q[3],
        a * q[0] + c * q[2] - b * q[3],
        b * q[0] - c * q[1] + a * q[3],
        c * q[0] + b * q[1] - a * q[2],
    ),
    "w x y z",
    **dict(zip("abc", TURNS.T, strict=True)),
)
SHORT = sf.Event(times=[1e-9], to=lambda q: tuple(q))  # after it steps begin anew, short ones


@pytest.mark.parametrize(
    "options", [{}, {"stiff": True}, {"derivatives": "x0"}, {"events": SHORT}, {"max_step": 0.3}]
)
def test_components_that_are_0_but_for_rounding(options):
    """Quaternions that turn about fixed axes; rates of one component of the first three cancel."""
    times, angles = np.linspace(0, 20, 41)[:, np.newaxis], np.linalg.norm(TURNS, axis=1)
    motion = sf.flow(TURNING, [1, 0, 0, 0], time=times[:, 0], **options)
    axes = np.sin(angles * times)[..., np.newaxis] * TURNS / angles[:, np.newaxis]
    right = np.concatenate([np.cos(angles * times)[..., np.newaxis], axes], axis=-1)
    np.testing.assert_allclose(motion.states, right, atol=1e-8)
    assert (motion.steps < 200).all()
    for k in range(4):  # which look at more states than the last one, in the same line
        alone = sf.flow(TURNING[k], [1, 0, 0, 0], time=times[:, 0], **options)
        np.testing.assert_array_equal(alone.states, motion.states[:, k])


@pytest.mark.parametrize("options", [{}, {"stiff": True}, {"rtol": 1e-11}])
def test_a_rate_that_is_rounding_beside_a_relaxation(options):
    """e' is 0 but for rounding; trajectories look for that at steps of their own."""

    def rates(s, k):
        return *van_der_pol(s, k), k * (1 - s[0] ** 2) * s[1] - k * s[1] + k * s[0] ** 2 * s[1]

    cycles = field(rates, "x v e", k=np.linspace(1.0, 40.0, 8))
    motion = sf.flow(cycles, [2.0, 0.0, 0.0], time=30.0, **options)
    assert (abs(motion.states[..., 2]) < 2e-13).all()
    assert (motion.steps < 4000).all()
    for k in range(8):
        alone = sf.flow(cycles[k], [2.0, 0.0, 0.0], time=30.0, **options)
        np.testing.assert_array_equal(alone.states, motion.states[:, k])


# --------------------------------------------------------- symmetric states, which are rounded
@pytest.mark.sampled(4)
@pytest.mark.parametrize("kind", ["heat", "waves", "Schroedinger"])
@pytest.mark.parametrize("D", [8, 20, 64])
def test_components_that_are_0_by_symmetry(kind, D):
    """One wave on a ring, whose second differences have terms that cancel up to rounding."""
    one, none = np.eye(D), np.zeros((D, D))
    matrix = D**2 * (np.roll(one, 1, axis=0) + np.roll(one, -1, axis=0) - 2 * one)
    L, time = {
        "heat": (matrix, 1.0),
        "waves": (np.block([[none, one], [matrix, none]]), 1.0),
        "Schroedinger": (np.block([[none, -matrix], [matrix, none]]), 0.1),
    }[kind]
    start, near = np.zeros(len(L)), [np.flatnonzero(row) for row in L]
    start[:D] = np.cos(2 * np.pi * np.arange(D) / D)
    f = field(lambda u: [sum(L[i, j] * u[j] for j in near[i]) for i in range(len(L))], len(L))
    motion = sf.flow(f, start, time=time)
    np.testing.assert_allclose(motion.states[0], expm(time * L) @ start, atol=3e-7)
    assert motion.steps < 1500
