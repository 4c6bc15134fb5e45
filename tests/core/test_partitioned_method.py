"""Columns where variables fall into two sets: which f have them, their order, and errors."""

import numpy as np
import pytest
from systems import kepler, pendulum, rates_of_henon_heiles

from suslov_fast import Field, flow
from suslov_fast.core.expressions.partitioned import sets_of


def sets(field):
    """Return the sets of a field, None if it has Gragg's columns."""
    _, f, _ = field._right_hand_sides[0]
    return sets_of(f)


# f, and of each variable the set: those in q are what a column has after an even number of
# sub-steps; + is in both.
SETS = {
    "two degrees of freedom": (
        lambda s: (s[2], s[3], -s[0] - 2 * s[0] * s[1], s[1] ** 2 - s[0] ** 2),
        "qqpp",
    ),
    "a clock of one set": (lambda s: (s[1], np.cos(s[2]) - s[0], 1.0), "qpq"),
    "a clock of both": (lambda s: (s[1] * np.cos(s[2]), s[2] - s[0], 1.0), "pq+"),
    "a clock of none": (lambda s: (s[1], -s[0], 1.0), "qpp"),
    "Kepler's problem": (lambda s: (s[2], s[3], *(-s[:2] / np.hypot(s[0], s[1]) ** 3)), "qqpp"),
    "populations in logarithms": (lambda s: (1 - np.exp(s[1]), np.exp(s[0]) - 1), "qp"),
}
GRAGG = {
    "friction": lambda s: (s[1], -s[0] - 0.1 * s[1]),
    "a jump": lambda s: (s[1], np.where(s[0] > 0.0, -1.0, 1.0)),
    "a table": lambda s: (s[1], -np.interp(s[0], [-1.0, 0.0, 2.0], [-1.0, 0.0, 5.0])),
    "a Gaussian": lambda s: (s[1], s[0] * np.exp(-(s[0] ** 2))),
    "a pulse in time": lambda s: (s[1], np.exp(-((s[2] - 3.0) ** 2)), 1.0),
    "a thin layer": lambda s: (s[1], -s[0] / np.sqrt(s[0] ** 2 + 1e-8)),
    "a resonance": lambda s: (s[1], -s[0] / (s[0] ** 2 + 1e-8)),
    "roots in both sets": lambda s: (s[1] / np.sqrt(1 + s[1] ** 2), -s[0] / np.sqrt(1 + s[0] ** 2)),
    "a cube root": lambda s: (s[1], -np.cbrt(s[0])),
    "no sets": lambda s: (s[1], s[2], s[0]),
}


def test_which_fields_have_sets():
    for f, where in SETS.values():
        first, second = sets(Field(f, len(where)))
        assert [i for i, kind in enumerate(where) if kind in "q+"] == first
        assert [i for i, kind in enumerate(where) if kind in "p+"] == second
    for name, f in GRAGG.items():
        D = 3 if name in ("a pulse in time", "no sets") else 2
        assert sets(Field(f, D)) is None, name


def test_the_derivative_of_a_distance_is_no_branch():
    """It is 0 where the distance is 0; f from H takes the steps of the form with a root."""

    def field(distance):
        return Field.from_hamiltonian(
            lambda z: (z[2] ** 2 + z[3] ** 2) / 2 - 1 / distance(z[0], z[1]), "x y u v"
        )

    one, other = field(np.hypot), field(lambda x, y: np.sqrt(x**2 + y**2))
    assert sets(one) == sets(other) == ([0, 1], [2, 3])
    one, other = (flow(f, [0.4, 0, 0, 2], time=20.0) for f in (one, other))
    np.testing.assert_allclose(one.states, other.states, rtol=1e-8)
    assert one.steps == other.steps
    spring = Field(lambda z: (z[1], -z[0] * np.hypot(z[0], z[1])), 2)
    np.testing.assert_array_equal(spring.jacobian([0.0, 0.0]), [[0, 1], [0, 0]])


STATES = np.random.default_rng(3).uniform(-0.25, 0.25, (20, 4))


def test_the_order_is_ten():
    field, errors = Field(rates_of_henon_heiles, 4), []
    right = flow(field, STATES, time=12.0, rtol=1e-13).states[-1]
    for h in (0.8, 0.4):
        run = flow(field, STATES, time=12.0, rtol=1e-2, max_step=h)
        assert run.steps.max() <= 12.0 / h + 6
        errors.append(np.median(abs(run.states[-1] - right).max(axis=-1)))
    assert 9.0 < np.log2(errors[0] / errors[1]) < 12.0


def toda(s):
    n = len(s) // 2
    e = [np.exp(s[i] - s[(i + 1) % n]) for i in range(n)]
    return (*s[n:], *(e[i - 1] - e[i] for i in range(n)))


ANGLES = np.linspace(0.0, 6.0, 20)
R, B = 1.0 - 0.9 * np.cos(ANGLES), np.sqrt(1.0 - 0.9**2)
PROBLEMS = {
    "pendulum": (pendulum, np.random.default_rng(1).uniform(-2.0, 2.0, (20, 2))),
    "close passages": (  # of eccentricity 0.9
        kepler,
        np.stack(
            [np.cos(ANGLES) - 0.9, B * np.sin(ANGLES), -np.sin(ANGLES) / R, B * np.cos(ANGLES) / R],
            -1,
        ),
    ),
    "toda": (toda, np.random.default_rng(2).uniform(-0.5, 0.5, (20, 8))),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_errors_beside_those_of_gragg(name):
    f, x0 = PROBLEMS[name]
    D, times = x0.shape[1], np.linspace(0.1, 8.0, 47)
    # The first rate has a term 0 of its own variable, so that there are no sets.
    field, gragg = Field(f, D), Field(lambda s, a: f(s) + a * s * np.eye(D)[0], D, a=0.0)
    assert sets(field) is not None
    assert sets(gragg) is None
    for sign in (1, -1):
        right = flow(gragg, x0, time=sign * times, rtol=1e-13, max_step=0.2).states
        for rtol in (1e-4, 1e-7, 1e-10):
            a, b = (flow(own, x0, time=sign * times, rtol=rtol) for own in (field, gragg))
            errors = [abs(run.states - right).max(axis=(0, 2)) for run in (a, b)]
            assert np.median(errors[0]) < 3.0 * np.median(errors[1]) + 10.0 * rtol
            assert errors[0].max() < 3.0 * errors[1].max() + 10.0 * rtol
            assert a.steps.mean() < 1.6 * b.steps.mean()


@pytest.mark.parametrize("stiff", [None, True])
def test_fast_springs(stiff):
    """A motion at rest beside one with a million times its rate turns implicit, and stays right."""
    field = Field(lambda s: (s[2], s[3], -s[0], -1e12 * (s[1] - s[0])), "x y p q")
    assert sets(field) is not None
    run = flow(field, [1.0, 1.0, 0.0, 0.0], time=3.0, rtol=1e-6, atol=1e-6, stiff=stiff)
    np.testing.assert_allclose(run.states[-1, :2], np.cos(3.0), atol=1e-4)
    assert run.steps < 20_000
