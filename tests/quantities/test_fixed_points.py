"""Fixed points of fields, against points that are known in closed form."""

from fractions import Fraction as F
from itertools import product

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import QuadraticField, fixed_points

SQUARES = 2**0.5, 3**0.5, 5**0.5
BIG = 10**56
KNOWN = [
    (lambda x: (x**2 - 2,), [[-SQUARES[0]], [SQUARES[0]]]),
    (lambda x: (x**2 - 10**20 * x + 1,), [[1e-20], [1e20]]),
    (lambda x: (x**2 - F(2, 10**50),), [[-(2**0.5) * 1e-25], [2**0.5 * 1e-25]]),
    (lambda x, y: (y - x**2, F(3, 10**50) - y),
     [[-(3**0.5) * 1e-25, 3e-50], [3**0.5 * 1e-25, 3e-50]]),
    (lambda x: ((x - F(1, 3)) ** 2,), [[1 / 3]]), (lambda x: (2 * x - 3,), [[1.5]]),
    (lambda x: (x**2 - 3 * x,), [[0], [3]]), (lambda x: (x**2 + 2,), []),
    (lambda x: (5 + 0 * x,), []),
    (lambda x, y: (x * (1 - y), y * (x - 1)), [[0, 0], [1, 1]]),
    (lambda x, y: (x + y, x - y + 3), [[-1.5, 1.5]]),
    (lambda x, y: (x + y, x + y + 3), []),
    (lambda x, y: (x**2 - 2, y**2 - x), [[2**0.5, -(2**0.25)], [2**0.5, 2**0.25]]),
    (lambda x, y: (x**2, y**2), [[0, 0]]),  # four times
    (lambda x, y: (x**2 + y**2, -2 * x**2 - 2 * y**2), [[0, 0]]),
    (lambda x, y: (x**2 + y**2 + 1, 3 * x**2 + 3 * y**2 + 3), []),
    (lambda x, y: (y - BIG * x, x**2 - F(1, BIG)), [[-1e-28, -1e28], [1e-28, 1e28]]),
    (lambda x, y, z: (x**2 - 2, y**2 - 3, z**2 - 5),
     [*product(*((-a, a) for a in SQUARES))]),
    (lambda x, y, z: (x**2, y**2, z**2 - x), [[0, 0, 0]]),
    (lambda x, y, z: ((x - 2 * z) ** 2 + (y - 1) ** 2, z, x), [[0, 1, 0]]),
    # Complex lines, which have single real points: a sphere and a plane that touches it.
    (lambda x, y, z: (x**2 + y**2 + z**2 - 1, z - 1, 0 * x), [[0, 0, 1]]),
    (lambda x, y, z: (x**2 + y**2 + z * (z - 1), z * (z - 1), 0 * x),
     [[0, 0, 0], [0, 0, 1]]),
    (lambda x, y, z: (x * y, x * z, y**2 + z**2 + 1 - x), [[1, 0, 0]]),
    (lambda x, y, z: (x * z + y, y * z - x, x**2 + y**2 - z**2 - 1), []),
    (lambda x, y: (x**2 - BIG * y**2, (y - 1) * (y - 2) * BIG),
     [[-2e28, 2], [-1e28, 1], [1e28, 1], [2e28, 2]]),
    (lambda x, y, z: (10 * (y - x), x * (28 - z) - y, x * y - F(8, 3) * z),
     [[-(72**0.5), -(72**0.5), 27], [0, 0, 0], [72**0.5, 72**0.5, 27]]),
]  # fmt: skip


@pytest.mark.parametrize(("f", "expected"), KNOWN)
def test_known_fixed_points(f, expected):
    D = f.__code__.co_argcount
    found = fixed_points(QuadraticField.from_function(lambda x: f(*x), D))
    assert found.shape == (len(expected), D)
    np.testing.assert_array_max_ulp(found, np.reshape(expected, (-1, D)).astype(float), 1)


def test_families_continue_their_points():
    """Points are in the order of as many before, which they continue."""
    a = np.array([-1.0, -0.5, 0.5, 0.75, 2.0])
    family = QuadraticField.from_function(
        lambda x, a: (2 * x[0] - a * (x[1] + 1), x[1] ** 2 - 1), 2, a=a
    )
    found = np.array(fixed_points(family))
    np.testing.assert_array_equal(found[..., 0], np.stack([a, 0 * a], axis=-1))
    np.testing.assert_array_equal(found[..., 1], [[1, -1]] * 5)
    pairs = QuadraticField.from_function(
        lambda x, a, b: ((x[0] ** 2 - a) * 2, x[1] - b), 2, a=[1.0, -1.0, 4.0], b=[0.0, 1.0, 2.0]
    )
    counts = [points.tolist() for points in fixed_points(pairs)]
    assert counts == [[[-1, 0], [1, 0]], [], [[-2, 2], [2, 2]]]
    assert fixed_points(family[:0]) == []


def test_families_with_several_axes():
    """Points continue those of the member to the left, and at the beginning of a row above."""
    a, b = np.array([[0.0], [3.0], [6.0]]), np.array([1.0, -2.0, -5.0])
    family = QuadraticField.from_function(  # points (a, 0) and (b, 10), which pass each other
        lambda x, a, b: ((x[0] - a) * (x[0] - b), x[1] * (b - a) - 10 * (x[0] - a)), 2, a=a, b=b
    )
    found = fixed_points(family)
    assert (found.shape, found.dtype) == ((3, 3), object)
    for i, j in product(range(3), range(3)):
        assert found[i, j].round(9).tolist() == [[a[i, 0], 0], [b[j], 10]]
    assert fixed_points(family[:, :0]).shape == (3, 0)


def test_cases_that_are_refused():
    cases = [
        (QuadraticField(np.ones((4, 4, 4))), "near=x0"),
        (QuadraticField([[[0]]]), "infinitely many fixed points: fixed_points"),
        (QuadraticField(np.zeros((2, 2, 2))), "infinitely many fixed points"),
        (QuadraticField.of(sf.Suslov3D(4, 1, -0.5, -0.3)), "infinitely many fixed points"),
        (sf.Suslov3D(4, 1, -0.5, -0.3), r"infinitely many fixed points.* c \(I23, -I13\)"),
        (sf.SuslovGyrostat(4, 1, -0.5, -0.3, 1), r"infinitely many .* I13 Omega1 \+ .* = -k"),
        (sf.SuslovND([1, 2, 3], [0.1, 0.2, 0.3]), "infinitely many fixed points.* c I"),
        (QuadraticField.from_function(lambda x: (x[0] * x[1], x[0] * (x[1] - 1)), 2), "infinitely"),
    ]  # fmt: skip
    for field, message in cases:
        with pytest.raises(ValueError, match=message):
            fixed_points(field)


def test_members_with_infinitely_many_fixed_points_are_none():
    """One warning names them; the others keep their points."""
    rows = lambda x, a, b: (a * x[0], x[1] - b)  # noqa: E731
    family = QuadraticField.from_function(rows, 2, a=[1.0, 0.0, 2.0, 0.0], b=[1.0, 2.0, 3.0, 4.0])
    message = r"fixed points of member 1 \(a=0.0, b=2.0\), of member 3 .*None.*near=x0"
    with pytest.warns(UserWarning, match=message) as told:
        found = fixed_points(family)
    assert len(told) == 1
    assert [found[1], found[3]] == [None, None]
    assert [found[0].tolist(), found[2].tolist()] == [[[0, 1]], [[0, 3]]]
    grid = QuadraticField.from_function(rows, 2, a=[[1.0], [0.0]], b=[1.0, 2.0])
    with pytest.warns(UserWarning, match=r"member \(1, 0\) \(a=0.0, b=1.0\)"):
        found = fixed_points(grid)
    assert (found[1, 0], found[1, 1], found[0, 1].tolist()) == (None, None, [[0, 2]])
    bodies = sf.Suslov3D([4, 2], 1, -0.5, -0.3)
    with pytest.warns(UserWarning, match=r"member 0 \(I1=4.0, I2=1.0, I13=-0.5, I23=-0.3\)"):
        assert fixed_points(bodies) == [None, None]


def test_points_beyond_the_range_of_numbers():
    field = QuadraticField.from_function(
        lambda x: (1e-60 * x[0] - 1e60 * x[1] ** 2, 1e-60 * x[1] - 1e60), 2
    )  # y = 1e120, x = 1e360
    with pytest.raises(ValueError, match="beyond the range of float64: use other units"):
        fixed_points(field)


def _near(f, near, **parameters):
    return fixed_points(sf.Field.from_function(f, np.shape(near)[-1], **parameters), near=near)


TORQUES = np.array([0.0, 0.3, 0.6, 1.0, 1.2])


def test_equilibria_of_families_and_folds():
    """Of a pendulum with a torque; at torque 1 two of them meet."""
    with pytest.warns(UserWarning, match=r"4 of 10 starts.*\(0, 3\) of member 3 \(m=1.0\)") as told:
        found = _near(
            lambda x, m: (x[1], m - np.sin(x[0]) - 0.1 * x[1]), [[[0.1, 0]], [[0.2, 0]]], m=TORQUES
        )
    assert len(told) == 1
    q = np.arcsin(TORQUES[:3])
    np.testing.assert_allclose(found.states[:, :3, 0], [q, q], atol=1e-14)
    np.testing.assert_allclose(found.states[:, :3, 1], 0.0, atol=1e-14)
    roots = -0.05 + np.sqrt(0.0025 - np.cos(q) + 0j)
    np.testing.assert_allclose(found.eigenvalues[1, :3, 0], roots, rtol=1e-12)
    assert np.isnan(found.states[:, 3:]).all()
    assert np.isnan(found.eigenvalues[:, 3:]).all()
    S = sf.Status
    assert found.status.tolist() == [[S.OK, S.OK, S.OK, S.DEGENERATE, S.NOT_FOUND]] * 2


@pytest.mark.parametrize(
    ("f", "near", "status"),
    [
        (lambda x: (x[0] ** 2,), [0.1], sf.Status.DEGENERATE),
        (lambda x: (x[0] ** 2,), [0.0], sf.Status.DEGENERATE),
        (lambda x: ((x[0] - 1) ** 2, -x[1]), [0.1, 0.2], sf.Status.DEGENERATE),
        (lambda x: (-(x[0] ** 3),), [0.1], sf.Status.DEGENERATE),
        (lambda x: (x[0] - 1, (1e14 * x[1] - 1) ** 2), [1.1, 1.2e-14], sf.Status.DEGENERATE),
        (lambda x: (x[0] ** 2 + 1, -x[1]), [0.1, 0.2], sf.Status.NOT_FOUND),
        (lambda x: (x[1], x[1] + 1), [0.1, 0.2], sf.Status.NOT_FOUND),
        (lambda x: (np.log(x[0]),), [-1.0], sf.Status.NONFINITE),
    ],
)
def test_states_without_a_regular_equilibrium(f, near, status):
    with pytest.warns(UserWarning, match="1 of 1 starts"):
        found = _near(f, near)
    assert found.status == status
    assert np.isnan(found.states).all()


def test_equilibria_that_newton_reaches_from_afar():
    found = _near(lambda x: (np.exp(x[0]) - 1,), [[0.1], [0.0], [5.0], [-3.0], [np.nan]])
    np.testing.assert_allclose(found.states[:, 0], [0, 0, 0, 0, np.nan], atol=1e-15)
    assert found.status.tolist() == [0, 0, 0, 0, sf.Status.NONFINITE]
    assert _near(lambda x: (np.log(x[0]),), [20.0]).states.tolist() == [1.0]
    lorenz = QuadraticField.from_function(
        lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - F(8, 3) * x[2]), 3
    )
    starts = np.random.default_rng(0).normal(size=(30, 3)) * 20
    found = fixed_points(lorenz, near=starts)
    far = abs(found.states[:, np.newaxis] - fixed_points(lorenz)).max(axis=-1).min(axis=-1)
    assert far.max() < 1e-12
    assert not found.status.any()


def test_equilibria_of_components_of_different_sizes():
    """A radical, whose rates k r are as large as others: the last ones were 0.2 to 2 % off."""
    k = np.array([1.0, 1e6, 1e12, 1e15])
    found = _near(
        lambda x, k: (1 - x[0] - k * x[1] * x[0] + x[2] / 2,
                      x[2] / 1000 - k * x[1] * (x[0] + 0.1) / 10,
                      x[0] - 0.9 * x[2] + k * x[1] / 10),
        np.stack([2.24 + 0 * k, 0.0108 / k, 2.4 + 0 * k], axis=-1), k=k,
    )  # fmt: skip
    states = found.states * np.stack([1 + 0 * k, k, 1 + 0 * k], axis=-1)
    np.testing.assert_allclose(states, states[:1] * np.ones((4, 1)), rtol=1e-12)


def _network(power):
    """Concentrations c at equilibrium; a weak link, beside which the fast reaction cancels."""
    c = np.array([1e-2, 1e-12, 3e-16, 0.2, 0.0])

    def f(x):
        a = [x[i] / c[i] for i in range(4)]
        rates = 1e-2 * (1 - a[0]), 1e-17 * (a[0] - a[1]), 1e-2 * power(a[1], a[2]), a[1] - a[3]
        return rates[0] - rates[1], rates[1] - rates[2] - rates[3], 2 * rates[2], rates[3], -x[4]

    return c, f


@pytest.mark.parametrize(
    "rate",
    [
        lambda a, b: a - b**2,
        lambda a, b: a**1.5 - np.sqrt(b),
        lambda a, b: a / (1 + a) - b**3 / (1 + b**3),
        lambda a, b: np.exp(a) * np.log(1 + a) - np.exp(b) * np.log(1 + b),
        lambda a, b: np.minimum(a, 2) - np.maximum(b, 0.1) * abs(b),
    ],
)
def test_equilibria_of_networks_with_weak_links(rate):
    """The last ones were 5 to 30 % off, because f in doubles does not see the link."""
    c, f = _network(rate)
    near = c * [[1.1, 0.8, 1.2, 1.1, 0], [0.9, 1.3, 1.1, 0.8, 0]] + [[0, 0, 0, 0, 1e-9], [0] * 5]
    found = _near(f, near)
    np.testing.assert_allclose(found.states, [c, c], rtol=1e-14, atol=1e-40)
    assert not found.status.any()


def test_what_rounded_numbers_link_is_a_curve():
    """0.2 + 0.7 is not 0.9 in decimals of doubles, but x = 0 is no equilibrium that f tells."""
    k = np.array([0.1, 0.2, 0.7, 0.4])

    def f(x):
        rates = k[0] * x[0] - k[1] * x[1], k[2] * x[1] - k[3] * x[2]
        middle = k[0] * x[0] - (k[1] + k[2]) * x[1] + k[3] * x[2]
        return -rates[0], middle, rates[1]

    for kind in (sf.Field, QuadraticField):
        x = fixed_points(kind.from_function(f, 3), near=[1, 0.7, 0.5]).states
        np.testing.assert_allclose(x / x[0], [1, 0.5, 0.875], rtol=1e-14)
        assert 0.5 < x[0] < 1.5
    fed = _near(lambda x: np.add(f(x), [0.1, 0.2, 0.1 - 0.4]), [1, 0.7, 0.5]).states
    np.testing.assert_allclose(fed, [1.71627907, 0.35813953, -0.12325581], rtol=1e-6)
    with pytest.warns(UserWarning, match="degenerate"):
        assert _near(lambda x: (x[0] - 1, x[1] ** 3), [1.1, 0.0]).status == sf.Status.DEGENERATE


def test_clocks_and_curves_of_equilibria():
    """Clocks keep their values; a conserved sum leaves a curve, of which a near point is found."""
    found = _near(lambda s: (s[1], -np.sin(s[0]) - 0.1 * s[1] + np.sin(s[2]), 1.0), [0.1, 0.0, 0.5])
    np.testing.assert_allclose(found.states, [0.5, 0.0, 0.5], atol=1e-14)
    assert found.eigenvalues.shape == (2,)
    found = _near(lambda x: (1.0,), [3.0])
    assert (found.states.tolist(), found.eigenvalues.shape) == ([3.0], (0,))
    bound = _near(lambda x: (x[2] - 3 * x[0] * x[1],) * 2 + (3 * x[0] * x[1] - x[2],), [1, 1.1, 1])
    a, b, c = bound.states
    assert abs(c - 3 * a * b) < 1e-14
    assert abs(bound.states - [1, 1.1, 1]).max() < 1.0
    assert (abs(bound.eigenvalues) < 1e-14).sum() == 2
    plane = _near(lambda x: [-x[0] * (1 + a * a) for a in x], [0.1, 0, 1.28, 0, 0])
    assert (plane.status, abs(plane.states[0]) < 1e-14) == (sf.Status.OK, True)


def test_steady_states_near_those_of_bodies():
    bodies = sf.Suslov3D([4, 3], 1, -0.5, [-0.3, -0.25])
    found = fixed_points(bodies, near=[[[1.0, 0.5]], [[0.3, -0.2]]])
    assert abs(sf.vector_field(bodies, found.states)).max() < 1e-16
    np.testing.assert_allclose(found.states[0, 0], -0.05 / 0.34 * np.array([-0.3, 0.5]))
    body = sf.SuslovND([1, 2, 3], [0.1, 0.2, 0.3])
    assert abs(sf.vector_field(body, fixed_points(body, near=[1, 0.5, 0.2]).states)).max() < 1e-15
    still = fixed_points(sf.SuslovGyrostat(4, 1, -0.5, -0.3, 0), near=[1.0, 0.5])
    assert still == fixed_points(sf.Suslov3D(4, 1, -0.5, -0.3), near=[1.0, 0.5])
    assert still != found
    rotor = sf.SuslovGyrostat(4, 1, -0.5, -0.3, 1)
    found = fixed_points(rotor, near=[1.0, 0.5])
    assert abs(sf.vector_field(rotor, found.states)).max() < 1e-15
    with pytest.raises(TypeError, match="fixed_points"):
        fixed_points(sf.Field.from_function(lambda x: (np.sin(x[0]),), 1))
