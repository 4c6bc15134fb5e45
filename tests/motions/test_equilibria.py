"""Equilibria of fields, against closed forms and the limits of motions."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from systems import LORENZ

import suslov_fast as sf
from suslov_fast import Field, equilibria


def _near(f, near, **parameters):
    return equilibria(sf.Field(f, np.shape(near)[-1], **parameters), near=near)


TORQUES = np.array([0.0, 0.3, 0.6, 1.0, 1.2])


def test_equilibria_of_families_and_folds():
    """Of a pendulum with a torque; at torque 1 two of them meet."""
    with pytest.warns(UserWarning, match="2 of 10 starts") as told:
        found = _near(
            lambda x, m: (x[1], m - np.sin(x[0]) - 0.1 * x[1]), [[[0.1, 0]], [[0.2, 0]]], m=TORQUES
        )
    for each, where in zip(told, ("4) of member 4 (m=1.2)", "3) of member 3"), strict=True):
        assert where in str(each.message)
    q = np.arcsin(TORQUES[:3])
    np.testing.assert_allclose(found.states[:, :3, 0], [q, q], atol=1e-14)
    np.testing.assert_allclose(found.states[:, 3, 0], np.pi / 2, atol=1e-7)
    np.testing.assert_allclose(found.states[:, :4, 1], 0.0, atol=1e-14)
    roots = -0.05 + np.sqrt(0.0025 - np.cos(q) + 0j)
    np.testing.assert_allclose(found.eigenvalues[1, :3, 0], roots, rtol=1e-12)
    assert np.isnan(found.states[:, 4]).all()
    assert np.isnan(found.eigenvalues[:, 4]).all()
    S = sf.Status
    assert found.status.tolist() == [[S.OK, S.OK, S.OK, S.DEGENERATE, S.NOT_FOUND]] * 2
    assert found.stable.tolist() == [[True, True, True, False, False]] * 2


def test_each_state_once():
    """Of a double well from 400 starts: two minima and a saddle, each with its number of starts."""
    starts = np.random.default_rng(0).uniform(-2, 2, (20, 20, 2))
    found = _near(lambda s: (s[1], s[0] - s[0] ** 3), starts)
    each, count = found.distinct()
    kinds = {round(x[0]): kind for x, kind in zip(each.states, each.kind, strict=True)}
    assert kinds == {-1: "centre", 0: "saddle", 1: "centre"}
    nearest = abs(found.states[..., :1] - each.states[:, 0]).argmin(axis=-1)
    assert count.tolist() == np.bincount(nearest.ravel()).tolist()
    assert repr(found) == "Equilibria(400 starts: 400 OK, 3 different states)"
    assert found._repr_html_().count("<tr>") == 4


@pytest.mark.parametrize(
    ("matrix", "of_motion", "of_map"),
    [
        ([[-0.5, 0.2], [0, -0.3]], "attracting node", "attracting node"),
        ([[-0.5, 0.2], [-0.2, -0.5]], "attracting focus", "attracting focus"),
        ([[0.5, 0.2], [-0.2, 0.5]], "repelling focus", "attracting focus"),
        ([[3.0, 0.2], [0, 2.0]], "repelling node", "repelling node"),
        ([[3.0, 0.2], [0, -0.5]], "saddle", "saddle"),
        ([[0.6, -0.8], [0.8, 0.6]], "repelling focus", "centre"),
        ([[0.0, -0.8], [0.5, 0.0]], "centre", "attracting focus"),
        (np.diag([-0.5, -0.4, -0.3]), "attracting", "attracting"),
        (np.diag([1.5, 1.4, 1.3]), "repelling", "repelling"),
    ],
)
def test_kinds_of_equilibria(matrix, of_motion, of_map):
    D = len(matrix)
    for system, kind in ((sf.Field, of_motion), (sf.Map, of_map)):
        found = equilibria(system(lambda x: np.array(matrix) @ x, D), near=np.ones(D))
        assert (found.kind, found.stable) == (kind, kind.startswith("attracting"))


def test_a_map_that_keeps_a_sum():
    """The multiplier 1 belongs to the sum; the other one is -0.3, whatever the entries are."""
    found = equilibria(sf.Map(lambda x: np.array([[-1.5, -1.2], [2.5, 2.2]]) @ x, 2), near=[1, 2])
    assert found.stable


@pytest.mark.parametrize(
    ("f", "near", "right", "digits"),
    [
        (lambda x: (x[0] ** 2,), [0.1], [0.0], 1e-7),
        (lambda x: ((x[0] - 1) ** 2, -x[1]), [0.1, 0.2], [1.0, 0.0], 1e-7),
        (lambda x: (-(x[0] ** 3),), [0.1], [0.0], 1e-5),
        (lambda x: (x[0] - 1, (1e14 * x[1] - 1) ** 2), [1.1, 1.2e-14], [1.0, 1e-14], 1e-21),
        (lambda s: (-s[0] * s[1] / 2,) * 2 + (s[0] * s[1] / 2,), [2, 2, 2], [0, 0, 4], 1e-7),
    ],
)
def test_multiple_roots(f, near, right, digits):
    with pytest.warns(UserWarning, match="multiple root") as told:
        found = _near(f, near)
    assert len(told) == 1
    assert found.status == sf.Status.DEGENERATE
    assert (found.stable, found.kind) == (False, "neutral")
    assert (abs(found.states - right)[-1:] <= digits).all()
    assert abs(found.states - right).max() <= max(digits, 1e-7)


def test_totals_are_kept():
    enzyme = _near(
        lambda x: (-x[0] * x[1] + x[2], -x[0] * x[1] + 2 * x[2], x[0] * x[1] - 2 * x[2], x[2]),
        [10, 1, 0, 0],
    )
    np.testing.assert_allclose(enzyme.states, [0, 1, 0, 10], atol=1e-12)
    assert enzyme.stable
    a = np.array([1.0, 2.0, 4.0])  # of a family, by parameters: a x1 + 2 x2 is constant
    pair = _near(lambda x, a: (-2 * x[0] + 4 * x[1], a * x[0] - 2 * a * x[1]), [1, 0], a=a)
    right = np.stack([2 * a / (2 * a + 2), a / (2 * a + 2)], axis=-1)
    np.testing.assert_allclose(pair.states, right, rtol=1e-13)
    assert pair.stable.all()
    # A product of sums, a quotient twice, and a switch.
    x = _near(
        lambda x: (
            -x[0] * (2 + x[1]) + x[2] / (1 + x[2]),
            2 * x[0] + x[0] * x[1] - x[2] / (1 + x[2]) - x[1] + np.maximum(x[0], 0.1),
            x[1] - np.maximum(x[0], 0.1),
        ),
        [1.0, 0.5, 0.2],
    ).states
    assert abs(x[0] * (2 + x[1]) - x[2] / (1 + x[2])) < 1e-14
    np.testing.assert_allclose([x[1] - max(x[0], 0.1), x.sum()], [0.0, 1.7], atol=1e-14)


def _network(rng):
    """Return the rates, as numbers of a function, and the totals of a reversible network."""
    n = int(rng.integers(3, 7))
    atoms = rng.integers(0, 3, (n, 2))
    atoms[atoms.sum(axis=1) == 0] = 1
    sides = [(i,) for i in range(n)] + [(i, j) for i in range(n) for j in range(i, n)]
    holds = [tuple(atoms[[*side]].sum(axis=0)) for side in sides]
    pairs = [
        (a, b)
        for i, a in enumerate(sides)
        for j, b in enumerate(sides)
        if i < j and holds[i] == holds[j] and not {*a} & {*b}
    ]
    some = [pairs[k] for k in rng.permutation(len(pairs))[: 2 * n]]
    some = [each for a, b in some for each in ((a, b), (b, a))]
    rates, stoichiometry = 10 ** rng.uniform(-2, 2, len(some)), np.zeros((n, len(some)))
    for k, (a, b) in enumerate(some):
        np.add.at(stoichiometry[:, k], [*a], -1)
        np.add.at(stoichiometry[:, k], [*b], 1)

    def f(x):
        fluxes = [k * np.prod([x[i] for i in a]) for k, (a, _) in zip(rates, some, strict=True)]
        return stoichiometry @ fluxes

    return n, f, stoichiometry, rng.uniform(0.1, 2.0, n)


@pytest.mark.filterwarnings("ignore:equilibria")
@pytest.mark.sampled(1)
@pytest.mark.parametrize("seeds", [range(5 * k, 5 * k + 5) for k in range(10)], ids=str)
def test_random_networks_keep_their_totals(seeds):
    """The stable equilibrium that is found is the limit of the motion from the same state."""
    stable, missed = 0, 0
    for seed in seeds:
        n, f, stoichiometry, x0 = _network(np.random.default_rng(seed))
        found = equilibria(Field(f, n), near=x0)
        if found.status == sf.Status.NOT_FOUND:
            missed += 1
            continue
        left = np.linalg.svd(stoichiometry.T)[2][np.linalg.matrix_rank(stoichiometry) :]
        assert abs(left @ (found.states - x0)).max(initial=0.0) < 1e-12, seed
        assert abs(np.array(f(found.states))).max() < 1e-12, seed
        if found.stable and found.states.min() >= -1e-12:
            stable += 1
            end = solve_ivp(lambda t, x, f=f: f(x), (0, 1e7), x0, "LSODA", rtol=1e-10, atol=1e-13)
            np.testing.assert_allclose(found.states, end.y[:, -1], atol=1e-7, err_msg=str(seed))
    assert stable >= 3
    assert missed <= 1


def test_equilibria_that_newton_reaches_from_afar():
    found = _near(lambda x: (np.exp(x[0]) - 1,), [[0.1], [0.0], [5.0], [-3.0], [np.nan]])
    np.testing.assert_allclose(found.states[:, 0], [0, 0, 0, 0, np.nan], atol=1e-15)
    assert found.status.tolist() == [0, 0, 0, 0, sf.Status.NONFINITE]
    assert _near(lambda x: (np.log(x[0]),), [20.0]).states.tolist() == [1.0]
    starts = np.random.default_rng(0).normal(size=(30, 3)) * 20
    found = equilibria(LORENZ, near=starts)
    points = np.array([[0, 0, 0], *([s * 72**0.5, s * 72**0.5, 27] for s in (1, -1))])
    far = abs(found.states[:, np.newaxis] - points).max(axis=-1).min(axis=-1)
    assert far.max() < 1e-12
    assert not found.status.any()


def test_heights_of_tables_are_no_constants():
    """A false integral held x, or y, where x' depends on the first of two tables alone."""
    knots = np.linspace(-3, 3, 13)

    def table(x, heights):
        return np.interp(x, knots, heights)

    def f(x):
        return table(x[0], np.tanh(1 - knots)), table(x[1], -(knots**3)) + x[0]

    starts = [[0.3, 0.4], [-2.0, 2.0]]
    np.testing.assert_allclose(_near(f, starts).states, np.ones((2, 2)), atol=1e-13)
    swapped = _near(lambda x: f(x[::-1])[::-1], starts)
    np.testing.assert_allclose(swapped.states, np.ones((2, 2)), atol=1e-13)


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


def test_clocks_keep_their_values():
    with pytest.warns(UserWarning, match="x3") as told:
        found = _near(
            lambda s: (s[1], -np.sin(s[0]) - 0.1 * s[1] + np.sin(s[2]), 1.0), [0.1, 0.0, 0.5]
        )
    assert len(told) == 1
    np.testing.assert_allclose(found.states, [0.5, 0.0, 0.5], atol=1e-14)
    assert found.eigenvalues.shape == (2,)
    found = _near(lambda x: (1.0,), [3.0])  # a clock that nothing reads
    assert (found.states.tolist(), found.eigenvalues.shape) == ([3.0], (0,))


def test_infinite_slopes_and_values_are_no_equilibria():
    for f in (lambda x: (1 + np.sqrt(x[0]),), lambda x: (x[0] + 0 * x[1], 3 + np.sqrt(x[1]))):
        system = Field(f, len(f(np.ones(2))))
        with pytest.warns(UserWarning, match="have no result"):
            found = equilibria(system, np.zeros(system.dimension))
        assert (found.status, np.isnan(found.states).all()) == (sf.Status.NOT_FOUND, True)
    with pytest.warns(UserWarning, match="have no result"):
        found = equilibria(sf.Map(lambda x: (5 + np.sqrt(x[0]),), 1), [0.0])
    assert np.isnan(found.states).all()
    for f, a in ((lambda x, a: (x[0] / a - 1,), 0), (lambda x, a: (x[0] * np.log(a) - 1,), -1)):
        with pytest.warns(UserWarning, match="1 of 2"):
            found = _near(f, [0.8], a=[a, 2.0])
        np.testing.assert_allclose(found.states, [[np.nan], [1 / np.log(2) if a else 2.0]], 1e-15)
        assert found.status.tolist() == [sf.Status.NONFINITE, sf.Status.OK]
    with pytest.warns(UserWarning, match="a multiple root"):
        assert _near(lambda x: (np.sqrt(x[0]),), [0.0]).states == 0.0


def test_a_clock_of_one_member_is_no_equilibrium():
    """y' = 1, y' = 0 and y' = 1 - y beside x' = x - x**2."""
    q, linear, c = np.zeros((3, 2, 2, 2)), np.zeros((3, 2, 2)), np.zeros((3, 2))
    q[:, 0, 0, 0], linear[:, 0, 0], linear[2, 1, 1], c[[0, 2], 1] = -1, 1, -1, 1
    with pytest.warns(UserWarning, match="1 of 3"):
        found = equilibria(Field.from_terms(q, linear, c), [0.8, 0.2])
    np.testing.assert_allclose(found.states, [[np.nan] * 2, [1.0, 0.2], [1.0, 1.0]], rtol=1e-14)
    assert found.status[0] == sf.Status.NOT_FOUND


def test_families_of_equilibria():
    bound = _near(lambda x: (x[2] - 3 * x[0] * x[1],) * 2 + (3 * x[0] * x[1] - x[2],), [1, 1.1, 1])
    a, b, c = bound.states
    assert abs(c - 3 * a * b) < 1e-14
    np.testing.assert_allclose([b - a, a + c], [0.1, 2.0], rtol=1e-14)
    with pytest.warns(UserWarning, match="a family of equilibria") as told:
        plane = _near(lambda x: [-x[0] * (1 + a * a) for a in x], [0.1, 0, 1.28, 0, 0])
    assert len(told) == 1
    assert (plane.status, abs(plane.states[0]) < 1e-14) == (sf.Status.DEGENERATE, True)
    with pytest.warns(UserWarning, match="a family of equilibria"):
        circle = _near(lambda x: [a * (1 - x[0] ** 2 - x[1] ** 2) for a in x], [3.0, 1.0])
    np.testing.assert_allclose(circle.states, np.array([3.0, 1.0]) / 10**0.5, rtol=1e-13)


def test_steady_states_near_those_of_bodies():
    bodies = sf.Suslov3D([4, 3], 1, -0.5, [-0.3, -0.25])
    found = equilibria(bodies, near=[[[1.0, 0.5]], [[0.3, -0.2]]])
    assert abs(bodies(found.states)).max() < 1e-16
    np.testing.assert_allclose(found.states[0, 0], -0.05 / 0.34 * np.array([-0.3, 0.5]))
    body = sf.SuslovND(J=[1, 2, 3], I=[0.1, 0.2, 0.3])
    assert abs(body(equilibria(body, near=[1, 0.5, 0.2]).states)).max() < 1e-15
    still = equilibria(sf.Suslov3D(4, 1, -0.5, -0.3, 0), near=[1.0, 0.5])
    of_body = equilibria(sf.Suslov3D(4, 1, -0.5, -0.3), near=[1.0, 0.5])
    np.testing.assert_array_equal(still.states, of_body.states)
    rotor = sf.Suslov3D(4, 1, -0.5, -0.3, 1)
    with pytest.warns(UserWarning, match="a family of equilibria"):
        found = equilibria(rotor, near=[1.0, 0.5])
    assert abs(rotor(found.states)).max() < 1e-15


TOP = Field(lambda w: (-w[1] * w[2], w[0] * w[2], -w[0] * w[1] / 3), "w1 w2 w3")  # of Euler
RATTLEBACK = Field(lambda s: (4 * s[0] * s[2], -s[1] * s[2], s[1] ** 2 - 4 * s[0] ** 2), "p r s")
SLEIGH = Field(lambda s: (0.4 * s[1] ** 2, -0.4 * s[0] * s[1]), "u w")


@pytest.mark.filterwarnings("ignore:equilibria. 1 of 1 starts lead to a family")
@pytest.mark.parametrize(
    ("field", "axis", "sign", "kind"),
    [
        (TOP, 0, 1, "centre"),
        (TOP, 1, 1, "saddle"),
        (TOP, 2, -1, "centre"),
        (RATTLEBACK, 2, 1, "saddle"),
        (RATTLEBACK, 2, -1, "saddle"),
        (SLEIGH, 0, 1, "attracting"),
        (SLEIGH, 0, -1, "repelling"),
    ],
)
def test_lines_of_equilibria(field, axis, sign, kind):
    """Newton's method halves the states of homogeneous fields, and led to the origin."""
    for size, away in ((1.0, 0.0), (0.9, 0.02), (300.0, 3.0)):
        start = sign * size * np.eye(field.dimension)[axis]
        found = equilibria(field, near=start + away * np.cos(np.arange(field.dimension)))
        assert (found.kind, found.stable) == (kind, kind == "attracting")
        np.testing.assert_allclose(found.states, start, atol=1.1 * away)
        others = np.delete(found.states, axis)
        assert abs(others).max() < 1e-14 * size
        # The eigenvalues in closed form, at this member of the line.
        c = found.states[axis]
        if field is TOP:
            root = c * np.emath.sqrt((-1 / 3, 1 / 3, -1)[axis])
            expected = [root, 0, -root]
        else:
            expected = [4 * c, 0, -c] if field is RATTLEBACK else [0, -0.4 * c]
        for part in (np.real, np.imag):
            values, right = np.sort(part(found.eigenvalues)), np.sort(part(expected))
            np.testing.assert_allclose(values, right, atol=1e-13 * size)


@pytest.mark.filterwarnings("ignore:equilibria. ")
def test_planes_and_spheres_of_equilibria():
    """As many eigenvalues 0 as the family has dimensions are left out, and no more."""
    for sign, kind in ((-1, "attracting"), (1, "repelling")):
        plane = Field(lambda x, a=sign: (x[2] * x[0], -x[2] * x[1], a * x[2]), "x y z")
        found = equilibria(plane, near=[[1.0, 2.0, 0.0], [300.0, 1e-3, 1e-4]])
        assert found.kind.tolist() == [kind] * 2
        assert found.stable.tolist() == [sign < 0] * 2
    sphere = Field(lambda x: [a * (1 - x[0] ** 2 - x[1] ** 2 - x[2] ** 2) for a in x], 3)
    found = equilibria(sphere, near=[0.5, 0.6, 0.7])
    assert (found.kind, found.stable) == ("attracting", True)
    line = Field(lambda x: (-x[0], x[0] * x[1] + x[2] ** 2, x[0] * x[2]), 3)  # 0, c, 0
    found = equilibria(line, near=[0.0, 2.0, 0.0])
    assert (found.kind, found.stable) == ("neutral", False)
    turn = sf.Map(lambda x: (x[0] + x[2] * x[1], x[1] - x[2] * x[0], x[2] / 2), 3)
    assert equilibria(turn, near=[1.0, 2.0, 0.1]).kind == "attracting"


def test_one_half_of_the_line_of_a_body_attracts():
    body = sf.Suslov3D(1, 2, 0.3, 0.2)
    found = equilibria(body, near=[[-0.4, 0.6], [0.4, -0.6], [0.0, 0.0]])
    assert found.kind.tolist() == ["attracting", "repelling", "neutral"]
    assert found.stable.tolist() == [True, False, False]
    for k, start in ((0, [-0.4, 0.61]), (1, [0.4, -0.61])):
        end = sf.flow(body, start, time=200).final
        assert (abs(end - found.states[k]).max() < 0.02) == found.stable[k]


def test_folds_with_a_direction_that_grows():
    """They are unstable, whatever the eigenvalue 0 decides; and no family, from any start."""
    for start in ([0.1, 0.1], [0.0, 0.0], [1e-9, 0.0]):
        for rate, kind in ((1, "repelling node"), (-1, "neutral")):
            with pytest.warns(UserWarning, match="multiple root"):
                found = _near(lambda x, a=rate: (x[0] ** 2, a * x[1]), start)
            assert (found.kind, found.stable) == (kind, False)
