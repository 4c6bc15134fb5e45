"""What all functions of a state have in common: shapes, NaN, units, threads."""

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import _checks
from suslov_fast._core.cpu import observables as loops
from suslov_fast._core.jit import Loop
from suslov_fast._engine import observables as engine
from suslov_fast._engine import threads

# Each function: whether it takes a step size, and its unit: the powers of that of moments, of
# products of inertia, and of omega. The step size has the unit moments / (products omega).
FUNCTIONS = {
    sf.energy: (False, (1, 0, 1 + 1)),
    sf.first_integral: (True, (-1, 0, 2)),
    sf.modified_energy: (True, (1, 0, 2)),
    sf.criticality: (True, (0, 0, 0)),
    sf.invariant_density: (True, (-2, -1, -1)),
    sf.vector_field: (False, (-1, 1, 2)),
    sf.jacobian: (True, (0, 0, 0)),
    sf.matrix: (True, (0, 0, 0)),
}
IN_3D = list(FUNCTIONS)
IN_ND = [sf.energy, sf.modified_energy, sf.vector_field, sf.jacobian, sf.matrix]
named = pytest.mark.parametrize("function", IN_3D, ids=lambda f: f.__name__)
named_nd = pytest.mark.parametrize("function", IN_ND, ids=lambda f: f.__name__)


def evaluate(function, body, omega, eps=0.3, **options):
    return function(body, omega, *([eps] if FUNCTIONS[function][0] else []), **options)


def bodies_3d(rng, shape=()):
    return sf.Suslov3D(*rng.uniform(0.5, 4, (2, *shape)), *rng.uniform(-1, 1, (2, *shape)))


def bodies_nd(rng, shape=(), m=4):
    return sf.SuslovND(rng.uniform(0.5, 4, (*shape, m)), rng.uniform(-1, 1, (*shape, m)))


def each_of(body, shape):
    """The bodies of a batch, one after the other."""
    own = 1 if isinstance(body, sf.SuslovND) else 0
    parameters = [np.asarray(p) for p in body.parameters]
    full = [np.broadcast_to(p, (*shape, *p.shape[p.ndim - own :])) for p in parameters]
    for index in np.ndindex(shape):
        yield index, type(body)(*(p[index] for p in full))


# Shapes of the body, of omega but for its last axis, and of eps.
SHAPES = [
    ((), (), ()),
    ((), (7,), ()),
    ((11,), (11, 11), ()),
    ((11,), (11, 11), (11,)),
    ((), (5, 11), (11,)),
    ((3,), (4, 300, 3), ()),
    ((300,), (4, 300), (300,)),
    ((4, 1), (3,), (2, 1, 1)),
    ((5, 1), (5, 6), (1,)),
    ((1, 6), (6,), (5, 1)),
    ((2, 3), (), ()),
    ((), (1,), (9, 1)),
    ((), (0, 3), ()),
    ((4,), (0, 4), ()),
]


@pytest.mark.parametrize("shape", [(), (3,)])
@named
def test_one_task(function, rng, monkeypatch, shape):
    """A task goes from block to block, and enters bodies where there are others."""
    body, omega = bodies_3d(rng, shape), rng.normal(size=(70, 3, 2))
    expected = evaluate(function, body, omega)
    monkeypatch.setattr(engine, "TASKS", 1)
    assert np.array_equal(evaluate(function, body, omega), expected)


@named
@pytest.mark.parametrize("shapes", SHAPES, ids=str)
@pytest.mark.parametrize("slab", [2**18, 4], ids=["whole", "slabs"])
def test_a_batch_is_a_loop(rng, monkeypatch, function, shapes, slab):
    """Whatever is broadcast, and whether it is taken whole or slab after slab."""
    monkeypatch.setattr(engine, "LARGE_SLAB", slab)
    of_body, of_omega, of_eps = shapes
    body = bodies_3d(rng, of_body)
    omega, eps = rng.normal(size=(*of_omega, 2)), rng.uniform(-0.3, 0.3, of_eps)
    step_size = eps if FUNCTIONS[function][0] else np.zeros(())
    batch = np.broadcast_shapes(of_body, of_omega, step_size.shape)
    values = evaluate(function, body, omega, eps)
    assert values.shape[: len(batch)] == batch
    states, steps = np.broadcast_to(omega, (*batch, 2)), np.broadcast_to(step_size, batch)
    for index, one in list(each_of(body, batch))[:: max(1, values.size // 300)]:
        assert (values[index] == evaluate(function, one, states[index], steps[index])).all()


@named_nd
@pytest.mark.parametrize("shapes", SHAPES, ids=str)
def test_a_batch_in_n_dimensions_is_a_loop(rng, monkeypatch, function, shapes):
    monkeypatch.setattr(engine, "SLAB", 64)
    of_body, of_omega, of_eps = shapes
    body = bodies_nd(rng, of_body)
    omega, eps = rng.normal(size=(*of_omega, 4)), rng.uniform(-0.1, 0.1, of_eps)
    step_size = eps if FUNCTIONS[function][0] else np.zeros(())
    batch = np.broadcast_shapes(of_body, of_omega, step_size.shape)
    values = evaluate(function, body, omega, eps)
    assert values.shape[: len(batch)] == batch
    states, steps = np.broadcast_to(omega, (*batch, 4)), np.broadcast_to(step_size, batch)
    # LAPACK may round otherwise where matrices lie elsewhere in memory.
    rounding = 1e-14 if function is sf.jacobian else 0.0
    for index, one in list(each_of(body, batch))[:: max(1, values.size // 300)]:
        alone = evaluate(function, one, states[index], steps[index])
        np.testing.assert_allclose(values[index], alone, rtol=0, atol=rounding)


def test_as_many_bodies_as_saved_states(rng):
    """Bodies belong to the batch, never to time."""
    body, omega = bodies_3d(rng, (11,)), rng.normal(size=(11, 2))
    orbits = sf.iterate(body, omega, 0.1, 10)
    assert orbits.omega.shape == (11, 11, 2)
    F = sf.first_integral(body, orbits.omega, 0.1)
    assert abs(F / F[0] - 1).max() < 1e-14


@named
def test_any_memory_order(rng, function):
    omega = rng.normal(size=(5, 7, 2))
    body = bodies_3d(rng, (7,))
    expected = evaluate(function, body, omega)
    frozen = omega.copy()
    frozen.flags.writeable = False
    shifted = np.frombuffer(b"x" + omega.tobytes(), np.float64, offset=1).reshape(omega.shape)
    strided = np.zeros((10, 7, 4))[::2, :, ::2]
    strided[...] = omega
    for same in (frozen, shifted, strided, np.asfortranarray(omega), omega.tolist()):
        assert (evaluate(function, body, same) == expected).all()
    assert (evaluate(function, body, omega.astype(np.float32)).shape) == expected.shape


@named
def test_nan_is_passed_on_without_a_warning(rng, function):
    omega = rng.normal(size=(40, 2))
    expected = evaluate(function, bodies_3d(np.random.default_rng(1)), omega).reshape(40, -1)
    omega[3, 0] = omega[17, 1] = omega[20] = np.nan
    values = evaluate(function, bodies_3d(np.random.default_rng(1)), omega).reshape(40, -1)
    missing = np.isnan(omega).any(axis=1)
    assert np.isnan(values[missing]).all()
    assert (values[~missing] == expected[~missing]).all()


@pytest.mark.parametrize("function", [sf.energy, sf.modified_energy, sf.vector_field, sf.matrix],
                         ids=lambda f: f.__name__)  # fmt: skip
def test_nan_in_n_dimensions(rng, function):
    omega = rng.normal(size=(40, 4))
    omega[3, 0] = omega[17, 3] = np.nan
    values = evaluate(function, bodies_nd(rng), omega).reshape(40, -1)
    missing = np.isnan(omega).any(axis=1)
    assert np.isnan(values).all(axis=1).tolist() == missing.tolist()
    assert np.isnan(values).any(axis=1).tolist() == missing.tolist()


@pytest.mark.parametrize(
    ("J", "I"), [([2.0] * 4, [0.3, -0.4, 0.2, 0.1]), ([1, 1, 1, 4], [0, 0, 0, 1])]
)
def test_nan_of_solved_bodies_and_of_steps_in_n_dimensions(rng, J, I):
    body, omega = sf.SuslovND(J, I), rng.normal(size=(5, 6, 4))
    omega[1, 2], omega[2, 3, 1], omega[4] = np.nan, np.nan, 0.0
    missing = np.isnan(omega).any(axis=-1)
    for function in (sf.first_integral, sf.criticality, sf.jacobian, sf.reaction):
        values = function(body, omega, 0.2).reshape(5, 6, -1)
        assert (np.isnan(values).all(axis=-1) == missing).all()
        assert (np.isnan(values).any(axis=-1) == missing).all()


@named
def test_infinite_states_are_errors(function, body):
    for bad in ([[1, 2], [np.inf, 1]], [[1, 2], [0, -np.inf]]):
        with pytest.raises(ValueError, match=r"omega: expected .* got -?inf at index \(1, [01]\)"):
            evaluate(function, body, bad)
    with pytest.raises(ValueError, match="omega: expected shape"):
        evaluate(function, body, [1, 2, 3])


@pytest.fixture
def few_are_many(monkeypatch):
    """Infinite states are found by the loops themselves where there are more than 64 numbers."""
    monkeypatch.setattr(_checks, "LARGE", 64)
    monkeypatch.setattr(engine, "LARGE", 64)


@pytest.mark.usefixtures("few_are_many")
@named
@pytest.mark.parametrize("shape", [(3000,), (10, 300)], ids=str)
def test_infinite_states_among_many_are_errors(rng, function, shape):
    omega = rng.normal(size=(*shape, 2))
    omega[-1, ..., 1] = np.nan
    evaluate(function, bodies_3d(rng), omega)
    last = tuple(n - 2 for n in shape)
    omega[(*last, 1)] = -np.inf
    for body in (bodies_3d(rng), bodies_3d(rng, shape[-1:])):
        message = str((*last, 1)).replace("(", r"\(").replace(")", r"\)")
        with pytest.raises(ValueError, match="omega: expected .* got -inf at index " + message):
            evaluate(function, body, omega)


@pytest.mark.usefixtures("few_are_many")
def test_infinite_states_among_many_in_other_functions(rng, body):
    many = rng.normal(size=(2000, 2))
    many[1234, 0] = np.inf
    for function, name, arguments in (
        (sf.to_xy, "omega", ()),
        (sf.from_xy, "xy", ()),
        (sf.closed_form, "omega0", (0.1,)),
        (sf.reaction, "omega", ()),
        (sf.reaction, "omega", (0.1,)),
    ):
        with pytest.raises(ValueError, match=rf"^{name}: .* got inf at index \(1234, 0\)"):
            function(body, many, *arguments)


@pytest.mark.usefixtures("few_are_many")
@named_nd
def test_infinite_states_among_many_in_n_dimensions(rng, function):
    many = rng.normal(size=(500, 4))
    many[234, 2] = np.inf
    with pytest.raises(ValueError, match=r"omega: .* got inf at index \(234, 2\)"):
        evaluate(function, bodies_nd(rng), many)


@pytest.mark.compiled
def test_an_infinite_state_among_so_many_that_the_loops_find_it(rng, body):
    assert engine.LARGE < 2 * 20_000
    many = rng.normal(size=(20_000, 2))
    many[12_345, 0] = np.inf
    with pytest.raises(ValueError, match=r"omega: .* got inf at index \(12345, 0\)"):
        sf.energy(body, many)


def test_nan_step_sizes_are_errors(body):
    for function in (sf.first_integral, sf.jacobian, sf.reaction, sf.closed_form):
        with pytest.raises(ValueError, match="eps: expected finite"):
            function(body, [1, 2], np.nan)


@pytest.mark.compiled
@pytest.mark.parametrize(
    # One function of each kind: the loops of the others differ in the formula alone.
    "function",
    [sf.energy, sf.criticality, sf.vector_field, sf.jacobian],
    ids=lambda f: f.__name__,
)
def test_threads_do_not_matter(rng, monkeypatch, function):
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    omega = rng.normal(size=(3, 1000, 2))
    for body in (bodies_3d(rng), bodies_3d(rng, (1000,))):
        assert (evaluate(function, body, omega) == evaluate(function, body, omega, threads=1)).all()


@named
def test_no_threads(function, body):
    with pytest.raises(ValueError, match="threads: expected"):
        evaluate(function, body, [1.0, 0.5], threads=0)


def scaled(body, moments, products):
    I1, I2, I13, I23 = body.parameters
    return sf.Suslov3D(
        np.ldexp(I1, moments),
        np.ldexp(I2, moments),
        np.ldexp(I13, products),
        np.ldexp(I23, products),
    )


# Powers of two of the moments, of the products of inertia and of omega.
UNITS = [
    (0, 0, 300), (0, 0, -300), (0, 0, 500), (0, 0, -340), (600, 600, 0), (-600, -600, 0),
    (200, -300, 10), (-300, 200, 200), (400, 400, -300), (-400, -400, 300), (0, 600, -600),
]  # fmt: skip


@named
@pytest.mark.parametrize("units", UNITS, ids=str)
def test_units(rng, function, units):
    """Exactly the same numbers in any unit in which they can be represented."""
    moments, products, omegas = units
    body, omega = (
        bodies_3d(rng, (20,)),
        rng.normal(size=(20, 2)) * 10.0 ** rng.uniform(-1, 1, (20, 1)),
    )
    eps = rng.uniform(-1, 1, 20)
    expected = evaluate(function, body, omega, eps)
    unit = int(np.dot(FUNCTIONS[function][1], units))
    computed = evaluate(
        function,
        scaled(body, moments, products),
        np.ldexp(omega, omegas),
        np.ldexp(eps, moments - products - omegas),
    )
    if abs(unit) < 1000:
        assert (computed == np.ldexp(expected, unit)).all()


@named_nd
@pytest.mark.parametrize("units", UNITS, ids=str)
def test_units_in_n_dimensions(rng, function, units):
    moments, products, omegas = units
    body, omega = bodies_nd(rng, (20,)), rng.normal(size=(20, 4))
    eps = rng.uniform(-0.2, 0.2, 20)
    expected = evaluate(function, body, omega, eps)
    unit = int(np.dot(FUNCTIONS[function][1], units))
    if abs(unit) > 1000:
        return
    computed = evaluate(
        function,
        sf.SuslovND(np.ldexp(body.J, moments), np.ldexp(body.I, products)),
        np.ldexp(omega, omegas),
        np.ldexp(eps, moments - products - omegas),
    )
    assert (computed == np.ldexp(expected, unit)).all()


@pytest.mark.parametrize("units", [u for u in UNITS if u[0] == u[1]], ids=str)
@pytest.mark.parametrize("step", [False, True])
def test_units_of_reactions(rng, units, step):
    """Both of its terms have one unit if moments and products have."""
    inertia, _, omegas = units
    unit = inertia + 2 * omegas
    if abs(unit) > 1000:
        return
    for body, m in ((bodies_3d(rng, (20,)), 2), (bodies_nd(rng, (20,)), 4)):
        omega = rng.normal(size=(20, m))
        eps, scaled_eps = 0.1, np.ldexp(0.1, -omegas)
        other = type(body)(*(np.ldexp(p, inertia) for p in body.parameters))
        expected = sf.reaction(body, omega, eps if step else None)
        computed = sf.reaction(other, np.ldexp(omega, omegas), scaled_eps if step else None)
        assert (computed == np.ldexp(expected, unit)).all()


@pytest.mark.parametrize("units", UNITS, ids=str)
def test_units_of_coordinates_and_constants(rng, units):
    moments, products, omegas = units
    body, omega = bodies_3d(rng, (20,)), rng.normal(size=(20, 2))
    other, moved = scaled(body, moments, products), np.ldexp(omega, omegas)
    of_x, of_y = products + omegas, products + moments + omegas
    if max(abs(of_x), abs(of_y)) < 1000:
        xy = np.ldexp(sf.to_xy(body, omega), [of_x, of_y])
        assert (sf.to_xy(other, moved) == xy).all()
        assert (
            sf.from_xy(other, xy) == np.ldexp(sf.from_xy(body, sf.to_xy(body, omega)), omegas)
        ).all()
    h, k1, k2, t = sf.closed_form(body, omega, 0.1)
    scaled_h, scaled_k1, scaled_k2, scaled_t = sf.closed_form(
        other, moved, np.ldexp(0.1, moments - products - omegas)
    )
    assert (scaled_t == t).all()
    assert (scaled_k2 == k2).all()
    assert (scaled_k1 == np.ldexp(k1, products + omegas - moments)).all()
    if abs(of_x) < 500:
        assert (scaled_h == np.ldexp(h, 2 * of_x)).all()


@pytest.mark.parametrize("units", UNITS, ids=str)
def test_units_of_multipliers(rng, units):
    moments, products, omegas = units
    if abs(omegas - products) > 1000:
        return
    c, eps = rng.normal(), rng.uniform(-1, 1)
    scaled_c = np.ldexp(c, omegas - products)
    scaled_eps = np.ldexp(eps, moments - products - omegas)
    body = bodies_3d(rng)
    expected = sf.multipliers(body, c, eps)
    computed = sf.multipliers(scaled(body, moments, products), scaled_c, scaled_eps)
    assert (computed == expected).all()
    nd = bodies_nd(rng)
    other = sf.SuslovND(np.ldexp(nd.J, moments), np.ldexp(nd.I, products))
    computed = sf.multipliers(other, scaled_c, scaled_eps)
    assert (computed == sf.multipliers(nd, c, eps)).all()


@pytest.mark.parametrize("k", [-600, -340, 340, 500])
def test_units_of_solved_bodies_in_n_dimensions(rng, k):
    """Whatever the reduction to three dimensions rounds."""
    for J, I in (([2.0] * 4, [0.3, -0.4, 0.2, 0.1]), ([1.5, 1.5, 1.5, 4.0], [0, 0, 0, -0.7])):
        omega = rng.normal(size=(5, 4))
        body, other = sf.SuslovND(J, I), sf.SuslovND(np.ldexp(J, k), np.ldexp(I, k))
        expected = sf.criticality(body, omega, 0.2)
        np.testing.assert_allclose(sf.criticality(other, omega, 0.2), expected, rtol=1e-13)
        moved = np.ldexp(omega, -k), np.ldexp(0.2, k)
        np.testing.assert_allclose(sf.criticality(body, *moved), expected, rtol=1e-13)
        F = sf.first_integral(body, omega, 0.2)
        np.testing.assert_allclose(
            sf.first_integral(other, omega, 0.2), np.ldexp(F, -k), rtol=1e-13
        )


def test_long_steps_of_large_states(unit):
    """eps omega beyond the range of float64: no step follows the motion, but F is a number."""
    F = sf.first_integral(unit, [1e200, 1e200], 1e300)
    assert abs(F / 2e-600 - 1) < 1e-14 if F else F == 0
    F = sf.first_integral(unit, [1e200, 1e200], 1e140)
    assert abs(F / 2e-280 - 1) < 1e-14
    assert abs(sf.modified_energy(unit, [1e200, 1e200], 1e140) / 4e-280 - 1) < 1e-14


def test_numbers_out_of_range_give_no_warning(unit):
    assert sf.energy(unit, [1e200, 0]) == np.inf
    assert not np.isfinite(sf.vector_field(unit, [1e200, 1e200])).all()
    nd = sf.SuslovND([1, 2, 3], [1, 1, 1])
    assert sf.energy(nd, [1e200, 0, 0]) == np.inf
    assert sf.modified_energy(nd, [0, 1e-200, 0], 1) == 0
    assert sf.multipliers(nd, 1e308, 1e308).shape == (3,)


@pytest.mark.filterwarnings("ignore::suslov_fast.SingularStepWarning")
def test_numbers_anywhere_in_the_range_give_no_warning(rng):
    """Of NumPy, that is."""

    def anywhere(size, low=-1060, high=1020):
        return np.ldexp(rng.uniform(0.5, 1, size), rng.integers(low, high, size))

    with_step = [sf.first_integral, sf.modified_energy, sf.criticality, sf.jacobian, sf.matrix]
    with_step += [sf.invariant_density, sf.closed_form, sf.reaction]
    for _ in range(100):
        body, omega, eps = (
            sf.Suslov3D(*anywhere(2, -850, 850), *anywhere(2)),
            anywhere(2),
            anywhere(()),
        )
        for function in (sf.energy, sf.to_xy, sf.from_xy, sf.vector_field, sf.reaction):
            function(body, omega)
        for function in with_step:
            function(body, omega, eps)
        sf.multipliers(body, omega[0], eps)
        m = rng.integers(1, 5)
        body, omega = sf.SuslovND(anywhere(m, -850, 850), anywhere(m)), anywhere(m)
        for function in (sf.energy, sf.vector_field, sf.reaction):
            function(body, omega)
        for function in (sf.modified_energy, sf.matrix, sf.jacobian, sf.reaction):
            function(body, omega, eps)
        sf.multipliers(body, omega[0], eps)


@pytest.mark.compiled
@pytest.mark.parametrize("name", sorted(n for n, v in vars(loops).items() if isinstance(v, Loop)))
@pytest.mark.parametrize(("N", "period"), [(300, 100), (100, 300)])
def test_compiled_loops_and_python_agree(rng, name, N, period):
    """Bit for bit: one formula, and nothing that a compiler may round otherwise."""
    loop, size = getattr(loops, name), 4
    omega = rng.normal(size=2 * N) * 10.0 ** rng.uniform(-3, 3, 2 * N)
    bodies = [rng.uniform(0.5, 2, period) for _ in range(5)]
    results = []
    for run in (loop.serial, np.errstate(all="ignore")(loop.serial.py_func)):
        out, report = np.zeros(size * N), np.zeros((2, 3), np.int64)
        run(*bodies, omega, out, period, report)
        results.append((out, report))
    np.testing.assert_array_equal(*(out for out, _ in results))
    np.testing.assert_array_equal(*(report for _, report in results))
