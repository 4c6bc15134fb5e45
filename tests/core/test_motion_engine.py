"""The engine of the motion: steps by formulas, and the same bits however they are carried out."""

import itertools
from collections import namedtuple
from concurrent.futures import ThreadPoolExecutor

import children
import numpy as np
import pytest
from scipy.linalg import expm
from systems import LORENZ, SPRING, kepler, lorenz_96, rates_of_henon_heiles, robertson, van_der_pol

from suslov_fast import Field, flow
from suslov_fast.core.expressions import numpy_evaluation
from suslov_fast.core.flow import batch_solver, linearly_implicit, step_length
from suslov_fast.core.flow.batch_solver import BatchSolver, SolverRequest
from suslov_fast.core.flow.integrator import check_owners
from suslov_fast.core.flow.memory import LaneState
from suslov_fast.core.flow.rules import rule_of
from suslov_fast.core.flow.weights import weights

pytestmark = pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")


def pairs(s):
    """In two sets that take turns, by functions that are called, and in rows with rates of 0."""
    x, v, rest = s[:-1:2], s[1::2], s[-1]
    d = [a - b for a, b in itertools.pairwise(x[::-1])][::-1]
    d = [rest * x[0], *(a + a * a * a * 0.1 for a in d), -x[-1]]
    rates = [b - a + np.sin(a * 0.3) for a, b in itertools.pairwise(d)]
    return [*(a for pair in zip(v, rates, strict=True) for a in pair), 0.0]


def random(seed, *shape):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


KINKS = Field(
    lambda x, a: (x[1], -abs(x[0]) * x[0] - a * np.minimum(x[0], 0.3) + np.clip(x[1], -0.2, 0.4)),
    2, a=np.linspace(0.5, 1.5, 3),
)  # fmt: skip
TWO = np.array([[0.5, 0.0], [0.6, 0.1], [0.7, 0.2]])
# Fields, starts and a last time.
CASES = {
    "thin layer": (lambda s: (s[1], -s[0] - s[0] / np.sqrt(s[0] ** 2 + 1e-6)), random(6, 10, 2), 7),
    # Clocks that both sets read, and that none reads.
    "two sets": (
        lambda s: (s[1] * np.cos(s[2]), np.sin(s[2]) - s[0], 1.0, 2.0),
        [[0.1, 0.2, 0.3, 0.4], [1.0, 0.5, 2.0, 0.0]], 9,
    ),
    "pairs": (pairs, np.append(random(2, 3, 10), [[1.0]] * 3, 1), 3),
    # A component is 0 but for rounding.
    "functions": (
        lambda s: (np.sin(s[1]) / 2, np.exp(s[0]) / -10 - np.log(s[0] ** 2 + 1) * s[1],
                   s[0] * 0.1 + s[0] * 0.2 - s[0] * 0.3),
        random(4, 3, 3) * [1, 1, 0], 5,
    ),
    "Henon-Heiles": (rates_of_henon_heiles, random(0, 11, 4) / 5, 20),
    "van der Pol": (lambda s: van_der_pol(s, 1000), [[2.0, 0.0], [1.0, 1.0], [np.nan, 1.0]], 900),
    "Robertson": (robertson, [[1.0, 0.0, 0.0], [0.5, 1e-5, 0.1]], 4e4),
    "a pole of a clock": (
        lambda s: (s[0] / (s[1] - 1.5), 1.0), [[1.0, 0.0], [1.0, 2.0], [1.0, 1.48]], 2),
    "driven from rest": (
        lambda s: (s[1], np.sin(s[2]) - s[0], 1.0), [[0.0, 0.0, 0.0], [0.3, 0.1, 1.0]], 20),
    "large lattice": (lorenz_96, 8.0 + random(1, 2, 60), 0.5),
    "lattice": (lorenz_96, 8.0 + random(1, 3, 20), 1),
    "jumps": (SPRING, TWO, 3),
    "kinks": (KINKS, TWO, 3),
    "table": (
        lambda x: (np.interp(x[1], [0, 1, 1.01, 8], [0, 10, 0, 5]) - 0.3 * x[0], 1.0), TWO, 3),
    "stairs": (lambda x: (np.floor(3 * x[1]) ** 2 + np.sign(x[0] - x[1]), 1.0), TWO, 3),
}  # fmt: skip
SMOOTH = [*CASES][:11]


def case(name):
    f, x0, last = CASES[name]
    x0 = np.array(x0, float)
    return f if isinstance(f, Field) else Field(f, x0.shape[-1]), x0, last


def assert_same(one, other, own=slice(None)):
    """Of two motions, or of one and its own members of another."""
    np.testing.assert_array_equal(one.states, other.states[:, own])
    for name in ("steps", "end", "status"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name)[own])
    for name in one.derivatives:
        np.testing.assert_array_equal(one.derivatives[name], other.derivatives[name][:, own])


# -------------------------------------------------------------------------- steps by their formulas
def attempts(f, table, x, last, settings):
    """Yield t and x (D,): at first, and after each attempted step of `BatchSolver` to `last`."""
    request = SolverRequest([last], 1, settings)
    motion = BatchSolver(f, table, x[np.newaxis], request, np.empty((1, 1, f.D)))
    rows, places, mode = motion._rows(slice(0, 1)), motion.rows, int(bool(settings.stiff))
    runner = motion._runner(motion.integrator(mode), rows, np.zeros(1, np.int64), 1)
    runner.budget = 1  # the code returns after each attempt
    while True:
        own = rows[0, : f.D].copy()
        if motion.starts is not None:
            own[[*f.hybrid.offsets]] += motion.starts[0]
        yield rows[0, places.t], own
        if rows[0, places.state] > LaneState.IMPLICIT:
            return
        runner.take()


def explicit_end(f, x, s, N, sets):
    """Return y_N after N sub-steps s by Gragg's rule; by Störmer's if variables fall into sets."""
    a, b = x, x + s * f(x)
    for m in range(1, N // 2 + 1):
        a = a + 2 * s * f(b)
        b = b + (s if m == N // 2 else 2 * s) * f(a)
    if sets is None:
        return (a + b) / 2
    a[sets[1]] = b[sets[1]]
    return a


def implicit_end(f, x, s, N, jacobian):
    """Return y_N after N linearly implicit sub-steps s of Euler's method, f' from the start."""
    matrix, y = np.eye(len(x)) - s * jacobian(x), x
    for _ in range(N):
        y = y + np.linalg.solve(matrix, s * f(y))
    return y


def by_formulas(f, x, h, end, columns, p, *given):
    """Return x(t + h) from the ends y_c of all columns: x + sum_c w_c (y_c - x)."""
    ends = [end(f, x, h / N, N, *given) - x for N in columns]
    return x + sum(w * y for w, y in zip(weights(columns, p), ends, strict=True))


@pytest.mark.parametrize("stiff", [False, True])
@pytest.mark.parametrize("name", SMOOTH)
def test_steps_are_those_of_the_formulas(name, stiff):
    """Those that are accepted of the first twelve, of each trajectory."""
    field, x0, last = case(name)
    _, f, table = field._right_hand_sides[0]
    settings, compared = batch_solver.Settings(1e-6, stiff=stiff), 0
    rule = rule_of(f, LaneState.IMPLICIT if stiff else LaneState.EXPLICIT, settings.rtol)
    columns = explicit_end, rule.columns, 2, getattr(rule, "sets", None)
    if stiff:
        columns = implicit_end, rule.columns, 1, lambda x: f.jacobian(x, table[0])
    for x in x0[np.isfinite(x0).all(axis=1)]:
        tried = attempts(f, table[0], x, last, settings)
        for (t, before), (later, after) in itertools.islice(itertools.pairwise(tried), 12):
            if later > t:
                right = by_formulas(lambda x: f.value(x, table[0]), before, later - t, *columns)
                np.testing.assert_allclose(after, right, 1e-10, 1e-12)
                compared += 1
    assert compared >= len(x0)


@pytest.mark.parametrize("name", ["t", "rtol", "keeps"])
def test_scalar_kernels_find_each_number_in_one_record(name):
    """A row of the work would be hidden by a row of the line, or by a number of all lanes."""
    _, f, _ = case("two sets")[0]._right_hand_sides[0]
    own = batch_solver.integrator_of(f, LaneState.EXPLICIT, batch_solver.Settings(1e-6))
    with pytest.raises(AssertionError, match=name):
        check_owners(own.rows, namedtuple("Rows", [*own.work._fields, name])(*own.work, 0))


def test_few_steps_are_refused():
    """In close passages, where errors grow from step to step, and at the start."""
    field, angles = Field(kepler, 4), np.arange(12.0)
    r, side = 1 - 0.6 * np.cos(angles), 0.8
    x0 = np.stack([np.cos(angles) - 0.6, side * np.sin(angles),
                   -np.sin(angles) / r, side * np.cos(angles) / r], -1)  # fmt: skip
    lattice, starts, last = case("lattice")
    tried = refused = 0
    for f, x, end in [(field, each, 2 * np.pi) for each in x0] + [(lattice, starts[0], last)]:
        _, own, table = f._right_hand_sides[0]
        times = [t for t, _ in attempts(own, table[0], x, end, batch_solver.Settings(1e-6))]
        tried += len(times) - 1
        refused += sum(later == t for t, later in itertools.pairwise(times))
    assert refused <= 0.13 * tried


@pytest.mark.parametrize("name", CASES)
def test_bits_do_not_depend_on_the_batch(name, monkeypatch):
    """Nor on threads and blocks; also where memory is used again, by several threads of Python."""
    field, x0, last = case(name)
    times = [0.1 * last, 0.45 * last, last]
    whole = flow(field, x0, time=times)

    def compare(own):
        of = field[own] if field.shape else field
        assert_same(flow(of, x0[own], time=times), whole, own)

    with ThreadPoolExecutor(4) as pool:
        parts = [*range(len(x0)), slice(0, 2), slice(None, None, -1)] * 2
        assert [*pool.map(compare, parts)] == [None] * len(parts)
    many = np.arange(60) % len(x0)
    of = field[many] if field.shape else field
    monkeypatch.setattr(batch_solver, "TRAJECTORIES_OF_THREAD", 8)
    assert_same(flow(of, x0[many], time=times, threads=children.TWO_THREADS), whole, many)
    monkeypatch.setattr(batch_solver, "WORK_WITHOUT_PAUSE", 1)
    assert_same(flow(field, x0, time=times), whole)


# The rows and columns of coefficients of linear systems.
CELLS = np.arange(42).reshape(6, 7)
SIDES = [np.roll(CELLS, shift, axis).ravel() for axis in (0, 1) for shift in (-1, 1)]
PATTERNS = {
    "lattice": np.stack([np.tile(CELLS.ravel(), 4), np.concatenate(SIDES)]),
    "dense": np.indices((12, 12)).reshape(2, -1),
    "scattered": np.random.default_rng(60).integers(0, 24, (2, 60)),
}


@pytest.mark.parametrize("longest", [20_000, -1])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_implicit_steps_of_linear_systems(pattern, longest, monkeypatch):
    """By a list of operations, and by columns, of one orbit and of eight."""
    monkeypatch.setattr(linearly_implicit, "MOST_IN_LINE", longest)
    D = int(np.max(PATTERNS[pattern])) + 1 + (longest < 0)  # each way has code of its own
    A = np.diag(-np.geomspace(1.0, 1000.0, D))
    A[*PATTERNS[pattern]] += 0.3 * random(D, len(PATTERNS[pattern][0]))
    near = [np.flatnonzero(row) for row in A]
    field = Field(lambda s: [sum(A[i, j] * s[j] for j in near[i]) for i in range(D)], D)
    x0, given = random(1, 8, D), {"time": 1.0, "stiff": True, "atol": 1e-9}
    found = flow(field, x0, **given)
    np.testing.assert_allclose(found.final, x0 @ expm(A).T, atol=1e-7)
    assert_same(flow(field, x0[3], **given), found, 3)


def test_growth_below_allowed_errors_does_not_depend_on_other_lanes():
    saddle = Field(
        lambda s: (9.2 * s[0] + 107.0 * s[1] + 0.05 * s[0] * s[3], 9.2 * s[0] + 0.4 * s[1],
                   3.2 * (s[3] ** 2 - s[2]), 0.3 - s[3]), 4)  # fmt: skip
    rng = np.random.default_rng(0)
    x0 = rng.uniform(-1.0, 1.0, (24, 4))
    x0[:, :2] *= 10.0 ** rng.uniform(-14.0, -9.0, (24, 2))
    given = {"time": 0.176, "rtol": 1e-5, "atol": 1e-7, "stiff": True}
    whole = flow(saddle, x0, **given)
    for k in range(len(x0)):
        assert_same(flow(saddle, x0[k], **given), whole, k)


@pytest.mark.parametrize("stiff", [None, True])
def test_families_of_dense_fields(stiff):
    """Products with a table are those of a list of operations."""
    rng, D = np.random.default_rng(3), 5
    q, l, c = (0.1 * rng.normal(size=(3, *[D] * axes)) for axes in (3, 2, 1))
    q[:] += 0.5
    dense, x0 = Field.from_terms(q, l, c), 0.1 * rng.normal(size=(3, D))
    found = flow(dense, x0, time=1.0, stiff=stiff, rtol=1e-10)
    for k in range(3):
        sparse = Field(
            lambda s, k=k: sum(s[i] * (q[k, :, i] @ s) for i in range(D)) + l[k] @ s + c[k], D
        )
        right = flow(sparse, x0[k], time=1.0, rtol=1e-12).final
        np.testing.assert_allclose(found.final[k], right, rtol=1e-7)
        assert_same(flow(dense[k], x0[k], time=1.0, stiff=stiff, rtol=1e-10), found, k)


def test_orbits_that_are_not_stiff_stay_explicit():
    x0 = np.random.default_rng(1).uniform(-10.0, 10.0, (64, 3))
    x0[:, 2] += 25.0
    for rtol in (1e-6, 1e-9):
        usual, explicit = (flow(LORENZ, x0, time=5.0, rtol=rtol, stiff=s) for s in (None, False))
        np.testing.assert_array_equal(usual.states, explicit.states)


# Values of the test set for initial value problems, and the most steps at each tolerance.
@pytest.mark.parametrize(
    ("f", "x0", "last", "right", "steps"),
    [
        (lambda s: van_der_pol(s, 1000), [2.0, 0.0], 2000.0, 1.706167732170469, (90, 150, 300)),
        (robertson, [1.0, 0.0, 0.0], 4e5, 4.93827451e-3, (40, 60, 110)),
    ],
)
def test_stiff_problems(f, x0, last, right, steps):
    for rtol, most in zip((1e-3, 1e-6, 1e-9), steps, strict=True):
        found = flow(Field(f, len(x0)), x0, time=last, rtol=rtol)
        np.testing.assert_allclose(found.final[0], right, rtol=20.0 * rtol + 1e-8)
        assert found.steps <= most


# A step of length 1, and the length that the step before it should have had: by the prediction the
# next length is at most 1.15 of the ratio of both lengths times as long.
@pytest.mark.parametrize("before", [None, 0.9, 1.5, 9.0])
@pytest.mark.parametrize("order", [8, 10, 12])
@pytest.mark.parametrize(
    ("ratio", "of_length", "apart", "most"),
    [
        (0.5, 0.5, 0.0, 1.0),  # taken
        (2.0, 1e-9, 0.0, 0.9),  # refused, though the ratio for the next length is small
        (0.5, 0.5, 51.0, 0.5),  # columns agree on a false end
        (1e9, 1e9, 0.0, 0.2),
    ],
)
def test_the_length_after_a_step(before, order, ratio, of_length, apart, most):
    after = step_length.after(order - 1, before is not None)
    known = dict.fromkeys(after.inputs, 0.0)
    known |= {"taken": 1.0, "wanted": 1.0, "longer": 1.0, "kept": 1.0, "last": 9.0, "longest": 9.0}
    known |= {"ratio": ratio, "of_length": of_length, "apart": apart, "reach": 1.0}
    known["best"] = before or 0.0
    values = dict(enumerate(known[name] for name in after.inputs))
    numpy_evaluation.evaluate(after.operations, values)
    found = {name: values[place] for name, place in after.results.items()}
    best = min(of_length ** (-1 / (order - 1)), 4.0)
    accepted = ratio <= 1.0 and apart <= 50.0
    shrinks = max(min(1.15 * best / before, 1.0), 0.5) if before and accepted else 1.0
    assert found["accepted"] == accepted
    assert abs(found["wanted"] / min(max(0.75 * best * shrinks, 0.2), most) - 1) < 0.08
