"""Arguments: arrays and numbers of all kinds that are welcome, and signatures."""

import inspect
from fractions import Fraction

import numpy as np
import pandas
import pytest
from samples import Tensor

import suslov_fast as sf
from suslov_fast import Field, Suslov3D, SuslovND

BODY, OMEGA = Suslov3D(4, 1, -0.5, -0.3), [[1.0, 0.5], [0.2, 0.3]]
FIELD = Field.from_terms([[[0, 1], [0, 0]], [[0, 0], [0, -1]]])


def field(f, dimension=2, **parameters):
    return Field(f, dimension, **parameters)


def test_arrays_of_other_packages_are_welcome():
    assert (sf.step(BODY, Tensor(OMEGA), 0.1) == sf.step(BODY, OMEGA, 0.1)).all()
    assert field(lambda x, a: (a * x[0], 1), a=Tensor(2.0)).parameters == {"a": 2.0}


def test_values_at_the_ends_of_the_range():
    for size in (1e-50, 1e50):
        body = Suslov3D(size, size, size, 0)
        assert body.parameters["I1"] == size
    for size in (1e-60, 1e60):
        assert Suslov3D(1, 1, size, -size, size).k == size
        assert SuslovND(J=[size, 1], I=[size, 0]).J[0] == size
        assert (Field.from_terms([[[size]]], [[size]], [size]).terms[1] == size).all()


def test_unusual_numbers_are_welcome():
    body = Suslov3D(Fraction(4), np.longdouble(1), np.float16(-0.5), -0.25)
    assert body == Suslov3D(4, 1, -0.5, -0.25)
    expected = FIELD([0.5, 2.0])
    for x in (np.array([0.5, 2], np.longdouble), np.float16([0.5, 2]), np.array([0.5, 2], object)):
        assert (FIELD(x) == expected).all()
    with pytest.warns(UserWarning, match=r"^eps: .*kahan"):
        run = sf.iterate(body, [1, Fraction(1, 2)], Fraction(1, 5), 3)
    assert run == sf.iterate(body, [1, 0.5], 0.2, 3)


# Without those that loops of users call: they are functions only where nothing is compiled.
FUNCTIONS = [
    (f"{module.__name__}.{name}", getattr(module, name))
    for module in (sf, sf.compiled, sf.integrability)
    for name in module.__all__
    if inspect.isfunction(getattr(module, name)) and hasattr(getattr(module, name), "__wrapped__")
]


@pytest.mark.parametrize(("name", "function"), FUNCTIONS, ids=[name for name, _ in FUNCTIONS])
def test_body_and_state_are_positional_only(name, function):
    """A state is omega for a body and x for a field: no name of the argument would fit both."""
    first = "body field system omega omega0 x x0 xy start run".split()
    for parameter in inspect.signature(function).parameters.values():
        is_first = parameter.name in first
        assert is_first == (parameter.kind == parameter.POSITIONAL_ONLY), parameter
    if name == "suslov_fast.iterate":
        with pytest.raises(TypeError, match=r"omega0.*the second argument"):
            function(BODY, omega0=OMEGA, eps=0.2, steps=3)


def test_arrays_of_pandas_are_arrays():
    field = sf.Field(lambda x, a: -a * x, "u", a=pandas.Series([1.0, 2.0]))
    times = pandas.DataFrame({"time": [0.5, 1.0]}).time
    expected = np.exp(-np.outer([0.5, 1.0], [1.0, 2.0]))
    np.testing.assert_allclose(sf.flow(field, [1.0], time=times)["u"], expected, rtol=1e-8)
