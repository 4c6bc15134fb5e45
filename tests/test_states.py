"""All functions of a state: shapes, NaN, infinite states, units, threads."""

from types import SimpleNamespace

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import _checks
from suslov_fast._engine import states as engine
from suslov_fast._engine import states_nd as engine_nd
from suslov_fast._engine import threads
from suslov_fast._jit import Kernel
from suslov_fast._kernels import states as kernels


def with_step(function):
    return lambda body, omega, eps, **options: function(body, omega, eps, **options)


def without_step(function):
    return lambda body, omega, eps, **options: function(body, omega, **options)


def closed_form(body, omega, eps, **options):
    return np.stack(sf.closed_form(body, omega, eps, **options), axis=-1)


def quantity(call, unit, nd=False, step=True, name="omega"):
    return SimpleNamespace(call=call, unit=np.array(unit), nd=nd, step=step, name=name)


# Units: the powers of that of moments, of products of inertia and of omega, for each number. The
# step size has the unit moments / (products omega).
QUANTITIES = {
    "energy": quantity(without_step(sf.energy), (1, 0, 2), True, False),
    "first_integral": quantity(with_step(sf.first_integral), (-1, 0, 2)),
    "modified_energy": quantity(with_step(sf.modified_energy), (1, 0, 2), True),
    "criticality": quantity(with_step(sf.criticality), (0, 0, 0)),
    "invariant_density": quantity(with_step(sf.invariant_density), (-2, -1, -1)),
    "to_xy": quantity(without_step(sf.to_xy), [(0, 1, 1), (1, 1, 1)], step=False),
    "vector_field": quantity(without_step(sf.vector_field), (-1, 1, 2), True, False),
    "reaction": quantity(without_step(sf.reaction), (1, None, 2), True, False),
    "discrete_reaction": quantity(with_step(sf.reaction), (1, None, 2), True),
    "jacobian": quantity(with_step(sf.jacobian), (0, 0, 0), True),
    "matrix": quantity(with_step(sf.matrix), (0, 0, 0), True),
    "closed_form": quantity(
        closed_form, [(0, 2, 2), (-1, 1, 1), (0, 0, 0), (0, 0, 0)], name="omega0"
    ),
}
DIMENSIONS = [(name, 2) for name in QUANTITIES] + [(n, 4) for n, q in QUANTITIES.items() if q.nd]
everywhere = pytest.mark.parametrize(("name", "m"), DIMENSIONS, ids=str)
in_3d = pytest.mark.parametrize("name", QUANTITIES)


def some_bodies(rng, m, shape=()):
    if m == 2:
        return sf.Suslov3D(*rng.uniform(0.5, 4, (2, *shape)), *rng.uniform(-1, 1, (2, *shape)))
    return sf.SuslovND(rng.uniform(0.5, 4, (*shape, m)), rng.uniform(-1, 1, (*shape, m)))


def parameters_at(body, batch, index):
    own = 1 if isinstance(body, sf.SuslovND) else 0
    for each in map(np.asarray, body.parameters):
        yield np.broadcast_to(each, (*batch, *each.shape[each.ndim - own :]))[index]


# Shapes of the body, of omega but for its last axis, and of eps.
SHAPES = [
    ((), (), ()), ((), (7,), ()), ((11,), (11, 11), ()), ((11,), (11, 11), (11,)),
    ((), (5, 11), (11,)), ((3,), (4, 300, 3), ()), ((300,), (4, 300), (300,)),
    ((4, 1), (3,), (2, 1, 1)), ((5, 1), (5, 6), (1,)), ((1, 6), (6,), (5, 1)),
    ((2, 3), (), ()), ((), (1,), (9, 1)), ((), (0, 3), ()), ((4,), (0, 4), ()),
]  # fmt: skip


@everywhere
@pytest.mark.parametrize("shapes", SHAPES, ids=str)
@pytest.mark.parametrize("cut", [False, True])
def test_a_batch_is_a_loop(rng, monkeypatch, name, m, shapes, cut):
    """Bit for bit, for whatever is broadcast, taken whole or slab after slab."""
    if cut:
        monkeypatch.setattr(engine, "SLAB", 16)
        monkeypatch.setattr(engine, "COPIES", 16)
        monkeypatch.setattr(engine_nd, "_COPIES", 4)
    q, (of_body, of_omega, of_eps) = QUANTITIES[name], shapes
    body = some_bodies(rng, m, of_body)
    omega, eps = rng.normal(size=(*of_omega, m)), rng.uniform(-0.1, 0.1, of_eps)
    batch = np.broadcast_shapes(of_body, of_omega, of_eps if q.step else ())
    values = q.call(body, omega, eps)
    assert values.shape[: len(batch)] == batch
    states = np.broadcast_to(omega, (*batch, m))
    steps = np.broadcast_to(eps if q.step else 0.0, batch)
    # LAPACK may round otherwise where matrices lie elsewhere in memory.
    rounding = 1e-14 if (name, m) == ("jacobian", 4) else 0.0
    for index in list(np.ndindex(batch))[:: max(1, values.size // 100)]:
        one = type(body)(*parameters_at(body, batch, index))
        alone = q.call(one, states[index], steps[index])
        np.testing.assert_allclose(values[index], alone, rtol=0, atol=rounding)


@in_3d
@pytest.mark.parametrize("shape", [(), (3,), (300,)])
def test_tasks(name, rng, monkeypatch, shape):
    """A task goes from block to block, and enters bodies where there are others."""
    body, omega = some_bodies(rng, 2, shape), rng.normal(size=(70, *(shape or (3,)), 2))
    expected = QUANTITIES[name].call(body, omega, 0.3)
    monkeypatch.setattr(engine, "TASKS", 1)
    assert np.array_equal(QUANTITIES[name].call(body, omega, 0.3), expected)


def test_as_many_bodies_as_saved_states(rng):
    """Bodies belong to the batch, never to time."""
    body, omega = some_bodies(rng, 2, (11,)), rng.normal(size=(11, 2))
    orbits = sf.iterate(body, omega, 0.1, 10)
    F = sf.first_integral(body, orbits.omega, 0.1)
    assert abs(F / F[0] - 1).max() < 1e-14


@in_3d
def test_any_memory_order(rng, name):
    omega, body, call = rng.normal(size=(5, 7, 2)), some_bodies(rng, 2, (7,)), QUANTITIES[name].call
    expected = call(body, omega, 0.3)
    frozen = omega.copy()
    frozen.flags.writeable = False
    shifted = np.frombuffer(b"x" + omega.tobytes(), np.float64, offset=1).reshape(omega.shape)
    strided = np.zeros((10, 7, 4))[::2, :, ::2]
    strided[...] = omega
    for same in (frozen, shifted, strided, np.asfortranarray(omega), omega.tolist()):
        assert (call(body, same, 0.3) == expected).all()


@everywhere
def test_nan_is_passed_on_without_a_warning(rng, name, m):
    omega, body, call = rng.normal(size=(40, m)), some_bodies(rng, m), QUANTITIES[name].call
    expected = call(body, omega, 0.1).reshape(40, -1)
    omega[3, 0] = omega[17, 1] = omega[20] = np.nan
    values = call(body, omega, 0.1).reshape(40, -1)
    missing = np.isnan(omega).any(axis=1)
    assert np.isnan(values[missing]).all()
    np.testing.assert_allclose(values[~missing], expected[~missing], rtol=0, atol=1e-14)


@everywhere
@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("shape", [(), (3, 300)])
def test_infinite_states_are_errors(rng, monkeypatch, name, m, many, shape):
    """Kernels find infinite states themselves where there are LARGE numbers."""
    if many:
        for module in (_checks, engine, engine_nd):
            monkeypatch.setattr(module, "LARGE", 64)
    q, omega = QUANTITIES[name], rng.normal(size=(10, *(shape or (90,)), m))
    omega[-1, ..., 1] = np.nan
    last = tuple(n - 2 for n in omega.shape[:-1])
    q.call(some_bodies(rng, m, shape[1:]), omega, 0.1)
    omega[(*last, 1)] = -np.inf
    index = str((*last, 1)).replace("(", r"\(").replace(")", r"\)")
    with pytest.raises(ValueError, match=f"{q.name}: expected .* got -inf at index {index}"):
        q.call(some_bodies(rng, m, shape[1:]), omega, 0.1)


@pytest.mark.compiled
def test_an_infinite_state_among_very_many(rng, body):
    many = rng.normal(size=(20_000, 2))
    assert many.size > _checks.LARGE
    many[12_345, 0] = np.inf
    with pytest.raises(ValueError, match=r"xy: .* got inf at index \(12345, 0\)"):
        sf.from_xy(body, many)


@in_3d
def test_bad_input(name, body):
    q = QUANTITIES[name]
    with pytest.raises(ValueError, match=f"{q.name}: expected shape"):
        q.call(body, [1, 2, 3], 0.1)
    with pytest.raises(ValueError, match="threads: expected"):
        q.call(body, [1.0, 0.5], 0.1, threads=0)
    with pytest.raises(TypeError, match=r"body: expected Suslov3D.*, got int"):
        q.call(1, [1.0, 0.5], 0.1)
    if q.step:
        with pytest.raises(ValueError, match="eps: expected finite"):
            q.call(body, [1, 2], np.nan)


def test_quantities_that_a_body_does_not_have():
    nd = sf.SuslovND([1, 2], [1, 1])
    for call in (lambda: sf.invariant_density(nd, [1, 2], 0.1), lambda: sf.to_xy(nd, [1, 2])):
        with pytest.raises(TypeError, match=r"body: expected Suslov3D.*, got SuslovND"):
            call()


@pytest.mark.compiled
@pytest.mark.parametrize("name", ["energy", "vector_field", "jacobian"])
def test_threads_do_not_matter(rng, monkeypatch, name):
    """Kernels of one size differ in the formula alone."""
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    omega, call = rng.normal(size=(3, 1000, 2)), QUANTITIES[name].call
    for body in (some_bodies(rng, 2), some_bodies(rng, 2, (1000,))):
        assert (call(body, omega, 0.1) == call(body, omega, 0.1, threads=1)).all()


# Powers of two of the moments, of the products of inertia and of omega.
UNITS = [
    (0, 0, 300), (0, 0, -300), (0, 0, 500), (0, 0, -340), (600, 600, 0), (-600, -600, 0),
    (200, -300, 10), (-300, 200, 200), (400, 400, -300), (-400, -400, 300), (0, 600, -600),
    (500, 500, -500), (-500, -500, 500),
]  # fmt: skip


def in_units(body, moments, products):
    if isinstance(body, sf.SuslovND):
        return sf.SuslovND(np.ldexp(body.J, moments), np.ldexp(body.I, products))
    powers = (moments, moments, products, products)
    return sf.Suslov3D(*(np.ldexp(p, k) for p, k in zip(body.parameters, powers, strict=True)))


@everywhere
@pytest.mark.parametrize("units", UNITS, ids=str)
def test_units(rng, name, m, units):
    """Exactly the same numbers in any unit in which they can be represented."""
    q, (moments, products, omegas) = QUANTITIES[name], units
    power = [
        sum(p * u for p, u in zip(each, units, strict=True) if p is not None)
        for each in np.atleast_2d(q.unit)
    ]
    if (None in q.unit and moments != products) or max(map(abs, power)) > 1000:
        return  # a sum of two terms of different units; out of range
    body, omega = some_bodies(rng, m, (20,)), rng.normal(size=(20, m))
    eps = rng.uniform(-0.2, 0.2, 20)
    expected = q.call(body, omega, eps)
    moved = np.ldexp(omega, omegas), np.ldexp(eps, moments - products - omegas)
    computed = q.call(in_units(body, moments, products), *moved)
    assert np.array_equal(computed, np.ldexp(expected, power if len(power) > 1 else power[0]))
    if name == "to_xy":
        back = sf.from_xy(in_units(body, moments, products), computed)
        assert (back == np.ldexp(sf.from_xy(body, expected), omegas)).all()


@pytest.mark.parametrize("m", [2, 4])
@pytest.mark.parametrize("units", UNITS, ids=str)
def test_units_of_multipliers(rng, m, units):
    moments, products, omegas = units
    if abs(omegas - products) > 1000:
        return
    body, c, eps = some_bodies(rng, m), rng.normal(), rng.uniform(-1, 1)
    scaled = np.ldexp(c, omegas - products), np.ldexp(eps, moments - products - omegas)
    computed = sf.multipliers(in_units(body, moments, products), *scaled)
    assert (computed == sf.multipliers(body, c, eps)).all()


@pytest.mark.parametrize("k", [-600, -340, 340, 500])
@pytest.mark.parametrize(
    ("J", "I"), [([2.0] * 4, [0.3, -0.4, 0.2, 0.1]), ([1.5, 1.5, 1.5, 4.0], [0, 0, 0, -0.7])]
)
def test_solved_bodies_in_n_dimensions(rng, J, I, k):
    """Units, to what the reduction to three dimensions rounds, and NaN."""
    omega, body = rng.normal(size=(5, 4)), sf.SuslovND(J, I)
    omega[3, 1] = np.nan
    other = in_units(body, k, k)
    t, F = sf.criticality(body, omega, 0.2), sf.first_integral(body, omega, 0.2)
    assert np.isnan(t).tolist() == np.isnan(F).tolist() == [False] * 3 + [True, False]
    np.testing.assert_allclose(sf.criticality(other, omega, 0.2), t, rtol=1e-13)
    np.testing.assert_allclose(
        sf.criticality(body, np.ldexp(omega, -k), np.ldexp(0.2, k)), t, rtol=1e-13
    )
    np.testing.assert_allclose(sf.first_integral(other, omega, 0.2), np.ldexp(F, -k), rtol=1e-13)


def test_long_steps_of_large_states(unit):
    """eps omega beyond the range of float64: no step follows the motion, but F is a number."""
    F = sf.first_integral(unit, [1e200, 1e200], 1e140)
    assert abs(F / 2e-280 - 1) < 1e-14
    assert abs(sf.modified_energy(unit, [1e200, 1e200], 1e140) / 4e-280 - 1) < 1e-14
    assert sf.first_integral(unit, [1e200, 1e200], 1e300) == 0  # 2e-600


@pytest.mark.filterwarnings("ignore::suslov_fast.SingularStepWarning")
def test_numbers_anywhere_in_the_range_give_no_warning(rng):
    """Of NumPy, that is."""

    def anywhere(size, low=-1060, high=1020):
        return np.ldexp(rng.uniform(0.5, 1, size), rng.integers(low, high, size))

    assert sf.energy(sf.Suslov3D(1, 1, 1, 0), [1e200, 0]) == np.inf
    for _ in range(100):
        m = int(rng.integers(1, 5))
        three = sf.Suslov3D(*anywhere(2, -850, 850), *anywhere(2))
        for body in (three, sf.SuslovND(anywhere(m, -850, 850), anywhere(m))):
            omega, eps = anywhere(body.dimension), anywhere(())
            for q in QUANTITIES.values():
                if q.nd or body is three:
                    q.call(body, omega, eps)
            sf.multipliers(body, omega[0], eps)
        sf.from_xy(three, anywhere(2))


@pytest.mark.parametrize("name", ["jacobian", "discrete_reaction"])
@pytest.mark.parametrize("m", [2, 4])
def test_states_without_a_next_one_are_counted(rng, monkeypatch, name, m):
    """In one warning, which names the first in C order, whatever task has found it."""
    body = sf.Suslov3D(1, 1, 1, 0) if m == 2 else sf.SuslovND([2, 2, 2, 3], [1, 0, 0.5, 0.25])
    pole = [1.0, -3.0] if m == 2 else [2, 1, 3, 2]
    omega = 0.1 * rng.normal(size=(4, 400, m))
    omega[2, 17] = omega[2, 399] = omega[3, 5] = pole
    omega[1, 3, 0] = np.nan
    for tasks in (1, 64):
        monkeypatch.setattr(engine, "TASKS", tasks)
        with pytest.warns(
            sf.SingularStepWarning, match=r"^3 of 1600 .* first: \(2, 17\)$"
        ) as caught:
            values = getattr(sf, name.removeprefix("discrete_"))(body, omega, 1.0)
        assert len(caught) == 1
        assert caught[0].filename == __file__
        missing = np.isnan(values.reshape(4, 400, -1)).all(axis=-1)
        assert [tuple(each) for each in np.argwhere(missing).tolist()] == [
            (1, 3), (2, 17), (2, 399), (3, 5)
        ]  # fmt: skip


@pytest.mark.compiled
@pytest.mark.parametrize("name", sorted(n for n, v in vars(kernels).items() if type(v) is Kernel))
def test_kernels_do_not_depend_on_tasks_or_neighbours(rng, name):
    """Each state alone gives the same bits as among others, and by either build."""
    kernel, size = getattr(kernels, name), SIZES.get(name.removeprefix("gyrostat_"), 1)
    count = 6 if name.startswith("gyrostat") else 5
    bodies = rng.uniform(0.5, 2, (count, 100))
    omega = rng.normal(size=(250, 2)) * 10.0 ** rng.uniform(-3, 3, (250, 1))
    omega[17] = np.nan
    results = []
    for build, tasks in ((kernel.serial, 1), (kernel.parallel, 4)):
        out, report = np.zeros((250, size)), np.zeros((tasks, 3), np.int64)
        build(tuple(bodies), omega, out, 100, report)
        assert not report.any()
        results.append(out)
    assert np.array_equal(*results, equal_nan=True)
    for i in (0, 99, 100, 127, 128, 249):
        out = np.zeros((1, size))
        one = tuple(each[i % 100 : i % 100 + 1].copy() for each in bodies)
        kernel.serial(one, omega[i : i + 1], out, 1, np.zeros((1, 3), np.int64))
        assert np.array_equal(out[0], results[0][i], equal_nan=True)


SIZES = {"to_xy": 2, "from_xy": 2, "vector_field": 2, "jacobian": 4, "matrix": 4, "constants": 4}
