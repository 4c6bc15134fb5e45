"""Equations M(x) x' = f(x), beside np.linalg.solve and SciPy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import suslov_fast as sf
from suslov_fast import Field, flow


def links(lengths, masses, relative=False, gain=0.0):
    """Return M and f of links in a plane, by absolute angles, or by those of joints with motors."""
    n, l = len(lengths), np.array(lengths)
    above = np.array([[np.sum(masses[max(i, j) :]) for j in range(n)] for i in range(n)])
    T = np.tril(np.ones((n, n))) if relative else np.eye(n)
    zero = np.zeros((n, n))

    def mass(x):
        q = T @ x[:n]
        M = above * np.outer(l, l) * np.cos(q[:, np.newaxis] - q)
        return np.block([[np.eye(n), zero], [zero, T.T @ M @ T]])

    def f(x, g):
        q, v = T @ x[:n], T @ x[n:]
        turns = above * np.outer(l, l) * np.sin(q[:, np.newaxis] - q)
        force = -(turns @ v**2) - g * l * np.diag(above) * np.sin(q)
        return np.concatenate([x[n:], T.T @ force - gain * (x[:n] + 0.3 * x[n:])])

    return mass, f


SYSTEMS = {
    "double pendulum": links([1.0, 0.7], [1.0, 2.0]),
    "robot arm": links([0.5, 0.4, 0.2], [3.0, 2.0, 0.5], relative=True, gain=20.0),
    "chain of 4": links([1.0] * 4, [1.0] * 4),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", SYSTEMS)
def test_mechanisms_beside_scipy(name):
    mass, f = SYSTEMS[name]
    D = {"d": 4, "r": 6, "c": 8}[name[0]]

    def rates(_, x):
        return np.linalg.solve(mass(x), f(x, 9.81))

    field = Field(f, D, mass=mass, g=9.81)
    x = np.random.default_rng(D).normal(size=(7, D)) * 0.4
    expected = np.array([rates(0.0, each) for each in x])
    np.testing.assert_allclose(field(x), expected, rtol=1e-11, atol=1e-11)
    step = 1e-6 * np.eye(D)
    slopes = np.stack([field(x[0] + h) - field(x[0] - h) for h in step], axis=-1) / 2e-6
    assert abs(field.jacobian(x[0]) - slopes).max() < 1e-7 * abs(slopes).max()
    motion = flow(field, x[0], time=2.0, rtol=1e-12)
    solved = solve_ivp(rates, (0, 2), x[0], method="DOP853", rtol=1e-12, atol=1e-13)
    assert abs(motion.states - solved.y[:, -1]).max() < 1e-9


def test_families_by_parameters_of_both_functions():
    field = Field(
        lambda x, k: (x[1], -k * x[0]),
        "q v",
        mass=lambda x, m: [[1, 0], [0, m + x[0] ** 2]],
        k=2.0,
        m=[1.0, 3.0],
    )
    np.testing.assert_allclose(field([0.5, 1.0]), [[1, -0.8], [1, -1 / 3.25]], rtol=1e-15)
    np.testing.assert_allclose(field.with_parameters(m=0.75)([0.5, 1.0]), [1.0, -1.0])
    plain = Field(lambda x, mass: (-x[0] / mass,), 1, mass=[1.0, 2.0])
    np.testing.assert_array_equal(plain([2.0]), [[-2.0], [-1.0]])


def test_terms_that_cancel_at_most_states():
    """In Cramer's rule x1 x3 - x3 x1 is the first numerator, unless x0 is large."""

    def right(x):
        return np.where(x[0] > 50, 2, 1) * x[1], x[3], 0 * x[0], 0 * x[0]

    def mass(x):
        return [[x[0], x[1], 0, 0], [x[2], x[3], 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]

    field = Field(right, 4, mass=mass)
    np.testing.assert_allclose(field([40.0, 1.0, 2.0, 3.0]), [0, 1, 0, 0], atol=1e-15)
    x = np.array([60.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(field(x), np.linalg.solve(mass(x), right(x)), rtol=1e-14)


def test_matrices_of_numbers_and_those_that_are_not_symmetric():
    M = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 1.0]])
    f = lambda s: (-s[0], np.sin(s[2]) - s[1], 1.0)  # noqa: E731
    x = np.array([0.3, -0.4, 0.5])
    for mass in (M, lambda s: M):
        field = Field(f, "x y t", mass=mass)
        np.testing.assert_allclose(field(x), np.linalg.solve(M, f(x)), rtol=1e-14)
        with pytest.warns(UserWarning, match="t was held"):
            assert sf.equilibria(field, near=x).states[2] == 0.5  # the time remains a clock

    def turning(s):  # no pivot on its diagonal is a number other than 0
        return np.array([[0, 1 + s[1] ** 2, 0], [np.exp(s[0]), s[1], 0], [s[0], 0, 1]])

    def equal(s):  # two columns begin equal: the second pivot on the diagonal would be rounding
        a, b, c = 1.3 + np.sin(s)
        return np.array([[a, a, c], [b, b, a], [c, b, 4.0]])

    for mass in (turning, equal):
        field = Field(f, "x y t", mass=mass)
        np.testing.assert_allclose(field(x), np.linalg.solve(mass(x), f(x)), rtol=1e-14)


REGULAR = {  # everywhere, or where the determinant is not 0, though entries change their signs
    "indefinite": (lambda s: [[s[0] - 1, 1], [1, s[0]]], ([1.0, 2.0], [1.0 + 1e-13, 2.0])),
    "rotation": (lambda s: [[np.cos(s[0]), np.sin(s[0])], [-np.sin(s[0]), np.cos(s[0])]],
                 ([0.0, 1.0], [np.pi / 2, 1.0], [np.pi, 1.0])),
    "skew": (lambda s: [[0, s[0], s[1], 1], [-s[0], 0, 2, s[2]], [-s[1], -2, 0, s[3]],
                        [-1, -s[2], -s[3], 0]], ([0.0, 0.0, 0.0, 0.0], [1.0, -1.0, 0.5, 0.0])),
    "three": (lambda s: np.add(np.outer(s, s), [[s[0], s[1], 0], [0, s[2], s[0]], [s[1], 0, s[2]]]),
              ([1.0, -1.0, 2.0], [0.0, 1.0, 1.0], [-1.0, 0.5, 0.5])),
}  # fmt: skip


@pytest.mark.parametrize("name", REGULAR)
def test_matrices_that_are_regular_where_a_pivot_would_be_0(name):
    mass, states = REGULAR[name]
    field = Field(lambda s: 1.0 + s**2, len(states[0]), mass=mass)
    for x in states:
        x = np.array(x)
        expected = np.linalg.solve(np.array(mass(x), float), 1.0 + x**2)
        np.testing.assert_allclose(field(x), expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        ([[1.0, 2.0], [2.0, 4.0]], "has an inverse"),
        (lambda x: np.outer(np.sin(x), x), "has an inverse"),
        (lambda x: [[x[0], x[1]], [-x[0], -x[1]]], "has an inverse"),
        (np.eye(3), r"shape \(2, 2\)"),
        (lambda x: [[1, 0], [0, np.random.default_rng().normal()]], "two calls"),
        (lambda x, m: [[m, 0], [0, 1]], "m=1.0"),
    ],
)
def test_matrices_that_are_refused(mass, message):
    with pytest.raises((TypeError, ValueError), match=message):
        Field(lambda x: (x[1], -x[0]), 2, mass=mass)
