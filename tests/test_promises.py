"""Properties of all public functions on batches: one table of functions, one test per property.

A row is a function with sample arguments for each class of bodies that it accepts. Values have
the axes of the batch first, then time, then components.
"""

import inspect
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import _checks
from suslov_fast._bodies.base import Body
from suslov_fast._engine import closed_form_runs, evaluation, methods, threads
from suslov_fast._engine import execution as engine
from suslov_fast._kernels import blocks, tiles
from suslov_fast._kernels.blocks import LANES
from suslov_fast._maps import map_of
from suslov_fast._states import lyapunov

# No body has the I3 of some runs of the scheme in three components.
pytestmark = pytest.mark.filterwarnings("ignore:I3")
SIZE, STEPS = LANES + 13, 12
# None: tested only if moments and products have one unit, so that eps has the unit of time.
TURNS = (0, None, 0)


def body_3d(rng, shape, **more):
    products = rng.uniform(-1, 1, (2, *shape)) * [rng.choice([0, 1, 1], shape), np.ones(shape)]
    return sf.Suslov3D(*rng.uniform(0.5, 4, (2, *shape)), *products, **more)


def nd(rng, shape, J, m):
    return sf.SuslovND(J * np.ones(m), rng.uniform(-1, 1, (*shape, m)))


@dataclass(frozen=True, eq=False, repr=False)
class Chain(Body):
    """A body with a field alone, x_i' = growth x_i + prey x_i (x_(i+1) - x_(i-1)) of three x_i."""

    growth: Any
    prey: Any

    _meanings: ClassVar = {"growth": "rate", "prey": "rate for each"}
    dimension, _labels = 3, ("a", "b", "c")

    def field(self):
        one = np.eye(3)
        q = one[:, :, None] * (np.roll(one, 1, axis=1) - np.roll(one, -1, axis=1))[:, None]
        growth, prey = (np.asarray(each)[..., None, None] for each in self.parameters)
        return sf.QuadraticField(prey[..., None] * q, growth * one)


# Functions of (rng, shape) that make sample bodies, and the number of components of a state.
KINDS = {
    "3D": (body_3d, 2),
    "full": (lambda r, shape: body_3d(r, shape, I3=r.uniform(1, 5, shape)), 3),
    "gyrostat": (
        lambda r, shape: sf.SuslovGyrostat(
            *r.uniform(0.5, 4, (2, *shape)), *r.uniform(-1, 1, (3, *shape))
        ),
        2,
    ),
    "nD": (lambda r, shape: nd(r, shape, r.uniform(0.5, 4, (*shape, 4)), 4), 4),
    "solved": (lambda r, shape: nd(r, shape, r.uniform(0.5, 4, (*shape, 1)), 3), 3),
    "field": (
        lambda r, shape: sf.QuadraticField(
            *(r.normal(size=(*shape, *(5,) * axes)) / 10 for axes in (3, 2, 1))
        ),
        5,
    ),
    "own": (lambda r, shape: Chain(*r.normal(size=(2, *shape)) / 10), 3),
}


class Row(NamedTuple):
    """`call(body, omega, eps, **options)` returns results; those in `timed` have time first.

    `units` are the exponents of the units of moments, products and omega in each result.
    """

    call: Callable[..., Any]
    kinds: tuple[str, ...]
    units: tuple[Any, ...]
    timed: tuple[int, ...] = ()
    name: str = "omega"
    threads: bool = True
    steps: bool = True  # eps is an argument

    def values(self, body, omega, eps, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sf.SingularStepWarning)
            results = self.call(body, omega, eps, **options)
        results = results if isinstance(results, tuple) else (results,)
        axes = len(self.batch(body, omega, eps))
        for k, each in enumerate(results):
            yield np.moveaxis(each, 0, axes) if k in self.timed else np.asarray(each)

    def batch(self, body, omega, eps):
        of_eps = np.shape(eps) if self.steps else ()
        return np.broadcast_shapes(body.shape, np.shape(omega)[:-1], of_eps)


def of_steps(call, kinds, *units, **more):
    return Row(call, tuple(kinds.split()), units, **more)


def of_states(function, *table, **more):
    return of_steps(lambda b, w, e, **o: function(b, w, **o), *table, steps=False, **more)


def runs(kinds, function=sf.iterate, **options):
    """Row of saved and last states, with the orientation if the run has it."""

    def call(body, omega, eps, **others):
        run = function(body, omega, eps, STEPS, on_singular="ignore", **options, **others)
        more = (run.attitude,) if run.attitude is not None else ()
        return run.states, run.final, run.status, run.failed_at, *more

    products = None if function is sf.iterate_full else 0
    units = [(0, products, 1)] * 2 + [(0, products, 0)] * 2
    return of_steps(call, kinds, *units, TURNS, timed=(0, 4), name="omega0")


def orientations(body, omega, eps, **options):
    run = sf.iterate(body, omega, eps, STEPS, on_singular="ignore")
    return sf.attitude(body, run.omega, eps, **options)


def solutions(body, omega, eps, **options):
    return tuple(sf.exact(body, omega, eps, n, **options) for n in (7, FORWARD, SCATTERED))


FORWARD, SCATTERED = np.arange(3, 43), np.array([-1e9, -3, 0, 7, 700, 1e9])
ROWS = {
    "energy": of_states(sf.energy, "3D gyrostat nD", (1, 0, 2)),
    "first_integral": of_steps(sf.first_integral, "3D gyrostat solved", (-1, 0, 2)),
    "modified_energy": of_steps(sf.modified_energy, "3D gyrostat nD", (1, 0, 2)),
    "criticality": of_steps(sf.criticality, "3D gyrostat solved", (0, 0, 0)),
    "rotation_number": of_steps(sf.rotation_number, "3D gyrostat", (0, 0, 0)),
    "invariant_density": of_steps(sf.invariant_density, "3D gyrostat", (-2, -1, -1)),
    "to_xy": of_states(sf.to_xy, "3D", [(0, 1, 1), (1, 1, 1)]),
    "from_xy": of_states(sf.from_xy, "3D", name="xy"),
    "vector_field": of_states(sf.vector_field, "3D gyrostat nD field own", (-1, 1, 2)),
    "reaction": of_states(sf.reaction, "3D gyrostat nD", (1, None, 2)),
    "discrete reaction": of_steps(sf.reaction, "3D gyrostat nD", (1, None, 2)),
    "jacobian": of_steps(sf.jacobian, "3D gyrostat nD field own", (0, 0, 0)),
    "matrix": of_steps(sf.matrix, "3D gyrostat nD field own", (0, 0, 0)),
    "closed_form": of_steps(
        sf.closed_form, "3D", (0, 2, 2), (-1, 1, 1), (0, 0, 0), (0, 0, 0), name="omega0"
    ),
    "step": of_steps(sf.step, "3D gyrostat nD solved field", (0, 0, 1), threads=False),
    "step_full": of_steps(sf.step_full, "full", (0, None, 1), threads=False),
    "iterate": runs("3D gyrostat nD solved field", save_every=3),
    "iterate: last states": runs("3D gyrostat nD solved field", save_every=None),
    "iterate: orientation": runs("3D gyrostat nD", attitude=True, save_every=2),
    "iterate: canonical": runs("3D gyrostat", method="canonical"),
    "iterate: ds2": runs("3D", method="ds2", attitude=True),
    "iterate: rank2": runs("nD solved", method="rank2"),
    "iterate: gauss": runs("nD", method="gauss"),
    "iterate_full": runs("full", sf.iterate_full, save_every=3),
    "iterate_full: last states": runs("full", sf.iterate_full, save_every=None),
    "exact": of_steps(
        solutions, "3D gyrostat solved", *[(0, 0, 1)] * 3, timed=(1, 2), name="omega0"
    ),
    "flow": of_states(
        lambda b, w, **o: (sf.flow(b, w, 0.7, **o), sf.flow(b, w, FORWARD / 8, **o)),
        "3D gyrostat solved", timed=(1,), name="omega0",
    ),
    "limits": of_steps(sf.limits, "3D gyrostat solved", (0, 0, 1), (0, 0, 1), name="omega0"),
    "attitude": of_steps(orientations, "3D gyrostat nD", TURNS, timed=(0,), name="omega0"),
    "lyapunov_exponents": of_steps(
        lambda b, w, e, **o: sf.lyapunov_exponents(b, w, e, STEPS, **o),
        "3D gyrostat nD field own", (0, 0, 0), name="omega0",
    ),
    "to_matrix": of_states(sf.to_matrix, "3D gyrostat nD", (0, 0, 1), threads=False),
    "to_vector": of_states(sf.to_vector, "3D gyrostat", (0, 0, 1), threads=False),
    "momentum": of_states(sf.momentum, "3D gyrostat nD", (1, None, 1), threads=False),
}  # fmt: skip
every_case = pytest.mark.parametrize(
    ("name", "kind"),
    [
        pytest.param(name, kind, id=f"{name}, {kind}")
        for name, row in ROWS.items()
        for kind in row.kinds
    ],
)


def test_every_function_of_states_is_in_the_table():
    functions = {name: getattr(sf, name) for name in sf.__all__ if name.islower()}
    batched = {n for n, f in functions.items() if "threads" in inspect.signature(f).parameters}
    assert batched - {name.split(":")[0] for name in ROWS} == set()


def sample(rng, kind, body=(SIZE,), omega=(SIZE,), eps=(SIZE,)):
    """Bodies, states and step sizes of these shapes: t below and above 1, eps of both signs."""
    make, D = KINDS[kind]
    size = 10 ** rng.uniform(-1, 1, (*omega, 1))
    return make(rng, body), rng.normal(size=(*omega, D)) * size, rng.uniform(-0.5, 0.5, eps)


def part(body, index, batch):
    parts = {}
    for name, value in body._values.items():
        own = np.shape(value)[np.ndim(value) - body._axes(name) :]
        parts[name] = np.broadcast_to(value, (*batch, *own))[index]
    return type(body)(**parts)


def same(first, second):
    """Compare bit for bit."""
    for one, other in zip(first, second, strict=True):
        assert one.shape == other.shape
        np.testing.assert_array_equal(one, other)


# Shapes of the body, of omega but for its last axis, and of eps.
SHAPES = [((SIZE,),) * 3, ((2, 1), (3,), (5, 1, 1)), ((), (4, 2), (2,)), ((3,), (0, 3), ())]


@every_case
def test_a_batch_is_a_loop_in_any_order(rng, name, kind):
    row = ROWS[name]
    for shapes in SHAPES:
        body, omega, eps = sample(rng, kind, *shapes)
        batch, values = row.batch(body, omega, eps), list(row.values(body, omega, eps))
        state = np.broadcast_to(omega, (*batch, omega.shape[-1]))
        step = np.broadcast_to(eps if row.steps else 0.0, batch)
        assert all(each.shape[: len(batch)] == batch for each in values)
        some = [i for i in np.ndindex(batch) if i[0] in (*range(8), LANES - 1, LANES, SIZE - 1)]
        for index in (*some, rng.permutation(batch[0])):
            alone = row.values(part(body, index, batch), state[index], step[index])
            same(alone, [each[index] for each in values])


# One function for each kind of loop: parallel loops compile slowly, and the others are slow tests.
THREADED = [
    ("vector_field", "3D"), ("iterate", "3D"), ("iterate: canonical", "3D"), ("exact", "3D"),
    ("attitude", "3D"), ("iterate", "field"), ("iterate: rank2", "nD"),
]  # fmt: skip


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        pytest.param(name, kind, marks=[pytest.mark.slow] * ((name, kind) not in THREADED))
        for name, row in ROWS.items()
        for kind in row.kinds
        if row.threads
    ],
)
def test_threads(rng, monkeypatch, name, kind):
    row, problem_of = ROWS[name], sample(rng, kind)
    alone = list(row.values(*problem_of, threads=1))
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    same(alone, list(row.values(*problem_of, threads=2)))
    same(alone, list(row.values(*problem_of)))


@every_case
def test_calls_in_parts(rng, monkeypatch, small_parts, name, kind):
    row, problem_of = ROWS[name], sample(rng, kind)
    pieces = list(row.values(*problem_of))
    monkeypatch.undo()
    whole = list(row.values(*problem_of))
    same(pieces, whole)
    for module, constant, value in (
        (evaluation, "SLAB", 16), (evaluation, "NUMBERS", 16), (evaluation, "TASKS", 1),
        (closed_form_runs, "SLICE", 2**10), (lyapunov, "_SLAB", 2**8),
    ):  # fmt: skip
        monkeypatch.setattr(module, constant, value)
    same(row.values(*problem_of), whole)


# Powers of two of the moments, of the products of inertia and of omega. Orbits of the sample stay
# bounded: others would overflow earlier in large units.
UNITS = [
    (0, 0, 300), (0, 0, -500), (600, 600, 0), (-600, -600, 0), (200, -300, 10), (-300, 200, 200),
    (400, 400, -300), (0, 600, -600),
]  # fmt: skip


# For runs of the map alone, up to the ends of the range of float64.
UNITS_OF_RUNS = [*UNITS, (0, 0, 990), (0, 0, -990)]


# The exponents of the units of moments, products and omega in parameters, by name.
UNITS_OF = dict.fromkeys(("I1", "I2", "I3", "J"), (1, 0, 0)) | {
    **dict.fromkeys(("I13", "I23", "I"), (0, 1, 0)), "k": (0, 1, 1), "quadratic": (-1, 1, 0),
    "linear": (-1, 1, 1), "constant": (-1, 1, 2), "growth": (-1, 1, 1), "prey": (-1, 1, 0),
}  # fmt: skip


def in_units(body, units):
    powers = {name: int(np.dot(UNITS_OF[name], units)) for name in body._values}
    return type(body)(**{n: np.ldexp(v, powers[n]) for n, v in body._values.items()})


@every_case
def test_units(rng, name, kind):
    """Powers of two of the units change no bit of a result that float64 can hold."""
    row, (body, omega, eps) = ROWS[name], sample(rng, kind, (20,), (20,), (20,))
    if not row.units:  # such as `flow`, whose times have a unit, too
        return
    before = list(row.values(body, omega, eps))
    rounding = 1e-13 if kind == "solved" else 0.0
    far = kind == "3D" and name.startswith("iterate")
    for units in UNITS_OF_RUNS if far else UNITS:
        moments, products, omegas = units
        other = in_units(body, units)
        moved = np.ldexp(omega, omegas), np.ldexp(eps, moments - products - omegas)
        after = row.values(other, *moved)
        for one, two, unit in zip(before, after, row.units, strict=False):
            powers = np.array(unit, object).reshape(-1, 3)
            if None in powers and moments != products:
                continue
            power = (np.where(powers == None, 0, powers) @ np.array(units)).tolist()  # noqa: E711
            if max(map(abs, power)) < 1000:
                scaled = np.ldexp(one, power if len(power) > 1 else power[0]) if any(power) else one
                np.testing.assert_allclose(two, scaled, rtol=rounding, atol=0, err_msg=str(units))


@every_case
def test_nan_is_passed_on_without_a_warning(rng, name, kind):
    row, (body, omega, eps) = ROWS[name], sample(rng, kind)
    expected = list(row.values(body, omega, eps))
    omega[3, 0] = omega[17, 1] = omega[20] = np.nan
    missing = np.isnan(omega).any(axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values = list(row.values(body, omega, eps))
    for before, after in zip(expected, values, strict=True):
        same([after[~missing]], [before[~missing]])
        if after.dtype == np.float64:
            assert np.isnan(after[missing]).all()
    if name.startswith("iterate"):
        assert (values[2][missing] == sf.Status.NONFINITE).all()
        assert (values[3][missing] == 0).all()


@every_case
def test_any_memory(rng, name, kind):
    row, (body, omega, eps) = ROWS[name], sample(rng, kind, (6,), (5, 6), ())
    omega = np.asarray(omega, np.float32).astype(float)
    kept, expected = omega.copy(), list(row.values(body, omega, eps))
    frozen = omega.copy()
    frozen.flags.writeable = False
    unaligned = np.frombuffer(b"x" + omega.tobytes(), np.float64, offset=1).reshape(omega.shape)
    strided = np.repeat(np.repeat(omega, 2, axis=0), 2, axis=-1)[::2, :, ::2]
    compiled = len(getattr(blocks.canonical.compiled, "signatures", ()))
    for given in (
        frozen, unaligned, strided, np.asfortranarray(omega), omega.tolist(), omega.astype(">f8"),
        omega.astype(object), omega.astype(np.float32), np.ma.masked_array(omega),
    ):  # fmt: skip
        same(row.values(body, given, eps), expected)
    assert (omega == kept).all()
    assert all(each.dtype != np.float32 for each in expected)
    assert len(getattr(blocks.canonical.compiled, "signatures", ())) in (compiled, compiled + 1)


@every_case
@pytest.mark.parametrize("many", [False, True])
def test_infinite_states_are_errors(rng, monkeypatch, name, kind, many):
    """Infinite states raise an error; in arrays of LARGE size, kernels detect them."""
    if many:
        for module in (_checks, evaluation):
            monkeypatch.setattr(module, "LARGE_ARRAY", 64)
    row, (body, omega, eps) = ROWS[name], sample(rng, kind, (9,), (10, 9), ())
    omega[3, 2, 1] = -np.inf
    with pytest.raises(ValueError, match=rf"{row.name}: .* got -inf at index \(3, 2, 1\)"):
        list(row.values(body, omega, eps))


@every_case
def test_bad_input(rng, name, kind):
    row, (body, omega, eps) = ROWS[name], sample(rng, kind, (), (), ())
    with pytest.raises(ValueError, match=rf"{row.name}: expected shape \(..., {len(omega)}\)"):
        list(row.values(body, np.append(omega, 1.0), eps))
    with pytest.raises(TypeError, match=r"body: expected Suslov3D.*, got int"):
        row.call(1, omega, eps)
    if row.steps:
        with pytest.raises(ValueError, match="eps: expected finite real numbers, got inf"):
            list(row.values(body, omega, np.inf))
        with pytest.raises(ValueError, match=r"expected batch shapes that broadcast"):
            row.call(body, np.stack([omega, omega]), np.ones(3))
    if row.threads:
        with pytest.raises(ValueError, match="threads: expected"):
            list(row.values(body, omega, eps, threads=0))
    for other in {"3D", "gyrostat", "nD"} - set(row.kinds):
        with pytest.raises((TypeError, ValueError), match="expected"):
            list(row.values(*sample(rng, other, (), (), ())))


def hard_steps(rng, size, m):
    """Problems for every branch of a step: d at or next to 0, singular A, all speeds, NaN."""
    J, I = rng.uniform(1, 4, (size, m)), rng.normal(size=(size, m))
    J[::2], J[1::4, -1] = 2.0, J[1::4, 0]
    eps = rng.choice([-0.5, 0.1, 1.0], size)
    omega = rng.normal(size=(size, m)) * 10 ** rng.uniform(-2, 2, (size, 1))
    gap = rng.choice([0.0, 1e-9, 1e-3], size)
    near = rng.random(size) < 0.5
    omega[near] *= (2 * J[:, 0] * (1 - gap) / (eps * (I * omega).sum(axis=1)))[near, None]
    gaps = np.sort(abs(1 - eps[:, None] / 2 * (I * omega).sum(axis=1)[:, None] / J))
    assert m == 1 or (gaps[:, 1] < 0.1).any()  # two small d, for which the step uses elimination
    omega[::7] *= 1e300
    omega[4] = np.nan
    return sf.SuslovND(J, I), omega, eps


def subnormal_states(rng, size, m):
    body = sf.SuslovND(rng.uniform(1, 4, (size, m)), 1e5 * rng.normal(size=(size, m)))
    omega = rng.uniform(1, 3, (size, m)) * np.exp2(rng.integers(-1074, -1000, (size, 1)))
    return body, omega, rng.uniform(0.05, 1.5, size) * 1e300


def solved_bodies(rng, size, m):
    """Random J and I with a closed form: all J equal, or I along one axis and the other J equal."""
    J, I = rng.uniform(1, 4, (size, 1)) * np.ones(m), rng.normal(size=(size, m))
    along = np.arange(m) == rng.integers(m, size=(size, 1))
    J[1::2] *= np.where(along, 10 ** rng.uniform(-1, 1, (size, 1)), 1)[1::2]
    I[1::2] *= along[1::2]
    return J, I


def solved_and_others(rng, size, m):
    """Bodies with and without a closed form, and all kinds of states, including poles."""
    J, I = solved_bodies(rng, size, m)
    J[::5, 0] *= 1.5  # no closed form any more, except for n = 3 or I along e_1
    I[3::11] = 0.0
    eps = rng.choice([-0.5, 0.0, 0.1, 0.5], size)
    omega = rng.normal(size=(size, m)) * 10 ** rng.uniform(-1, 1.5, (size, 1))
    omega[4::13] = I[4::13] * rng.uniform(-2, 2, (len(omega[4::13]), 1))
    omega[2::17] *= 1e90
    omega[6] = np.nan
    J[1], I[1], omega[1], eps[1] = 1.0, 0.0, 0.0, 1.0
    I[1, 0], omega[1, :2] = 1.0, [3.0, 1.0][:m]  # at a pole
    return sf.SuslovND(J, I), omega, eps


def one_body(rng, size, m):
    J, I = solved_bodies(rng, 2, m)
    return sf.SuslovND(J[size % 2], I[size % 2]), rng.normal(size=(size, m)), np.full(size, 0.2)


def hard_orbits(rng, size, m):
    """States at, next to and before poles, and of all speeds, some of whose steps are guarded."""
    body, x = sf.Suslov3D(1, 1, 1, 0), 10 ** rng.uniform(-2, 5, size)
    gap = rng.choice([0.0, 1e-12, 1e-6, 0.5, 2.0, 30.0], size)
    omega, eps = np.column_stack([x, -(2 + x * x) * (1 - gap)]), np.ones(size)
    for k in range(1, 4):
        omega[k::9] = [1.0, -3.0]  # a pole after several steps
        for _ in range(k):
            omega[k::9] = sf.step(body, omega[k::9], -1)
    omega[::7] *= 1e150
    omega[4] = np.nan
    return body, omega, eps


# Problems, the methods that they test, and numbers of components.
HARD = [
    *((hard_orbits, method, 2) for method in ("auto", "canonical", "ds2")),
    *((hard_steps, method, m) for method in ("rank2", "gauss") for m in (1, 2, 4, 9)),
    *((subnormal_states, method, 3) for method in ("rank2", "gauss")),
    *((solved_and_others, "auto", m) for m in (1, 2, 3, 8)),
    (one_body, "auto", 4),
]


def run(body, omega, eps, steps, **options):
    return sf.iterate(body, omega, eps, steps, on_singular="ignore", **options)


def assert_same_run(first, second, chosen=slice(None)):
    """Compare a run with chosen trajectories of another, bit for bit."""
    for name in ("final", "status", "failed_at"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name)[chosen], name)
    np.testing.assert_array_equal(first.states, second.states[:, chosen])
    assert (first.attitude is None) == (second.attitude is None)
    if first.attitude is not None:
        np.testing.assert_array_equal(first.attitude, second.attitude[:, chosen])


@pytest.mark.parametrize(("make", "method", "m"), HARD)
@pytest.mark.parametrize("save_every", [1, 5, None])
def test_hard_problems(rng, monkeypatch, request, make, method, m, save_every):
    """Batch, order, parts, threads, and saved states of a named method change no bit.

    "auto" and "rank2" miss the same states.
    """
    body, omega, eps = make(rng, 100, m)
    options = {"steps": 300 if method == "auto" else 30, "save_every": save_every, "method": method}
    options["attitude"] = method != "auto"
    whole = run(body, omega, eps, **options)
    assert not np.isinf(whole.omega).any()
    if make in (hard_steps, solved_and_others, hard_orbits):
        few = m < 3 and make is not hard_orbits
        assert set(whole.status) >= ({-2, 0} if few else {-2, -1, 0})
    if method != "auto":
        every = run(body, omega, eps, **options | {"save_every": 1})
        np.testing.assert_array_equal(whole.omega, every.omega[whole.n])
        np.testing.assert_array_equal(whole.attitude, every.attitude[whole.n])
    if make is subnormal_states and save_every == 1:
        assert (np.ptp(whole.omega, axis=0) > 0).any()
    if method == "auto" and make is not hard_orbits:
        iterated = run(body, omega, eps, **options | {"method": "rank2"})
        assert (whole.status == iterated.status).all()
        assert (whole.failed_at == iterated.failed_at).all()
        assert (np.isnan(whole.omega) == np.isnan(iterated.omega)).all()
    for i in (rng.permutation(100), 0, 1, 2, 3, 4, 5, 14, 33, 63, 64, 99):
        alone = part(body, i, (100,)) if body.shape else body
        assert_same_run(run(alone, omega[i], eps[i], **options), whole, i)
    request.getfixturevalue("small_parts")
    monkeypatch.setattr(closed_form_runs, "SLICE", 2**12)
    monkeypatch.setattr(methods, "_EXPANDED", 2**11)
    monkeypatch.setattr(engine, "_COPIED", 2**12)
    monkeypatch.setattr(threads, "CROSSOVER", 1)
    seen = []
    parts = run(body, omega, eps, threads=2, progress=lambda *n: seen.append(n), **options)
    assert_same_run(parts, whole)
    assert seen == sorted(seen)
    assert seen[-1] == (options["steps"],) * 2


@pytest.mark.parametrize("k", [-1000, -600, 600, 1000])
@pytest.mark.parametrize(
    ("make", "method", "m"),
    [each for each in HARD if each[0] not in (hard_orbits, subnormal_states)],
)
def test_units_of_hard_problems(rng, make, method, m, k):
    body, omega, eps = make(rng, 30, m)
    omega = np.clip(omega, -1e3, 1e3)
    k = k if method != "auto" else k * 4 // 5  # larger exponents are iterated
    for save_every in (1, None):
        options = {"method": method, "save_every": save_every}
        expected = run(body, omega, eps, 40, **options)
        for units in ((0, 0, k), (k, k, 0), (0, k, 0)):
            moments, products, omegas = units
            moved = np.ldexp(omega, omegas), np.ldexp(eps, moments - products - omegas)
            far = run(in_units(body, units), *moved, 40, **options)
            np.testing.assert_array_equal(np.ldexp(far.omega, -omegas), expected.omega)
            assert (far.status == expected.status).all()


CUTS = ((30, (15, 15)), (30, (0, 1, 28, 1)), (300, (20, 280)), (300, (256, 44)))


@pytest.mark.parametrize("save_every", [1, 4, None])
@pytest.mark.parametrize(
    ("kind", "method", "attitude", "m"),
    [
        *(("3D", method, turns, 2) for method in ("auto", "canonical", "ds2") for turns in (0, 1)),
        ("gyrostat", "canonical", 0, 2),
        *((kind, "auto", turns, 3) for kind in ("gyrostat", "nD", "solved") for turns in (0, 1)),
        ("nD", "gauss", 0, 4), ("field", "auto", 0, 5), ("full", None, 0, 3),
        *((*each[:2], 0, each[2]) for each in HARD),
    ],
)  # fmt: skip
def test_extended_runs(rng, kind, method, attitude, m, save_every):
    if kind in KINDS:
        body, omega, eps = sample(rng, kind, (9,), (9,), (9,))
        omega[3, 0], eps[4] = np.nan, 0.0
    else:
        body, omega, eps = kind(rng, 70, m)
    begin = sf.iterate_full if kind == "full" else sf.iterate
    options = {} if kind == "full" else {"method": method, "attitude": bool(attitude)}
    options |= {"save_every": save_every, "on_singular": "ignore"}
    for steps, cuts in CUTS:
        whole = begin(body, omega, eps, steps, **options)
        first = extended = begin(body, omega, eps, cuts[0], **options)
        for more in cuts[1:]:
            extended = extended.extend(more, on_singular="ignore")
        assert_same_run(extended, whole)
        np.testing.assert_array_equal(extended.n, whole.n)
        again = first.extend(cuts[1], on_singular="ignore")  # `extend` leaves the run unchanged
        assert_same_run(again.extend(sum(cuts[2:]), on_singular="ignore"), whole)


ANY, LARGE = [[0.3, -0.7], [2.5, 1.0], [0.0, 0.0]], [1e305, -1e-305]
TINY = [[0.0, 0.0], [5e-324, 0.0], [0.0, -5e-324], [2.0**-1022, -(2.0**-1023)]]
OF_4D = [[[1e200, 1e-200, 1.0]], [[5e-324, 0.0, -1.7e308]], [[-0.0, 0.0, 1e-310]]]
STILL = [
    (sf.Suslov3D(2, 3, 0, 0), [*ANY, LARGE], 0.5),
    (sf.Suslov3D(1e50, 1e-50, 0, 0), [*ANY, LARGE], 1.0),
    (sf.Suslov3D(4, 1, -0.5, -0.3), [*ANY, LARGE], 0.0),
    (sf.Suslov3D(1e-300, 1e-300, 1e300, 0), [*ANY, LARGE], 0.0),
    (sf.Suslov3D(1, 1, 1, 0), TINY, 1.0),
    (sf.SuslovND([1.0, 2.0, 3.0], [[0.0] * 3, [1.0, 0.0, 1.0], [0.0] * 3]), OF_4D, [0.3, 0.0, 0]),
    # With a closed form: I = 0, eps = 0, steady states, and one component.
    (sf.SuslovND([2.0] * 3, [[0.0] * 3, [0.1, 0.2, 0.3]]), [[0.3, 0.9, -0.6]], [0.3, 0.0]),
    (sf.SuslovND([2.0] * 3, [0.5, -1.0, 0.25]), [1.0, -2.0, 0.5], 0.3),
    (sf.SuslovND([2.0] * 3, [0.0, 0.7, 0.0]), [0.0, -0.3, 0.0], 0.3),
    (sf.SuslovND([3.0], [0.7]), [[0.3], [-5.0]], 0.2),
]


@pytest.mark.parametrize(("body", "omega", "eps"), STILL)
def test_states_at_rest_keep_their_bits(body, omega, eps):
    for method in map_of(body).methods:
        for save_every in (1, 40, None):
            run = sf.iterate(body, omega, eps, 50, method=method, save_every=save_every)
            for each in (run, run.extend(40)):
                assert each.ok
                assert (each.omega == omega).all()
                assert (each.final == omega).all()
    assert (sf.step(body, omega, eps) == omega).all()
    if len(set(np.ravel(body.parameters[0]))) == 1:  # a closed form
        far = 10**12 if body.dimension > 2 else 10**15
        assert (sf.exact(body, omega, eps, [-far, 7, far]) == omega).all()
        assert (np.array(sf.limits(body, omega, eps)) == omega).all()
        assert (sf.iterate(body, omega, eps, far, save_every=far // 4).omega == omega).all()


@pytest.mark.parametrize("batch", [1, 7, LANES - 3, 3 * LANES + 5])
@pytest.mark.parametrize(
    ("kind", "method", "m"),
    [
        ("3D", "auto", 2), ("3D", "canonical", 2), ("gyrostat", "auto", 2),
        *(("nD", "rank2", m) for m in (1, 3, 8, 24)), *(("solved", "auto", m) for m in (1, 3, 8)),
    ],
)  # fmt: skip
def test_memory_of_saved_states(rng, monkeypatch, kind, method, m, batch):
    """States do not depend on the alignment or size of `out`, and nothing else is written."""
    large = 2**14 if numba.config.DISABLE_JIT else tiles._LARGE
    monkeypatch.setattr(tiles, "_LARGE", 0)  # for interpreted kernels
    monkeypatch.setattr(closed_form_runs, "SLICE", 2**19)
    long = kind in ("3D", "gyrostat") and batch in (1, 3 * LANES + 5)
    rows = large // (2 * batch) + 79 if long else 70
    J = rng.uniform(1, 4, m) if kind == "nD" else np.full(m, 2.5)
    body = sf.SuslovND(J, rng.normal(size=m) / np.sqrt(m))
    body = sf.Suslov3D(4, 1, -0.5, -0.3) if kind == "3D" else body
    body = sf.SuslovGyrostat(4, 1, -0.5, -0.3, 0.2) if kind == "gyrostat" else body
    omega, size = rng.normal(size=(batch, m)) / m, m * batch * rows
    chosen = [0, batch // 2, -1]
    expected = sf.iterate(body, omega[chosen], 0.2, rows - 1, method=method).omega
    for start in (8, 9, 11):
        room = np.full(size + 24, np.pi)
        out = room[start : start + size].reshape(rows, batch, m)
        sf.iterate(body, omega, 0.2, rows - 1, method=method, out=out, threads=1)
        assert (out[:, chosen] == expected).all()
        assert (np.delete(room, slice(start, start + size)) == np.pi).all()


@pytest.mark.parametrize("kind", ["3D", "full", "nD"])
def test_out(rng, kind):
    """States are written to `out`, also if it overlaps the arguments."""
    body, omega, _ = sample(rng, kind, (), (2, 3), ())
    begin, D = sf.iterate_full if kind == "full" else sf.iterate, omega.shape[-1]
    expected = begin(body, omega, 0.1, 33, save_every=2)
    out, last = np.full((17, 2, 3, D), 7.0), np.empty((1, 2, 3, D))
    given = begin(body, omega, 0.1, 33, save_every=2, out=out)
    assert given.omega is out
    assert_same_run(given, expected)
    assert begin(body, omega, 0.1, 33, out=last, save_every=None).omega is last
    np.testing.assert_allclose(last[0], expected.final, rtol=1e-13)
    over = rng.normal(size=6 * D)
    expected = begin(body, over[:D].copy(), over[D : D + 2].copy(), 2)
    given = begin(body, over[:D], over[D : D + 2], 2, out=over.reshape(3, 2, D))
    assert_same_run(given, expected)
    assert (given.eps == expected.eps).all()
