"""The engine of the motion: columns, rules, and the same bits however steps are carried out."""

import itertools
from concurrent.futures import ThreadPoolExecutor

import children
import numpy as np
import pytest
from steps_in_numpy import explicit_step, implicit_step
from systems import SPRING, rates_of_henon_heiles, robertson

import suslov_fast as sf
from suslov_fast import Field, flow
from suslov_fast.core.expressions.full_quadratic import DenseRightHandSide, dense_parameters
from suslov_fast.core.expressions.programs import Expressions
from suslov_fast.core.expressions.right_hand_side import RightHandSide
from suslov_fast.core.expressions.values import Number
from suslov_fast.core.expressions.variational import variational
from suslov_fast.core.flow import (
    batch_solver,
    integrator,
    single_steps,
    small_batches,
    vector_functions,
    weights,
)
from suslov_fast.core.flow.memory import LaneState
from suslov_fast.core.llvm import compiler
from suslov_fast.motions import integration


def right_hand_side(f, D):
    values = Expressions(D)
    results = f([Number(values.emit, k) for k in range(D)])
    return RightHandSide(values, [a.number if isinstance(a, Number) else a for a in results])


def van_der_pol(s):
    x, v = s
    return v, 1000.0 * (1.0 - x * x) * v - x


def pole_of_a_clock(s):
    x, t = s
    return x / (t - 1.5), 1.0


def driven_from_rest(s):
    """With the value of number 1 and the constant 1.0 as results."""
    x, v, t = s
    return v, t.then("sin") - x, 1.0


def lattice(s):
    D = len(s)
    return [s[i - 1] * (s[(i + 1) % D] - s[i - 2]) - s[i] + 8.0 for i in range(D)]


def functions_of(s):
    """With a component that is 0 but for rounding."""
    x, y, _ = s
    rates = y.then("sin") * 0.5, x.then("exp") * -0.1 - (x * x + 1.0).then("log") * y
    return *rates, x * 0.1 + x * 0.2 - x * 0.3


def thin_layer(s):
    """Where some steps have Gragg's columns, and others Störmer's."""
    x, v = s
    return v, -x - x / (x * x + 1e-6).sqrt()


def in_two_sets(s):
    """With clocks that both sets read, and that none reads."""
    x, v, t, _ = s
    return v * t.then("cos"), t.then("sin") - x, 1.0, 2.0


def pairs(s):
    """In two sets that take turns, by functions that are called, and in rows with rates of 0."""
    x, v, rest = s[:-1:2], s[1::2], s[-1]
    d = [a - b for a, b in zip(x[1:], x[:-1], strict=True)]
    d = [rest * x[0], *(a + a * a * a * 0.1 for a in d), -x[-1]]
    rates = [b - a + (a * 0.3).then("sin") for a, b in itertools.pairwise(d)]
    return [*(a for pair in zip(v, rates, strict=True) for a in pair), 0.0]


CASES = {
    "thin_layer": (thin_layer, np.random.default_rng(6).uniform(-1.0, 1.0, (10, 2)), 7.0),
    "in_two_sets": (in_two_sets, np.array([[0.1, 0.2, 0.3, 0.4], [1.0, 0.5, 2.0, 0.0]]), 9.0),
    "pairs": (pairs, np.append(np.random.default_rng(2).normal(size=(3, 40)), [[1.0]] * 3, 1), 3.0),
    "functions_of": (
        functions_of,
        np.random.default_rng(4).uniform(-1, 1, (3, 3)) * [1, 1, 0],
        5.0,
    ),
    "henon_heiles": (
        rates_of_henon_heiles,
        np.random.default_rng(0).uniform(-0.2, 0.2, (11, 4)),
        20.0,
    ),
    "van_der_pol": (van_der_pol, np.array([[2.0, 0.0], [1.0, 1.0], [np.nan, 1.0]]), 900.0),
    "robertson": (robertson, np.array([[1.0, 0.0, 0.0], [0.5, 1e-5, 0.1]]), 4e4),
    "pole_of_a_clock": (pole_of_a_clock, np.array([[1.0, 0.0], [1.0, 2.0], [1.0, 1.48]]), 2.0),
    "driven_from_rest": (driven_from_rest, np.array([[0.0, 0.0, 0.0], [0.3, 0.1, 1.0]]), 20.0),
    "large_lattice": (lattice, 8.0 + np.random.default_rng(1).normal(size=(2, 60)), 0.5),
    "lattice": (lattice, 8.0 + np.random.default_rng(1).normal(size=(3, 20)), 1.0),
}
KINKS = sf.Field(
    lambda x, a: (x[1], -abs(x[0]) * x[0] - a * np.minimum(x[0], 0.3) + np.clip(x[1], -0.2, 0.4)),
    2,
    a=np.linspace(0.5, 1.5, 9),
)
DOSES = sf.Field(lambda x: (np.interp(x[1], [0, 1, 1.01, 8], [0, 10, 0, 5]) - 0.3 * x[0], 1.0), 2)
STAIRS = sf.Field(lambda x: (np.floor(3 * x[1]) ** 2 + np.sign(x[0] - x[1]), 1.0), 2)


TEXTS = """
import hashlib
import numpy as np
import suslov_fast as sf
from suslov_fast.core.flow import batch_solver, step_loop
field = sf.Field(lambda s: (s[1], np.cos(s[2]) - abs(s[0]), 1.0), "x v t")
for is_implicit in (False, True):
    integrator = batch_solver.integrator_of(field._right_hand_sides[0].f, is_implicit, True)
    text = step_loop.text_of_integrator(integrator, "f", 8, True)
    print(hashlib.sha256(text.encode()).hexdigest())
"""


def test_texts_are_those_of_every_process():
    """Machine code, and so its bits and its cache, depend on no seed of hashes."""
    one, other = (children.run(TEXTS, PYTHONHASHSEED=seed) for seed in "12")
    assert one == other


def motion(f, x0, times, rtol=1e-6, *, table=(), sign=1.0, **settings):
    """Return the states, and what is known of trajectories at their end."""
    states, settings = (
        np.full((len(times), *x0.shape), np.nan),
        batch_solver.Settings(rtol, **settings),
    )
    found = batch_solver.BatchSolver(
        f, np.array(table), x0, np.array(times), sign, settings, states
    )
    found.run()
    return states, found.t, found.steps, found.state


def assert_equal(first, second):
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("lengths", "p"), [(weights.EXPLICIT, 2), (weights.IMPLICIT, 1)])
def test_weights_cancel_the_powers_of_the_length(lengths, p):
    of_errors, own = weights.weights_of_errors(lengths, p), weights.weights(lengths, p)
    assert sum(own) == pytest.approx(1.0, abs=1e-12)
    for k in range(1, len(lengths)):
        assert sum(w * n ** (-p * k) for w, n in zip(own, lengths, strict=True)) == pytest.approx(
            0.0, abs=1e-13
        )
    for k in range(len(lengths) - 1):
        errors = sum(w * n ** (-p * k) for w, n in zip(of_errors, lengths, strict=True))
        assert errors == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("stiff", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_steps_are_those_of_the_formulas(case, stiff):
    """Those that are accepted of the first sixteen, of each trajectory."""
    function, x0, last = CASES[case]
    f, table = right_hand_side(function, x0.shape[1]), np.zeros(0)
    by_formulas, compared = implicit_step if stiff else explicit_step, 0
    ways = (
        [lambda x: f.jacobian(x, table)]
        if stiff
        else [batch_solver.integrator_of(f, False, False).sets]
    )
    ways += [None] * (case == "thin_layer" and not stiff)  # where it is rough
    for x in x0[np.isfinite(x0).all(axis=1)]:
        tried = single_steps.attempts(f, table, x, last, batch_solver.Settings(1e-6, stiff=stiff))
        for (t, _, before), (later, _, after) in itertools.islice(itertools.pairwise(tried), 16):
            if later > t:
                given = (lambda x: f.value(x, table)), before, later - t
                rights = [by_formulas(*given, way) for way in ways]
                assert any(np.allclose(after, right, 1e-10, 1e-12) for right in rights)
                compared += 1
    assert compared >= len(x0)


def dense_field(rng, D=5):
    """Return a dense right-hand side, its table, and its terms."""
    indices = [(i, j, k) for i in range(D) for j in range(D + 1) for k in range(j, D + 1)]
    values = 0.1 * rng.normal(size=len(indices))
    table = dense_parameters(np.transpose(indices), values, D)
    return DenseRightHandSide(D), table, [(*i, v) for i, v in zip(indices, values, strict=True)]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", CASES)
def test_runs_have_the_bits_of_straight_line_code(case, monkeypatch):
    function, x0, last = CASES[case]
    f, again = (right_hand_side(function, x0.shape[1]) for _ in range(2))
    usual = motion(f, x0, [0.3 * last, last])
    monkeypatch.setattr(vector_functions, "LONGEST", -1)
    again.__dict__["key"] = f"runs of {case}"
    assert_equal(usual, motion(again, x0, [0.3 * last, last]))


@pytest.mark.parametrize("system", [SPRING, KINKS, DOSES, STAIRS])
def test_choices_reach_the_numbers_of_runs(system, monkeypatch):
    """Runs read numbers of their own, and one orbit has tables of its own."""
    usual = sf.flow(system, np.linspace((0.5, 0.0), (0.7, 0.1), 9), time=[0.3, 3.0])
    if system.shape == ():
        alone = sf.flow(system, [0.5, 0.0], time=[0.3, 3.0])
        assert_equal([alone.states, alone.steps], [usual.states[:, 0], usual.steps[0]])
    monkeypatch.setattr(vector_functions, "LONGEST", -1)
    again = system.with_parameters()
    f = again._right_hand_sides[0][1]
    monkeypatch.setitem(f.__dict__, "key", f"runs of {f.key}")
    found = sf.flow(again, np.linspace((0.5, 0.0), (0.7, 0.1), 9), time=[0.3, 3.0])
    assert_equal([found.states, found.steps], [usual.states, usual.steps])


@pytest.mark.parametrize(
    ("case", "last", "is_stiff"),
    [
        ("robertson", 4.0, True),
        ("pole_of_a_clock", 0.04, None),
        ("in_two_sets", 9.0, None),
        ("thin_layer", 4.0, None),
    ],
)
def test_variational_equations_have_the_same_bits(case, last, is_stiff, monkeypatch):
    """Of a batch, of one, and by runs; elimination by columns agrees."""
    function, x0, _ = CASES[case]
    x0 = x0[-2:]
    of, *others = (right_hand_side(function, x0.shape[1]) for _ in range(3))
    f, by_runs, by_columns = (variational(each, of.D, True) for each in (of, *others))
    start = np.zeros((len(x0), f.D))
    start[:, : of.D], start[:, of.D : -2 : of.D + 1], start[:, -2] = x0, 1.0, 0.5
    run = start, [0.3 * last, last]
    usual = motion(f, *run, stiff=is_stiff)
    for k in range(len(x0)):
        alone = motion(f, start[k : k + 1], run[1], stiff=is_stiff)
        np.testing.assert_array_equal(alone[0][:, 0], usual[0][:, k])
    monkeypatch.setattr(vector_functions, "LONGEST", -1)
    by_runs.key = f"runs of variational {case}"
    assert_equal(usual, motion(by_runs, *run, stiff=is_stiff))
    if is_stiff:
        monkeypatch.setattr(integrator, "LONGEST", -1)
        by_columns.key = f"columns of variational {case}"
        found = motion(by_columns, *run, stiff=is_stiff)
        np.testing.assert_allclose(found[0], usual[0], rtol=1e-6, atol=1e-9)


def test_a_component_and_a_constant_with_its_number():
    """In a function that is called: x' = y, y' = a long sum, t' = 1."""

    def long(s):
        x, y, t = s
        total = -x
        for k in range(1, 90):
            total = total + (0.1 * k * t).then("sin") * 1e-3 * x
        return y, total, 1.0

    f = right_hand_side(long, 3)
    assert len(f.f.operations) > 160
    states, *_ = motion(f, np.array([[1.0, 0.0, 0.0]] * 2), [2.0])
    np.testing.assert_allclose(states[0, :, 2], 2.0, rtol=1e-13)


@pytest.mark.parametrize("case", ["van_der_pol", "robertson", "lattice"])
def test_elimination_by_columns_agrees_with_that_by_a_list(case, monkeypatch):
    function, x0, last = CASES[case]
    x0 = x0[:2]
    f, again = (right_hand_side(function, x0.shape[1]) for _ in range(2))
    usual, *_ = motion(f, x0, [last], stiff=True)
    monkeypatch.setattr(integrator, "LONGEST", -1)
    again.__dict__["key"] = f"columns of {case}"
    found = motion(again, x0, [last], stiff=True)
    np.testing.assert_allclose(found[0], usual, rtol=1e-6)
    np.testing.assert_array_equal(motion(again, x0[:1], [last], stiff=True)[0], found[0][:, :1])


@pytest.mark.parametrize("case", CASES)
def test_few_trajectories_have_the_bits_of_a_batch(case):
    """Also where memory is used again."""
    function, x0, last = CASES[case]
    f, times = right_hand_side(function, x0.shape[1]), [0.1 * last, 0.45 * last, last]
    states, *of_batch = motion(f, x0, times)
    for own in [*([k] for k in range(len(x0))), [0, 1], slice(None, None, -1), slice(None)] * 2:
        found = states[:, own], *(array[own] for array in of_batch)
        assert_equal(motion(f, x0[own], times), found)
        given = f, np.zeros(0), x0[own], np.array(times), 1.0, batch_solver.Settings(1e-6)
        states_of_few, steps_of_few, _, begun = small_batches.solve_small_batch(*given)
        if begun is None:
            assert_equal((states_of_few, steps_of_few), (found[0], found[2]))
            continue
        rest = batch_solver.BatchSolver(*given, states_of_few)
        rest.run(begun=begun)
        assert_equal((rest.states, rest.t, rest.steps, rest.state), found)


def test_growth_below_allowed_errors_does_not_depend_on_other_lanes():
    def saddle(x):
        a, b, c, d = x
        return 9.2 * a + 107.0 * b + 0.05 * a * d, 9.2 * a + 0.4 * b, 3.2 * (d * d - c), 0.3 - d

    rng = np.random.default_rng(0)
    x0 = rng.uniform(-1.0, 1.0, (24, 4))
    x0[:, :2] *= 10.0 ** rng.uniform(-14.0, -9.0, (24, 2))
    f, run = right_hand_side(saddle, 4), {"rtol": 1e-5, "atol": (1e-7,) * 4, "stiff": True}
    states, *of_batch = motion(f, x0, [0.176], **run)
    for k in range(len(x0)):
        own = states[:, k : k + 1], *(array[k : k + 1] for array in of_batch)
        assert_equal(motion(f, x0[k : k + 1], [0.176], **run), own)


def test_calls_of_several_threads_have_memory_of_their_own():
    """Machine code runs while other threads of Python call it."""
    f, starts = right_hand_side(van_der_pol, 2), np.linspace(1.0, 2.0, 48).reshape(12, 2, 2)

    def call(x0):
        settings = batch_solver.Settings(1e-9, stiff=False)
        return small_batches.solve_small_batch(f, np.zeros(0), x0, np.array([9.0]), 1.0, settings)[
            :2
        ]

    with ThreadPoolExecutor(6) as pool:
        found = [*pool.map(call, starts)]
    for each, x0 in zip(found, starts, strict=True):
        assert_equal(each, call(x0))


def test_dense_fields():
    D, rng = 5, np.random.default_rng(3)
    f, table, terms_of_f = dense_field(rng, D)
    x0 = 0.1 * rng.normal(size=(3, D))

    def products(s):
        terms = [0.0 * s[0]] * D
        y = [*s, 1.0]
        for place, *factors, value in terms_of_f:
            terms[place] = terms[place] + value * y[factors[0]] * y[factors[1]]
        return terms

    sparse = right_hand_side(products, D)
    x = x0.T
    np.testing.assert_allclose(f.value(x, table), sparse.value(x, np.zeros(0)), rtol=1e-13)
    np.testing.assert_allclose(f.jacobian(x, table), sparse.jacobian(x, np.zeros(0)), rtol=1e-12)
    for stiff in (None, True):
        states, *_ = motion(f, x0, [3.0], 1e-9, table=table, stiff=stiff)
        np.testing.assert_allclose(states, motion(sparse, x0, [3.0], 1e-12)[0], rtol=1e-7)


class Counting(batch_solver.BatchSolver):
    """A motion that counts the steps of the implicit integrator."""

    implicit_steps = 0

    def _steps(self, integrator, rows, *others):
        before = rows[:, integrator.rows.steps].sum()
        super()._steps(integrator, rows, *others)
        self.implicit_steps += integrator.is_implicit * (
            rows[:, integrator.rows.steps].sum() - before
        )


def test_orbits_that_are_not_stiff_stay_explicit():
    def lorenz(s):
        x, y, z = s
        return 10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z

    f = right_hand_side(lorenz, 3)
    x0 = np.random.default_rng(1).uniform(-10.0, 10.0, (256, 3))
    x0[:, 2] += 25.0
    for rtol, most in ((1e-3, 0.03), (1e-6, 0.001), (1e-9, 0.001)):
        states = np.empty((1, *x0.shape))
        settings = batch_solver.Settings(rtol)
        found = Counting(f, np.zeros(0), x0, np.array([20.0]), 1.0, settings, states)
        found.run()
        assert found.implicit_steps <= most * found.steps.sum()


# Values of the test set for initial value problems, and the most steps at each tolerance.
@pytest.mark.parametrize(
    ("function", "x0", "last", "right", "steps"),
    [
        (van_der_pol, [2.0, 0.0], 2000.0, [1.706167732170469], (90, 150, 300)),
        (robertson, [1.0, 0.0, 0.0], 4e5, [4.93827451e-3], (40, 60, 110)),
    ],
)
def test_stiff_problems(function, x0, last, right, steps):
    f = right_hand_side(function, len(x0))
    for rtol, most in zip((1e-3, 1e-6, 1e-9), steps, strict=True):
        states, _, taken, _ = motion(f, np.array([x0]), [last], rtol)
        np.testing.assert_allclose(states[0, 0, : len(right)], right, rtol=20.0 * rtol + 1e-8)
        assert taken[0] <= most


@pytest.mark.parametrize("name", CASES)
def test_one_step_at_a_time_has_the_bits_of_all_at_once(name):
    f, x0, T = CASES[name]
    f, settings = right_hand_side(f, x0.shape[1]), batch_solver.Settings(1e-6)
    states, *others = motion(f, x0, [T])
    for k, x in enumerate(x0):
        *_, (t, steps, end) = single_steps.attempts(f, np.zeros(0), x, T, settings)
        assert (t, steps) == (others[0][k], others[1][k])
        if others[2][k] == LaneState.DONE:
            np.testing.assert_array_equal(end, states[0, k])


@pytest.mark.parametrize(
    ("count", "derivatives", "chooses"),
    [(1, (), False), (9, ("x0", "a"), True), (9000, (), True), (9000, ("x0", "a"), False)],
)
def test_code_is_made_before_there_are_states(monkeypatch, count, derivatives, chooses):
    """LLVM ends the process where large states have taken the memory."""
    other = (lambda y: np.where(y > 0.0, y, 2.0 * y)) if chooses else np.sin
    k = next(_NEW)  # so that no code is there
    field = Field(lambda x, a: (x[1], -a * other(x[0]) - k * x[1]), 2, a=1.0)
    order = []

    def noting(name, module, attribute):
        function = getattr(module, attribute)

        def noted(*arguments):
            order.append(name)
            return function(*arguments)

        monkeypatch.setattr(module, attribute, noted)

    noting("code", compiler, "_compile")
    noting("states", integration, "empty_result")
    x0 = np.random.default_rng(1).normal(size=(count, 2))
    assert flow(field, x0, time=np.linspace(0.0, 1.0, 90), derivatives=derivatives).ok.all()
    assert order[0] == "code"
    assert "code" not in order[order.index("states") :] if "states" in order else True
    assert order.count("code") == (
        2 if count * 2 * 90 * (1 + len(derivatives) * 1.5) > 2**20 else 1
    )


_NEW = itertools.count(0.125, 0.125)


def test_equal_times_of_changes_act_all():
    times = np.sort(np.random.default_rng(0).integers(0, 9, (30, 14)).astype(float), axis=1)
    times[:, 11:] = np.inf
    still, more = Field(lambda x: (0 * x[0],), "x"), lambda x: (x[0] + 1,)
    for own, shape in ((times, (30, 1)), (times[0], (1,))):
        motion = flow(still, np.zeros(shape), time=9.0, events=sf.Event(times=own, to=more))
        assert (motion.final == 11.0).all()
        assert (motion.events.count == 11).all()
