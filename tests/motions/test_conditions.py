"""Motions of equations that choose: steps end where a condition changes, and sliding ends them."""

from itertools import islice, pairwise

import numpy as np
import pytest
from systems import field

import suslov_fast as sf
from suslov_fast.core.flow import batch_solver
from suslov_fast.core.flow.single_steps import attempts

BENT = field(lambda s, a: (s[1], -s[0] - a * abs(s[0])), "x v", a=0.5)


def relaxed(c, time, knots, heights):
    """Return c after a time of either sign, where c' = np.interp(t, knots, heights) - c from 0."""
    inside = knots[(knots > min(time, 0.0)) & (knots < max(time, 0.0))]
    ends = [0.0, *inside[:: 1 if time > 0.0 else -1], time]
    for a, b in pairwise(ends):
        k = np.searchsorted(knots, min(a, b), "right") - 1
        slope = 0.0
        if 0 <= k < len(knots) - 1:
            slope = (heights[k + 1] - heights[k]) / (knots[k + 1] - knots[k])
        k = max(k, 0)
        height, lost = heights[k] + slope * (a - knots[k]), -np.expm1(a - b)
        c += lost * (height - c) + slope * (b - a - lost)
    return c


def dosed(knots, heights):
    return field(lambda s: (np.interp(s[1], knots, heights) - s[0], 1.0), "c t")


def test_what_a_step_computes_does_not_depend_on_the_number_of_knots(rng):
    knots, heights = rng.uniform(0.0, [[10.0], [1.0]], (2, 6001))
    knots.sort()
    many, few = dosed(knots, heights), dosed(knots[:3], heights[:3])
    for name in ("f", "derivative", "watch"):
        lists = [getattr(each._right_hand_sides[0].f, name) for each in (many, few)]
        assert len(lists[0].operations) == len(lists[1].operations) < 30
    motion = sf.flow(many, [0.0, 0.0], time=10.0)
    np.testing.assert_allclose(motion.states[0, 0], relaxed(0.0, 10.0, knots, heights), rtol=1e-12)
    assert motion.steps < 6200
    assert sf.Field.from_dict(many.to_dict()) == many
    # Few steps are tried in vain before one that ends on a knot.
    f, table = many._right_hand_sides[0].f, many._right_hand_sides[0].table
    settings = batch_solver.Settings(1e-9)
    *_, (_, steps, _) = islice(attempts(f, table, np.zeros(2), 10.0, settings), 300)
    assert steps >= 50


@pytest.mark.parametrize("time", [4.0, -3.0])
def test_tables_with_steep_and_level_parts(time, rng):
    """One begins on a knot; ramps last 1e-9 or one rounding; a part is constant."""
    knots = np.array([-4.0, -2.5, -1.0, 0.0, 0.5, 1.0, 2.0, 3.0])
    knots = np.sort([*knots, 0.5 + 1e-9, -1.0 + 1e-9, *np.nextafter([2.0, -2.5], 9.0)])
    for _ in range(3):
        heights = rng.normal(size=len(knots))
        heights[-2:] = heights[-3]
        motion = sf.flow(dosed(knots, heights), [1.0, 0.0], time=time, rtol=1e-12)
        c = relaxed(1.0, time, knots, heights)
        np.testing.assert_allclose(motion.states[0, 0], c, rtol=1e-11, atol=1e-11)
        assert motion.steps < 200


def test_a_table_is_level_beyond_its_knots_also_at_infinity():
    # log(0) and 1/0 at the start; left and right are jumps.
    f = field(
        lambda s: (
            np.interp(np.log(s[1]), [0.0, 1.0], [3.0, 5.0]),
            np.interp(1 / s[1], [1.0, 2.0], [1.0, 1.0], left=0.5, right=2.0),
        ),
        "x y",
    )
    (end,) = sf.flow(f, [0.0, 0.0], time=1.0, rtol=1e-12).states
    # y' = 2 up to y = 1/2, then 1 up to y = 1, at t = 3/4, then 1/2 up to 9/8.
    y = 9 / 8
    np.testing.assert_allclose(end, [3.0 + 4.0 * (y * np.log(y) - y + 1.0), y], rtol=1e-11)


def test_a_potential_of_straight_lines():
    # The force jumps at knots; between them q is a parabola.
    q = np.linspace(-3.0, 3.0, 13)
    system = sf.Field.from_hamiltonian(lambda s: s[1] ** 2 / 2 + np.interp(s[0], q, abs(q)), "q p")
    motion = sf.flow(system, [1.25, 0.0], time=[np.sqrt(10.0), 4 * np.sqrt(10.0)], rtol=1e-12)
    np.testing.assert_allclose(motion.states, [[-1.25, 0.0], [1.25, 0.0]], atol=1e-10)
    period = 4 * np.sqrt(2.5)  # of q from rest is in proportion to its root
    slope = sf.flow(system, [1.25, 0.0], time=period, derivatives="x0", rtol=1e-12).derivatives[
        "x0"
    ]
    np.testing.assert_allclose(slope[0], [[1.0, 0.0], [period / 2.5, 1.0]], atol=1e-9)


def test_kinks_keep_the_digits_of_the_tolerance():
    # Half a period with the square of the rate 1.5, half a one with 0.5.
    period = np.pi / np.sqrt(1.5) + np.pi / np.sqrt(0.5)
    for rtol in (1e-6, 1e-9, 1e-12):
        motion = sf.flow(BENT, [2.0, 0.0], time=10 * period, rtol=rtol)
        np.testing.assert_allclose(motion.states[0], [2.0, 0.0], atol=20 * rtol)
    assert motion.steps < 400
    # A relaxation whose fast variable stays near the kink.
    fast = field(lambda s: (-1e6 * (s[0] - np.cos(s[1])), 1 + 0.1 * abs(s[0] - np.cos(s[1]))), 2)
    motion = sf.flow(fast, [1.0, 0.0], time=100 * np.pi)
    np.testing.assert_allclose(motion.states[0, 1] - 100 * np.pi, 2e-5, rtol=0.1)
    assert motion.steps < 4000


def test_a_kink_that_is_only_touched_costs_little():
    touching = field(lambda s: (s[1], -s[0], np.maximum(s[0], 1.0)), "x v y")
    smooth = field(lambda s: (s[1], -s[0], 1.0 + 0 * s[0]), "x v y")
    motions = [sf.flow(f, [1.0, 0.0, 0.0], time=50.0) for f in (touching, smooth)]
    np.testing.assert_allclose(motions[0].states, motions[1].states, atol=1e-9)
    assert motions[0].steps <= motions[1].steps + 40


# ------------------------------------------------------------------------------- derivatives


@pytest.mark.parametrize(
    "power", [lambda q: np.maximum(q, 0.0) ** 1.5, lambda q: np.sign(q) * np.abs(q) ** 1.5]
)
def test_a_kink_beyond_which_its_branch_has_no_value(power):
    """The equation of Lane and Emden, n = 3/2, whose zero is known (Horedt 1986): q^1.5 ends there.

    It begins at 1/10, by the series of q = 1 - r^2/6 + n r^4/120 - ...
    """
    star = field(lambda s: (s[1], -2 * s[1] / s[2] - power(s[0]), 1.0), "q v r")
    r, n = 0.1, 1.5
    a = (-1 / 6, n / 120, -n * (8 * n - 5) / 15120, n * (122 * n**2 - 183 * n + 70) / 3265920)
    q = 1 + sum(each * r ** (2 * k) for k, each in enumerate(a, start=1))
    v = sum(2 * k * each * r ** (2 * k - 1) for k, each in enumerate(a, start=1))
    zero = sf.crossings(star, [q, v, r], surface="q", time=4.9, direction=-1, rtol=1e-11)
    assert zero.ok.all()
    np.testing.assert_allclose(zero.time + r, [3.65375373622], rtol=2e-10)
    run = sf.flow(star, [q, v, r], time=4.9, rtol=1e-11, derivatives="x0")
    assert run.ok.all()
    assert run.states[0, 0] < 0
    assert np.isfinite(run.derivatives["x0"]).all()


def test_a_tank_drains_until_it_is_empty():
    """h' = -sqrt(h): h = (1 - t/2)^2 until t = 2."""
    drained = field(lambda h: -np.sqrt(np.maximum(h, 0.0)), "h")
    np.testing.assert_allclose(
        sf.flow(drained, 1.0, time=[1.0, 1.9, 4.0]).states[:, 0], [0.25, 0.0025, 0.0], atol=5e-9
    )
    back = field(lambda h: -np.sign(h) * np.sqrt(np.abs(h)), "h")  # from both sides to 0
    with pytest.warns(sf.IntegrationWarning, match="slide"):
        motion = sf.flow(back, 1.0, time=[1.9, 4.0])
    np.testing.assert_allclose(motion.states[0], 0.0025, atol=5e-9)
    np.testing.assert_allclose(motion.end, 2.0, atol=1e-5)
    assert motion.steps < 200
