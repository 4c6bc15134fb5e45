"""Quadratic fields: coefficients, Hamiltonians, named parameters, families and text."""

import json
import pickle
from fractions import Fraction as F
from functools import partial

import numpy as np
import pytest
from systems import lorenz

import suslov_fast as sf
from suslov_fast import QuadraticField, iterate, vector_field
from suslov_fast.bodies.fields.names import variables
from suslov_fast.bodies.fields.polynomials import named_parameters

of_function, of_hamiltonian = QuadraticField.from_function, QuadraticField.from_hamiltonian


def henon_heiles(x, a=1):
    q1, q2, p1, p2 = x
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + a * q1**2 * q2 - a * q2**3 / 3


VALUES = np.linspace(1.0, 6.0, 11)
LORENZ, HENON = of_function(lorenz, 3), of_hamiltonian(henon_heiles, 4)
RIGID = of_hamiltonian(  # K of rank 2
    lambda x: x[0] ** 3 - x[0] * x[1] * x[2] + F(1, 3) * x[2] ** 2 - 5 * x[1] + 2,
    3,
    [[0, 1, -2], [-1, 0, F(1, 7)], [2, F(-1, 7), 0]],
)
FAMILY = of_function(lorenz, 3, rho=VALUES)
ENERGIES = of_hamiltonian(
    lambda x, a, b: x[1] ** 2 / 2 + a * x[0] ** 2 - b * a * x[0] ** 3 / 7,
    2,
    a=VALUES[:, None],
    b=[0.5, 1.0],
)
PARTS = "quadratic", "linear", "constant"
FIELDS = {name: each for name, each in globals().items() if isinstance(each, QuadraticField)}


def coefficients(field):
    """Return the coefficients of a field (..., D**3 + D**2 + D)."""
    arrays = [getattr(field, name) for name in PARTS]
    return np.concatenate([a.reshape(*field.shape, -1) for a in arrays], axis=-1)


def test_coefficients_of_a_function_are_exact():
    assert LORENZ.linear[2, 2] == -F(8 / 3) != -F(8, 3)
    assert (LORENZ.quadratic[1, 0, 2], LORENZ.quadratic[1, 2, 0]) == (F(-1, 2), F(-1, 2))
    x = (F(1, 3), 2, F(-5, 7))
    assert {type(a) for field in (LORENZ, RIGID) for a in coefficients(field)} == {F}
    assert LORENZ(x) == (*lorenz(x)[:2], x[0] * x[1] - F(8 / 3) * x[2])
    A = np.array([[0.1, 1], [-1, 0]])
    assert of_function(lambda x: A @ x, 2).linear.tolist() == [[F(0.1), 1], [-1, 0]]
    assert of_function(lambda x: A[0] * x[0] - x[1] * A[1], 2).linear[0, 0] == F(0.1)
    assert of_function(lambda x: [np.dot(x, x), np.dot(A, x)[0]], 2).quadratic[0, 1, 1] == 1
    halves = of_function(lambda x: x[0] / np.array([2.0, 4]) + x[1] / np.array(2.0), 2)
    assert halves.linear.tolist() == [[F(1, 2), F(1, 2)], [F(1, 4), F(1, 2)]]
    shifted = of_function(lambda x: [np.float32(0.1) - x[0] ** 2 / 3, +x[1] * np.int64(2)], 2)
    assert shifted([3, 4]) == (F(float(np.float32(0.1))) - 3, 8)
    large = QuadraticField([[[0.1]]], [[F(np.int64(2**62), 3)]])
    assert large([2**40]) == (F(0.1) * 2**80 + F(2**102, 3),)
    # A list of integers and floats keeps the integers, and the antisymmetric part is dropped.
    plain = QuadraticField([[[0, 2**70 + 1], [0.5, 0]], [[0, 1], [-1, 0]]])
    assert plain([1, 1]) == (2**70 + F(3, 2), 0)
    assert not plain.quadratic[1].any()


@pytest.mark.parametrize("field", [HENON, RIGID])
def test_gradient_of_a_hamiltonian(field):
    D, h = field.dimension, F(1, 10**9)
    x, steps = np.array([F(k, 7) for k in (3, -8, 5, 2)[:D]]), h * np.eye(D, dtype=int)
    gradient = [(field.H([*(x + step)]) - field.H([*(x - step)])) / (2 * h) for step in steps]
    assert abs(field([*x]) - field.K @ gradient).max() < F(1, 10**15)


def test_the_structure_of_a_hamiltonian_field():
    """K is part of a field, also where grad H = (1, 0, 0) does not see all of it; H is, too."""
    K = np.array([[0, 1, 2], [-1, 0, 3], [-2, -3, 0]])
    moved = QuadraticField([[[1, 0], [0, 0]], [[0, 0], [0, 0]]])
    assert moved != QuadraticField([[[0, 0], [0, 0]], [[1, 0], [0, 0]]])
    field, twin = (of_hamiltonian(lambda x: x[0], 3, k) for k in (K, np.where(abs(K) == 3, -K, K)))
    assert (field.constant == twin.constant).all()
    assert field != twin
    assert field != of_hamiltonian(lambda x: x[0] + 1, 3, K)
    assert field != QuadraticField(field.quadratic, field.linear, field.constant)
    for each in (LORENZ, FAMILY):
        assert each == QuadraticField(each.quadratic, each.linear, each.constant)
    assert ENERGIES.H(np.ones((5, 1, 1, 2))).shape == (5, 11, 2)
    one = of_hamiltonian(lambda x: x[0] ** 2, 1, [[0]])
    assert (one([2]), one.H([3])) == ((0,), 9)


def test_what_is_printed():
    H = "x1^2*x2 - 1/3*x2^3 + 1/2*x1^2 + 1/2*x2^2 + 1/2*x3^2 + 1/2*x4^2"
    assert repr(HENON).endswith(f"H = {H})")
    assert repr(QuadraticField([[[0]]], constant=[0])) == "QuadraticField(x1' = 0)"
    square = of_function(lambda x: (x[0] ** 2 + x[1], 1 - x[0] * x[1]), 2)
    assert repr(square) == "QuadraticField(x1' = x1^2 + x2, x2' = -x1*x2 + 1)"
    assert repr(FAMILY) == "<QuadraticField of shape (11,): D=3, rho: 11 values from 1 to 6>"
    several = of_function(lambda x, a, b: (a * x[0], b), "u v", a=[1.0, 2.0], b=3)
    assert (
        repr(several)
        == "<QuadraticField of shape (2,): variables u v, a: 2 values from 1 to 2, b=3>"
    )
    assert "a: no values" in repr(several[:0])
    assert len(repr(QuadraticField(np.ones((9, 9, 9))))) < 320


NAMES = ("u", "v", "w")
of_names = [
    "u v w", " u, v,w ", ["u", "v", "w"], ("u", "v", "w"), np.array(["u", "v", "w"]),
]  # fmt: skip


@pytest.mark.parametrize("given", of_names, ids=repr)
def test_names_of_variables(given):
    """They are those of equations and copies; fields under other names are equal."""
    field = of_function(lorenz, given)
    assert field.names == NAMES
    assert field == LORENZ
    assert hash(field) == hash(LORENZ)
    assert repr(field).startswith("QuadraticField(u' = -10*u + 10*v, v' = -u*w + 28*u - v, w' = ")
    assert QuadraticField(*(getattr(field, name) for name in PARTS), names=given).names == NAMES
    assert of_hamiltonian(lambda x: x[0] * x[1], given, np.zeros((3, 3))).names == NAMES
    plain = json.loads(json.dumps(field.to_dict()))
    for twin in (QuadraticField.from_dict(plain), pickle.loads(pickle.dumps(field))):
        assert (twin, twin.names) == (field, NAMES)
    assert LORENZ.names == QuadraticField.from_dict(LORENZ.to_dict()).names == ("x1", "x2", "x3")


def test_names_of_variables_in_results():
    field = of_function(lambda x, a: (x[1], -a * x[0]), "theta v_dot", a=[1.0, 4.0])
    run = iterate(field, [0.5, 0.1], 0.1, 20)
    data = run.to_xarray()
    assert data.component.values.tolist() == ["theta", "v_dot"]
    assert (vector_field(field, data.states) == vector_field(field, run.states)).all()
    ax = run.plot("v_dot", "theta")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("v_dot", r"$\theta$")
    ax.figure.canvas.draw()
    with pytest.raises(AttributeError, match=r"run\['v_dot'\]"):
        _ = run.v_dot
    assert (run["v_dot"] == run.states[..., 1]).all()
    for names in (["v_dot", "theta"], ("v_dot", "theta")):
        assert (run[names] == run.states[..., ::-1]).all()
    with pytest.raises(KeyError, match="theta, v_dot"):
        _ = run["theta", "v"]


def test_other_values_of_parameters():
    field = of_function(lorenz, "u v w", rho=2.0)
    assert field.with_parameters(rho=VALUES) == of_function(lorenz, "u v w", rho=VALUES)
    energy = of_hamiltonian(henon_heiles, "q1 q2 p1 p2", a=2.0).with_parameters(a=3.0)
    assert energy == of_hamiltonian(henon_heiles, "q1 q2 p1 p2", a=3.0)
    for each, name in ((field, "r"), (QuadraticField.from_dict(field.to_dict()), "rho")):
        with pytest.raises(TypeError, match=r"with_parameters: .*(it has rho|make it again)"):
            each.with_parameters(**{name: 1.0})


def test_parameters_that_have_names_of_arguments():
    """Only what really clashes is refused."""

    def right_hand_side(x, omega, f, H, K, save_every, states):
        return omega * f * x[0] + H * K, save_every * x[1] - states

    values = {"omega": [1.0, 2.0], "f": 3, "H": 4, "K": 5, "save_every": [6.0, 7.0], "states": 8}
    field = of_function(right_hand_side, 2, **values)
    assert field.parameters.keys() == values.keys()
    assert field.sel(omega=2).parameters["save_every"] == 7.0
    assert field[1].constant.tolist() == [20, -8]
    assert QuadraticField.from_dict(field.to_dict()) == field
    data = iterate(field, [1.0, 1.0], 0.01, 10).to_xarray()
    assert (data.save_every.values.tolist(), data.attrs["save_every"]) == ([6, 7], 1)
    wells = of_hamiltonian(lambda x, H: H * x[0] ** 2 + x[1] ** 2, 2, H=[1.0, 3.0])
    assert wells.sel(H=3).H([1, 1]) == 4


MANY = {"a": np.linspace(0.1, 0.37, 7)[:, None], "b": np.linspace(-2.9, 4.7, 5), "c": 3}
OF_FAMILIES = {
    "as it is": lambda x, a, b, c: (-x[1] + a * x[0], b + x[1] * (x[0] - c)),
    "floats first": lambda x, a, b, c: (a * b / c * x[0], (a + 0.1 - b) ** 2 * x[1] + a**3),
    "rounded once": lambda x, a, b, c: (a * x[0] * b * 3, (a * x[0] + b * x[0]) * c + F(1, 3)),
    "quotients": lambda x, a, b, c: (x[0] * b / a / F(3, 7), (b - a) * x[1] * x[0] / a + 1 / a),
    "thirds": lambda x, a, b, c: (F(2, 7) * a * x[0] - b * x[1] / 3, b / 3 * x[1] + x[0] * a / 49),
    "zeros": lambda x, a, b, c: ((a - a) * x[0] - 0 * b, -b * x[1] * 0.1 * (x[0] + a)),
    "NumPy": lambda x, a, b, c: b * np.array(x) * np.float64(0.1) + a,
    "arrays of floats": lambda x, a, b, c: np.array([[a, b], [b, a]]) @ np.eye(2) * 0.1 @ x,
    "in place": lambda x, a, b, c: [*map(in_place, x, (a, b))],
    "a type": lambda x, a, b, c: ((a if isinstance(a, float) else a * a) * x[0], x[1] * b),
    "a degree that vanishes": lambda x, a, b, c: ((a - a) * x[0] ** 3, b * x[1]),
}  # fmt: skip


def in_place(x, a):
    a *= 0.1
    x += a
    return x


@pytest.mark.parametrize("f", OF_FAMILIES.values(), ids=OF_FAMILIES)
def test_a_family_has_the_bits_of_its_members(f):
    """It is called for each of them, with numbers of Python."""
    family = of_function(f, 2, **MANY)
    for index in np.ndindex(7, 5):
        values = {key: float(np.broadcast_to(each, (7, 5))[index]) for key, each in MANY.items()}
        single = of_function(f, 2, **values | {"c": 3})
        assert coefficients(family)[index].tobytes() == coefficients(single).astype(float).tobytes()


def test_the_derivative_of_the_right_hand_side(rng):
    """By central differences, which are exact for degree 2 but for rounding; families broadcast."""
    single = QuadraticField(*(rng.normal(size=(4,) * k) for k in (3, 2, 1)))
    family = QuadraticField(*(rng.normal(size=(5, *(4,) * k)) for k in (3, 2, 1)))
    linear = QuadraticField.from_function(lambda x: (x[1], F(1, 3) * x[0], 2, x[0] * x[3]), 4)
    for field, batch in (
        (single, ()),
        (single, (2, 3)),
        (family, (5,)),
        (family, (3, 1)),
        (linear, (6,)),
    ):
        x = rng.normal(size=(*batch, 4))
        shape = np.broadcast_shapes(field.shape, batch)
        differences = [field(x + h) - field(x - h) for h in np.eye(4)]
        expected = np.stack(np.broadcast_arrays(*differences), axis=-1) / 2
        found = field.jacobian(x)
        assert found.shape == (*shape, 4, 4)
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
        for i in np.ndindex(batch if not field.shape else ()):
            assert field.jacobian(x[i]).tolist() == found[i].tolist()
    assert linear.jacobian([0, 0, 0, 0]).tolist()[1] == [1 / 3, 0, 0, 0]
    assert np.isnan(linear.jacobian([1, np.nan, 0, 0])).all()
    large = QuadraticField.from_terms([[0], [4_999], [5_000]], [2.0], 5_000)
    with pytest.raises(ValueError, match=r"^x must"):
        single.jacobian([1.0, 2.0])
    with pytest.raises(ValueError, match=r"^x must"):
        single.jacobian([1.0, 2.0, np.inf, 0.0])
    assert large.jacobian(np.ones(5_000))[0, 4_999] == 2.0


def test_fields_without_a_map_have_the_names_of_maps():
    """Datasets of maps have the coordinates eps and n, those of motions have none."""
    for name, read in (
        ("eps", partial(variables, "names", "u eps")),
        ("eps", partial(named_parameters, {"eps": 2.0}, ["u"])),
        ("n", partial(named_parameters, {"n": 2.0}, ["u"])),
    ):
        with pytest.raises(ValueError, match=name):
            read()
        assert name in read(has_map=False)
    for name in ("eps", "n", "end"):
        with pytest.raises(ValueError, match=name):
            named_parameters({name: 2.0}, ["u", "eps", "n"], has_map=False)
    field = sf.Field.from_function(lambda x, n: (-(x[0] ** n),), "u", n=[1.0, 2.0])
    assert sf.flow(field, [1.0], time=[0.0, 0.5]).to_xarray().n.values.tolist() == [1.0, 2.0]
