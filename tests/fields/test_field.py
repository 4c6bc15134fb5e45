"""Fields: coefficients of degree 2, names, parameters, equations as text, functions as fields."""

import math
import sys
from fractions import Fraction as F

import children
import numpy as np
import pytest
import sympy
from systems import exactly, henon_heiles, lorenz, tables

import suslov_fast as sf
from suslov_fast import Field, iterate
from suslov_fast.integrability import kahan


# ------------------------------------------------------------------------------- coefficients
def table(field):
    """Return the coefficients of a field, one row for each member."""
    return np.concatenate([each.reshape(*field.shape, -1) for each in tables(field)], axis=-1)


def value(field, x):
    """Return f(x) by the terms, in exact arithmetic."""
    return exactly(field.terms, [*map(F, x)])


@pytest.mark.parametrize(
    ("f", "expected"),
    [
        (lambda x: [x[0] ** 3 - x[0] * x[0] * (x[0] - 1), x[1]], (9, 4)),
        (lambda x: ((x[0] + 1e6) * (x[1] + 1e6) - 1e12 - 1e6 * (x[0] + x[1]), x[0]), (12, 3)),
        (lambda x: (F(1, 4) * x[0], x[1] * F(3, 2) - F(1, 2)), (0.75, 5.5)),
    ],
)
def test_terms_are_collected_before_they_are_rounded(f, expected):
    field = Field(f, 2)
    assert [*map(float, value(field, [3, 4]))] == [*field([3.0, 4.0])] == [*expected]


def test_a_field_in_the_function_of_another():
    prey = Field(lambda x: (x[0] - x[0] * x[1], 2 * x[0] * x[1] - x[1] + 3), 2)
    angles = Field(lambda x: (x[1], -np.sin(x[0])), 2)
    both, x = Field(lambda x: np.add(prey(x), angles(x)), 2), [0.3, 0.7]
    np.testing.assert_allclose(both(x), [0.09 + 0.7, 2.72 - np.sin(0.3)], rtol=1e-15)
    with pytest.raises(TypeError, match="family"):
        Field(lambda x: Field(lorenz, 3, rho=[1, 2])(x), 3)


def test_random_polynomials(rng):
    """Sums and products of sums, of which Kahan's map and the motion take the same f."""
    for _ in range(25):
        D, numbers = int(rng.integers(1, 6)), rng.integers(-4, 5, 500).tolist()

        def linear(x, next_):
            return sum(next_() * a for a in x) + next_()

        def f(x, p, numbers=numbers):
            n = iter(numbers)
            rows = [linear(x, lambda: next(n)) * linear(x, lambda: next(n)) for _ in x]
            return [
                a * p - b / 4 + linear(x, lambda: next(n)) for a, b in zip(rows, x, strict=True)
            ]

        field = Field(f, D, p=[2.0, -0.5])
        x = rng.integers(-5, 6, D)
        for k, p in enumerate((F(2), F(-1, 2))):
            exact = f([*map(F, x.tolist())], p)
            assert value(field[k], x.tolist()) == exact
            assert field[k](x).tolist() == [*map(float, exact)]
        assert np.array_equal(table(field)[0], table(field[0]))


MANY = {"a": np.linspace(0.1, 0.37, 7)[:, None], "b": np.linspace(-2.9, 4.7, 5), "c": 3}
OF_FAMILIES = {
    "as it is": lambda x, a, b, c: (-x[1] + a * x[0], b + x[1] * (x[0] - c)),
    "floats first": lambda x, a, b, c: (a * b / c * x[0], (a + 0.1 - b) ** 2 * x[1] + a**3),
    "rounded": lambda x, a, b, c: (a * x[0] * b * 3, (a * x[0] + b * x[0]) * c + F(1, 3)),
    "quotients": lambda x, a, b, c: (x[0] * b / a / F(3, 7), (b - a) * x[1] * x[0] / a + 1 / a),
    "functions": lambda x, a, b, c: (np.sin(a) * x[0], np.exp(b / c) * x[1] ** 2),
    "choices": lambda x, a, b, c: (np.where(b > 1, x[0], x[1]), x[1] * np.maximum(a, 0.2)),
    "zeros": lambda x, a, b, c: ((a - a) * x[0] - 0 * b, -b * x[1] * 0.1 * (x[0] + a)),
    "in arrays": lambda x, a, b, c: np.array([[a, b], [b, a]]) @ np.eye(2) * 0.1 @ x,
    "a degree that vanishes": lambda x, a, b, c: ((a - a) * x[0] ** 3, b * x[1]),
}  # fmt: skip


@pytest.mark.parametrize("f", OF_FAMILIES.values(), ids=OF_FAMILIES)
def test_a_family_has_the_coefficients_of_its_members(f):
    family, x = Field(f, 2, **MANY), np.array([0.7, -0.4])
    rows = table(family)
    for index in np.ndindex(7, 5):
        values = {key: float(np.broadcast_to(each, (7, 5))[index]) for key, each in MANY.items()}
        alone = Field(f, 2, **values)
        assert table(alone).tobytes() == rows[index].tobytes()
        exact = [*map(float, value(alone, x))]
        np.testing.assert_allclose(exact, f(x, **values), rtol=1e-14, atol=1e-15)
    run = iterate(family, x, 1e-4, 3)
    assert np.array_equal(iterate(family[3, 2], x, 1e-4, 3).states, run.states[:, 3, 2])


def test_arrays_of_coefficients(rng):
    """Of q the part symmetric in j and k counts."""
    for shape in (), (3,):
        q, l, c = (rng.integers(-3, 4, (*shape, *(4,) * axes)) for axes in (3, 2, 1))
        field = Field.from_terms(q, l, c, "a b c d")
        twin = Field.from_terms(q.swapaxes(-2, -1), l, c)
        assert (field.shape, field.names, field == twin) == (shape, tuple("abcd"), True)
        x = rng.integers(-5, 6, 4)
        expected = np.einsum("...ijk,j,k", q, x, x) + l @ x + c
        assert np.array_equal(field(x), expected)
        slopes = np.einsum("...ijk,k", q + q.swapaxes(-2, -1), x) + l
        assert np.array_equal(field.jacobian(x), slopes)
    assert repr(Field.from_terms([[[0]]], constant=[0])) == "Field(x1' = 0)"
    assert len(repr(Field.from_terms(np.ones((9, 9, 9))))) < 320
    # With integers beyond doubles beside floats.
    plain = Field.from_terms([[[0, 2**70 + 1], [0.5, 0]], [[0, 1], [-1, 0]]])
    assert plain.terms[0].tolist() == [[0], [0], [1]]
    assert plain.terms[1].tolist() == [2.0**70]


NUMBERS = {
    "a decimal": (0.1, F(1, 10)), "a quotient": (8 / 3, F(8, 3)), "a ratio": (F(617, 2839),) * 2,
    "an integer": (7, F(7)), "binary": (0.375, F(3, 8)), "small": (-1.25e-7, F(-1, 8_000_000)),
}  # fmt: skip


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_are_what_was_typed(name):
    """In f, as a parameter, in H, from a dictionary: x' = c x, whose map is (2 + c) / (2 - c)."""
    c, expected = NUMBERS[name]
    fields = [
        Field(lambda x: (c * x[0],), 1),
        Field(lambda x, c: (c * x[0],), 1, c=c),
        Field.from_terms([[[0]]], [[c]]),
    ]
    fields += [Field.from_dict(field.to_dict()) for field in fields]
    for field in fields:
        assert kahan(field, 1)([1])[0] == (2 + expected) / (2 - expected)
    pair = Field.from_hamiltonian(lambda x: c * x[0] * x[1], 2)
    assert kahan(pair, 1)([1, 1])[0] == (2 + expected) / (2 - expected)
    text = str(c) if isinstance(c, F) else repr(c)
    typed = Field.from_equations(f"x' = {text}*x")
    assert kahan(typed, 1)([1])[0] == (2 + expected) / (2 - expected)


OF_MAPS = [
    lambda f, x: iterate(f, x, 0.1, 5),
    lambda f, x: sf.kahan.matrix(f, x, 0.1),
    lambda f, x: sf.kahan.invariant_density(f, x, 0.1),
    lambda f, x: sf.lyapunov_exponents(f, x, 0.1, 5),
    lambda f, x: sf.compiled.system(f, 0.1),
    lambda f, x: sf.integrability.report(f),
    lambda f, x: f.terms,
]


@pytest.mark.parametrize(
    "f",
    [
        lambda x, a: (x[0] ** 3 - x[1], a * x[0]),
        lambda x, a: (np.sin(x[0]), a * x[1]),
        lambda x, a: (a / x[0], x[1]),
        lambda x, a: (np.where(x[0] > a, x[1], x[0]), x[1]),
        lambda x, a: (x[0] ** a, x[1] ** 0.5),
    ],
)
def test_other_fields_have_no_map(f):
    field = Field(f, 2, a=2.0)
    for call in OF_MAPS:
        with pytest.raises(TypeError, match=r"degree 2 .*flow\("):
            call(field, [0.3, 0.4])


@pytest.mark.slow
def test_fields_of_many_variables():
    """In a process of its own, whose memory is limited to far less than a table."""
    code = (
        "import resource, sys, json, pickle, suslov_fast as sf, numpy as np\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "D = 1024\n"
        "f = lambda x: [(x[(i + 1) % D] - x[i - 2]) * x[i - 1] - x[i] + 8 for i in range(D)]\n"
        "field = sf.Field(f, D)\n"
        "same = sf.Field.from_dict(json.loads(json.dumps(field.to_dict())))\n"
        "assert same == field == pickle.loads(pickle.dumps(field)) and hash(same) == hash(field)\n"
        "x = np.random.default_rng(0).integers(-4, 5, D)\n"
        "assert field(x).tolist() == f(x.tolist())\n"
        "assert field.terms[0].shape == (3, 4 * D)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    if sys.platform == "linux":
        assert int(children.run(code)) < 2**16  # KiB; a table of 1024 variables has 8 GiB


# ------------------------------------------------------------------------------- Hamiltonians
def test_gradients_of_hamiltonians(rng):
    """K grad H of random cubic H and K, among them those with one product of a variable alone."""

    def compare(H, K):
        names = sympy.symbols(f"x:{len(K)}")
        slopes = [sympy.diff(H(np.array(names)), each) for each in names]
        gradient = sympy.lambdify([names], slopes)
        field = Field.from_hamiltonian(H, len(K), K)
        x = rng.integers(-4, 5, (5, len(K))) / 2  # every sum and product is exact
        expected = [np.asarray(K) @ gradient(each) for each in x]
        np.testing.assert_array_equal(field(x), expected)
        for each, f in zip(x, expected, strict=True):
            assert [*map(float, value(field, each))] == f.tolist()
        np.testing.assert_array_equal(field.energy(x), [H(each) for each in x])

    # Momenta first, in a magnetic field.
    charged = np.array([[0, 1, -1, 0], [-1, 0, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]])
    compare(lambda x: (x * x).sum() / 2, charged)
    for _ in range(25):
        D = int(rng.integers(1, 6))
        terms = [
            (int(rng.integers(-2, 3)), rng.integers(0, D, rng.integers(0, 4)))
            for _ in range(rng.integers(1, 6))
        ]

        def H(x, terms=terms):
            return sum(c * math.prod(x[i]) for c, i in terms) + 0 * x[0]

        K = np.triu(rng.integers(-2, 3, (D, D)) * (rng.random((D, D)) < 0.6), 1)
        compare(H, K - K.T)


def test_the_structure_of_a_hamiltonian_field():
    """H and K are parts of a field, also where f does not show them."""
    K = np.array([[0, 1, 2], [-1, 0, 3], [-2, -3, 0]])
    field, twin = (
        Field.from_hamiltonian(lambda x: x[0], 3, k) for k in (K, np.where(abs(K) == 3, -K, K))
    )
    assert np.array_equal(field(np.ones(3)), twin(np.ones(3)))
    assert field != twin
    assert field != Field.from_hamiltonian(lambda x: x[0] + 1, 3, K)
    assert field != Field(lambda x: (0.0, -1.0, -2.0), 3)
    family = Field.from_hamiltonian(lambda x, H: H * x[0] ** 2 + x[1] ** 2, 2, H=[1.0, 3.0])
    assert family.energy(np.ones((5, 1, 2))).tolist() == [[2.0, 4.0]] * 5
    assert family.sel(H=3).energy([1, 1]) == 4
    assert np.isnan(family.energy([np.nan, 1])).all()
    with pytest.raises(TypeError, match="from_hamiltonian"):
        Field(lorenz, 3).energy([1, 2, 3])


# ------------------------------------------------------------------------------- names, parameters
NAMES = ("u", "v", "w")
of_names = [
    "u v w", " u, v,w ", ["u", "v", "w"], ("u", "v", "w"), np.array(["u", "v", "w"]),
]  # fmt: skip


@pytest.mark.parametrize("given", of_names, ids=repr)
def test_names_of_variables(given):
    """They are those of equations and copies; fields under other names are equal."""
    field, other = Field(lorenz, given), Field(lorenz, 3)
    assert field.names == NAMES
    assert field == other
    assert hash(field) == hash(other)
    assert repr(field).startswith("Field(u' = 10*(v - u), v' = u*(28 - w) - v, w' = ")
    assert Field.from_hamiltonian(lambda x: x[0] * x[1], given, np.zeros((3, 3))).names == NAMES
    assert other.names == Field.from_dict(other.to_dict()).names == ("x1", "x2", "x3")


def test_what_is_printed():
    assert repr(Field.from_hamiltonian(henon_heiles, 4)).endswith(
        "H = (x3**2 + x4**2 + x1**2 + x2**2)/2 + x1**2*x2 - x2**3/3)"
    )
    several = Field(lambda x, a, b: (a * x[0], b), "u v", a=[1.0, 2.0], b=3)
    text = "<Field, a family of shape (2,): variables u v, a: 2 values from 1 to 2, b=3>"
    assert repr(several) == text
    assert "a: no values" in repr(several[:0])
    assert repr(several[1]) == "Field(u' = a*u, v' = b, a = 2.0, b = 3)"
    ratio = Field(lambda x: (8 / 3 * x[0] - x[0] / 7 + F(617, 2839),), "x")
    assert repr(ratio) == "Field(x' = 8/3*x - x/7 + 617/2839)"


def test_parameters_that_have_names_of_arguments():
    def right_hand_side(x, omega, f, H, K, save_every, each, equations):
        return omega * f * x[0] + H * K, save_every * x[1] - each * equations

    values = {"omega": [1.0, 2.0], "f": 3, "H": 4, "K": 5, "save_every": [6.0, 7.0]}
    values |= {"each": 8, "equations": 1}
    field = Field(right_hand_side, 2, **values)
    assert field.parameters.keys() == values.keys()
    assert field.sel(omega=2).parameters["save_every"] == 7.0
    assert field[1]([0.0, 0.0]).tolist() == [20, -8]
    assert Field.from_dict(field.to_dict()) == field
    data = iterate(field, [1.0, 1.0], 0.01, 10).to_xarray()
    assert (data.save_every.values.tolist(), data.attrs["save_every"]) == ([6, 7], 1)


def test_names_of_datasets_of_maps():
    """A motion has no eps and no n, which are coordinates of runs of maps."""
    data = iterate(Field(lambda x: -x, "u"), [1.0], 0.1, 1).to_xarray()
    for name in {*data.variables, *data.dims, "end"}:
        with pytest.raises(ValueError, match=name):
            iterate(Field(lambda x, **_: -x, "u", **{name: 1.0}), [1.0], 0.1, 5)
    for name in ("n", "eps"):
        field = Field(lambda x, **_: -x, "u", **{name: [1.0, 2.0]})
        assert sf.flow(field, [1.0], time=[0.0, 0.5]).to_xarray().sizes["time"] == 2
    with pytest.raises(ValueError, match=r"eps.* another name"):
        iterate(Field(lambda x: (-x[0], x[0]), "eps v"), [1.0, 1.0], 0.1, 5)


# ------------------------------------------------------------------------------- texts
EQUATIONS = {
    "lines": "x' = v\nv' = -sin(x) - k*v",
    "semicolons": "x' = v; v' = -sin(x) - k*v;",
    "quotients": " dx/dt = v ; dv/dt=-sin(x)-k*v",
    "a value": "x' = v; v' = -sin(x) - c*v; c = 0.5",
    "a ratio": "x' = v; v' = -sin(x) - c*v; c = 1/2",
}


@pytest.mark.parametrize("name", EQUATIONS)
def test_equations_as_text(name):
    own = {} if "c =" in EQUATIONS[name] else {"k": 0.5}
    field = Field.from_equations(EQUATIONS[name], **own)
    assert field.names == ("x", "v")
    assert field == Field(lambda x, k: (x[1], -np.sin(x[0]) - k * x[1]), 2, k=0.5)
    family = Field.from_equations("x' = -k*x", k=[1.0, 2.0])
    assert family([3.0]).tolist() == [[-3.0], [-6.0]]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "like"), ("x = v", "x'"), ("x'' = -x", "order 1"), ("x' = 2x", r"2\*x"),
        ("x' = v", "'v'"), ("x' = 1; x' = 2", "two"), ("x' = k*x; k = 1", "two"),
        ("x' = x^2", r"x\*\*2"), ("x' == 2", "read"), ("x' = exit()", "exit"),
    ],
)  # fmt: skip
def test_texts_that_are_no_equations(text, word):
    with pytest.raises((ValueError, TypeError), match=word):
        Field.from_equations(text, k=1.0)


# ------------------------------------------------------------------------------- functions
OF_FUNCTIONS = [
    (lambda f: sf.flow(f, [1.0, 0.0], time=2.0).states[0, 0], math.cos(2.0)),
    (lambda f: sf.crossings(f, [1.0, 0.0], "x1", time=6.0).time, [math.pi / 2, 3 * math.pi / 2]),
    (lambda f: sf.lyapunov_exponents(lambda x: (-x[0],), [1.0], time=5.0), -1.0),
    (lambda f: sf.equilibria(lambda x: (1 - x[0] * x[1], x[0] - 2), [1.0, 1.0]).states, [2, 0.5]),
    (lambda f: sf.periodic_orbit(
        lambda x: (x[1], (1 - x[0] ** 2) * x[1] - x[0]), [2.0, 0.0], 6.6).period, 6.663286859323),
]  # fmt: skip


def test_a_function_in_place_of_a_field():
    def f(x):
        return x[1], -x[0]

    for call, value in OF_FUNCTIONS:
        np.testing.assert_allclose(call(f), value, rtol=1e-6)
    assert sf.flow(f, [1.0, 0.0], time=1.0).body == Field(lambda x: (x[1], -x[0]), 2)
    with pytest.raises(TypeError, match=r"Field\(f, 2, k=\.\.\.\)"):
        sf.flow(lambda x, k: (x[1], -k * x[0]), [1.0, 0.0], time=1.0)


def test_what_sympy_and_complex_variables_need():
    names = sympy.symbols("x y z")
    x, y, z = names
    rows = [10 * (y - x), x * (28 - z) - y, x * y - 3 * z]
    f = sympy.lambdify([names], sympy.Matrix(rows))
    field = Field(f, 3)
    assert field == Field(sympy.lambdify([names], rows), 3)
    assert Field(sympy.lambdify([names], rows), names).names == ("x", "y", "z")
    root, third = sympy.sqrt(2), sympy.Rational(1, 3)
    assert Field(lambda a: (root * a[1], third * a[0]), 2)([1.0, 1.0]).tolist() == [2**0.5, 1 / 3]
    for given in (rows, lambda _: sympy.Matrix(rows)):
        with pytest.raises(TypeError, match=r"lambdify|from_terms"):
            Field(given, 3)
    with pytest.raises(TypeError, match="complex="):
        Field(lambda a: (1j * a[0], a[1]), 2)


def test_long_lists_of_states_are_those_of_arrays(rng):
    field, x = Field(lambda x: np.roll(x, 1) * x - x, 4), rng.normal(size=(200, 4))
    expected = sf.step(field, x, 0.01)
    for rows in (x.tolist(), [*map(tuple, x.tolist())]):
        assert (sf.step(field, rows, 0.01) == expected).all()
        rows[150] = [True, 0.0, 0.0, 0.0]
        with pytest.raises(TypeError, match="bool"):
            sf.step(field, rows, 0.01)
        rows[150] = [0.0, 0.0, 0.0]
        with pytest.raises(ValueError, match="rows of equal length"):
            sf.step(field, rows, 0.01)


@pytest.mark.parametrize("shape", [(4,), (), (3, 4), (3, 1), (20, 1), (0, 4)])
def test_states_of_a_family_of_many_terms_broadcast(shape):
    rng = np.random.default_rng(0)
    family, x = Field.from_terms(rng.normal(size=(4, 20, 20, 20))), rng.normal(size=(*shape, 20))
    whole = np.broadcast_to(x, (*np.broadcast_shapes(shape, (4,)), 20))
    for k in range(4):
        assert (family(x)[..., k, :] == family[k](whole[..., k, :])).all()
        assert (family.jacobian(x)[..., k, :, :] == family[k].jacobian(whole[..., k, :])).all()
