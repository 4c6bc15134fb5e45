"""What every system does, a field or a body: values, members, copies, files, and errors."""

import copy
import json
import pickle
from fractions import Fraction

import numpy as np
import pytest
from systems import henon_heiles, lorenz

from suslov_fast import Field, Map, Suslov3D, SuslovND, flow, iterate


def angles(x, g, m):
    return x[1], -g * np.sin(x[0]) / (1 + m)


def steps(x, k):
    return np.where(x[0] > k, -1.0, 1.0) - x[0] ** 2.5, np.interp(x[1], [0, 1, 2], [1, 3, 2])


RNG = np.random.default_rng(0)
GRID = np.linspace(1.0, 6.0, 3)
SYSTEMS = {
    "body": Suslov3D(4, 1, -0.5, -0.3),
    "bodies": Suslov3D([[4.0], [0.1]], [1, 2, 3], -0.5, 1 / 3),
    "bodies with I3": Suslov3D(4, 2, -0.5, -0.3, I3=[3.0, 4.0]),
    "n dimensions": SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]),
    "bodies in n dimensions": SuslovND(J=np.ones((2, 5)), I=np.full((3, 1, 5), 0.1)),
    "gyrostat": Suslov3D(2.3, 1.4, 0.5, -0.7, 0.9),
    "gyrostats": Suslov3D(2.3, 1.4, 0.5, -0.7, [[0.0], [-0.9]]),
    "no gyrostat": Suslov3D(2.3, 1.4, 0.5, -0.7, []),
    "field": Field(angles, "phi v", g=9.81, m=Fraction(1, 3)),
    "fields": Field(angles, "phi v", g=GRID[:, None], m=[0.5, 1.0]),
    "field with steps": Field(steps, 2, k=2.0),
    "fields with steps": Field(steps, 2, k=GRID),
    "degree 2": Field(lorenz, "u v w"),
    "degree 2, family": Field(lorenz, 3, rho=GRID),
    "degree 2, no member": Field(lambda x, a, b: (a / b * x[0] * x[1], -x[0]), 2, a=[], b=2.0),
    "Hamiltonian": Field.from_hamiltonian(henon_heiles, 4),
    "Hamiltonians": Field.from_hamiltonian(
        lambda x, a: a * x[0] ** 2 - x[1] * x[2],
        3,
        [[0, 1, -2], [-1, 0, 0.1], [2, -0.1, 0]],
        a=GRID,
    ),
    "equations": Field.from_equations("x' = y - tanh(k*x)\ny' = -7/11*x; k = 2/3"),
    "mass": Field(
        lambda x, g: (x[1], -g * x[0]), 2, mass=lambda x: [[1, 0], [0, 1 + x[0] ** 2]], g=9.81
    ),
    "terms": Field.from_terms(*(RNG.normal(size=(3,) * k) for k in (3, 2, 1)), "a b c"),
    "families of terms": Field.from_terms(RNG.normal(size=(2, 3, 3, 3)), np.eye(3)),
    "a member": Field(lorenz, 3, rho=GRID)[1],
    "other values": Field(lorenz, 3, rho=GRID).with_parameters(rho=0.5),
}
SYSTEMS |= {
    "map": Map(
        lambda x, a, b: (1 - a * x[0] ** 2 + x[1], b * x[0]), "x y", a=Fraction(7, 5), b=0.3
    ),
    "maps": Map(lambda x, k: (np.mod(x[0] + k, 2.0), x[1] * x[0], k * 1.5), 3, k=GRID),
    "maps with steps": Map(steps, 2, k=GRID[:, None]),
    "map of one variable": Map(np.sin, "x"),
}
each = pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
BATCHES = {name: system for name, system in SYSTEMS.items() if system.shape}
each_batch = pytest.mark.parametrize("system", BATCHES.values(), ids=BATCHES)


def states(system, *shape):
    return np.random.default_rng(1).uniform(0.2, 0.7, (*shape, system.dimension))


def field_of(system):
    """The field of a system, or a map, which is as good for values."""
    return system if isinstance(system, (Field, Map)) else system.field()


def moved_by(system, x):
    """States after a time, or after some steps of a map."""
    run = iterate(system, x, 5) if isinstance(system, Map) else flow(system, x, time=0.3)
    return run.states[-1:]


@each
def test_values_and_derivatives(system):
    field, x = field_of(system), states(system, 4, *np.ones_like(system.shape))
    values = field(x)
    assert values.shape == (4, *system.shape, system.dimension)
    np.testing.assert_allclose(values, system(x), rtol=1e-13, atol=1e-13)
    h = 1e-6 * np.eye(system.dimension)
    differences = np.stack([field(x + d) - field(x - d) for d in h], axis=-1) / 2e-6
    np.testing.assert_allclose(field.jacobian(x), differences, rtol=1e-6, atol=1e-7)
    x[0] = np.nan
    assert np.isnan(field(x)[0]).all()
    assert np.array_equal(field(x)[1:], values[1:])


@each
def test_copies_are_equal_and_immutable(system):
    plain = json.loads(json.dumps(system.to_dict()))
    copies = [pickle.loads(pickle.dumps(system)), copy.deepcopy(system), copy.copy(system)]
    copies.append(type(system).from_dict(plain))
    x = states(system)
    moved = moved_by(system, x)
    for twin in copies:
        assert twin == system
        assert hash(twin) == hash(system)
        assert (twin.shape, repr(twin)) == (system.shape, repr(system))
        assert json.dumps(twin.to_dict()) == json.dumps(plain)
        assert np.array_equal(moved_by(twin, x), moved, equal_nan=True)
    assert "\n" not in repr(system)
    assert len(repr(system)) < 310
    with pytest.raises(AttributeError):
        system.dimension = 3
    for array in (each for each in system.parameters.values() if isinstance(each, np.ndarray)):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 7


@each
def test_others_are_not_equal(system):
    others = [other for other in SYSTEMS.values() if other is not system]
    assert [other for other in others if other == system] == []
    assert system != 1


@each_batch
def test_members(system):
    members = list(system)
    assert len(members) == len(system) == system.shape[0]
    assert system[:] == system
    assert system[1:].shape == (max(len(system) - 1, 0), *system.shape[1:])
    x = states(system)
    moved = moved_by(system, x)
    for i, member in enumerate(members):
        assert member == system[i] == system[i - len(system)]
        assert member.shape == system.shape[1:]
        assert np.array_equal(moved_by(member, x)[0], moved[0, i])
        for name, value in member.parameters.items():
            whole = np.asarray(system.parameters[name])
            axes = (*system.shape, *whole.shape[whole.ndim - system._axes.get(name, 0) :])
            assert (np.broadcast_to(whole, axes)[i] == value).all()


WRONG = {
    "length": (ValueError, lambda x: x[:-1]),
    "infinite": (ValueError, lambda x: np.append(x[:-1], np.inf)),
    "complex": (TypeError, lambda x: x + 1j),
    "text": (TypeError, lambda x: [*map(str, x)]),
    "truth": (TypeError, lambda x: x > 0),
}


@pytest.mark.parametrize("case", WRONG)
@each
def test_wrong_states(system, case):
    error, of = WRONG[case]
    x = of(states(system))
    field = field_of(system)
    for call in (field, field.jacobian, lambda x: moved_by(system, x)):
        with pytest.raises(error, match=r"^x0? must|^omega0? must"):
            call(x)


@each
def test_a_dictionary_of_another_kind(system):
    plain = system.to_dict()
    for wrong in (plain | {"unknown": 1}, plain | {"body": "Bodies"}, {"body": plain["body"]}):
        with pytest.raises(ValueError, match=r"parameters|body"):
            type(system).from_dict(wrong)
