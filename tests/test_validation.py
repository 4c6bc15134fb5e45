"""Bad input raises a clear error, and changes nothing."""

import json
import re
import sys
from fractions import Fraction
from importlib import import_module

import numpy as np
import pytest
import xarray
from pandas import DataFrame, Series

import suslov_fast as sf

# No body has the I3 of some runs of the scheme in three components.
pytestmark = pytest.mark.filterwarnings("ignore:I3")
NAN, INF = float("nan"), float("inf")
OMEGA = [[1.0, 0.5], [0.2, 0.3]]

# Arguments with one bad value, the error, and a part of its message: expected and received.
BAD_BODIES = [
    ({"I1": 0}, ValueError, "I1: expected a positive moment of inertia, got 0.0"),
    ({"I2": [1, 2, -3]}, ValueError, "I2: expected a positive .* got -3.0"),
    ({"I1": NAN}, ValueError, "I1: expected finite real numbers, got nan"),
    ({"I13": [1, INF]}, ValueError, r"I13: expected finite real numbers, got inf at index \(1,\)"),
    ({"I23": 1j}, TypeError, "I23: expected real numbers, got 1j of dtype complex128"),
    ({"I23": "0.3"}, TypeError, "I23: expected real numbers, got '0.3' of dtype <U3"),
    ({"k": None}, TypeError, "k: expected real numbers, got None of type NoneType"),
    ({"I1": True}, TypeError, "I1: expected real numbers, got True of dtype bool"),
    ({"I1": [1, 2], "I2": [1, 2, 3]}, ValueError, r"broadcast .* I1 \(2,\), I2 \(3,\)"),
    ({"I1": 5e-324, "I2": 1.7e308}, ValueError, "I1, I2: expected moments within"),
]
BAD_ARGUMENTS = [
    ({"omega0": [1, INF]}, ValueError, r"omega0: expected finite .* got inf at index \(1,\)"),
    ({"omega0": 1.0}, ValueError, r"omega0: expected shape \(..., 2\), got \(\)"),
    ({"omega0": ["a", "b"]}, TypeError, r"omega0: expected real numbers, got \['a', 'b'\]"),
    ({"omega0": [[1, 2], [3]]}, ValueError, "omega0: expected a rectangular array"),
    ({"omega0": [None, 1]}, TypeError, "omega0: .* got None of type NoneType"),
    ({"omega0": {"x": 1}}, TypeError, "omega0: expected real numbers, got .* of type dict"),
    ({"omega0": [10**400, 1]}, ValueError, "omega0: expected numbers in the range of float64"),
    ({"omega0": np.array(["2020-01-01"] * 2, "M8[D]")}, TypeError, "omega0: expected real numbers"),
    ({"omega0": np.ma.masked_less([1.0, -1.0], 0)}, ValueError, "masked array with missing values"),
    ({"omega0": [np.ma.masked_less([1.0, -1.0], 0)] * 2}, ValueError, "omega0: .* masked array"),
    ({"eps": NAN}, ValueError, "eps: expected finite real numbers, got nan"),
    ({"eps": [0.1, 0.2, 0.3]}, ValueError, r"broadcast .* body \(\), omega0 \(2,\), eps \(3,\)"),
    ({"steps": -1}, ValueError, "steps: expected an integer of at least 0, got -1"),
    ({"steps": 10.0}, TypeError, "steps: expected an integer of at least 0, got 10.0 of type float"),
    ({"steps": True}, TypeError, "steps: expected an integer of at least 0, got True of type bool"),
    ({"steps": 2**64}, ValueError, r"steps: expected an integer below 2\*\*62, got 18446744073709"),
    ({"steps": 2**61, "out": None}, MemoryError, r"arrays that fit in memory, .* the saved states are \(2305843009213693953, 2, 2"),
    ({"save_every": 0}, ValueError, "save_every: expected None or an integer of at least 1, got 0"),
    ({"save_every": 1.5}, TypeError, "save_every: expected None or an integer .* got 1.5"),
    ({"method": "rk4"}, ValueError, "method: expected one of 'auto', 'canonical', 'ds2', got 'rk4'"),
    ({"attitude": 1}, ValueError, r"attitude: expected shape \(..., 3\), got \(\)"),
    ({"attitude": np.ones((3, 3))}, ValueError, "attitude: expected rotation matrices, got"),
    ({"attitude": np.full((3, 3), NAN)}, ValueError, "attitude: expected finite real numbers, got nan"),
    ({"attitude": np.stack([np.eye(3)] * 5)}, ValueError, r"broadcast .* attitude \(5,\)"),
    ({"threads": 10**6}, ValueError, "threads: expected None or an integer from 1 to .* got 1000000"),
    ({"threads": 1.5}, TypeError, "threads: expected None or an integer from 1 to .* got 1.5"),
    ({"on_singular": "stop"}, ValueError, "on_singular: expected one of 'warn', .* got 'stop'"),
    ({"progress": 0}, TypeError, r"progress: expected True, False, None or a callable .* got int"),
    ({"out": [[0, 0]]}, TypeError, "out: expected a NumPy array, got list"),
    ({"out": np.zeros((4, 2, 2), "f4")}, TypeError, "out: expected dtype float64, got float32"),
    ({"out": np.zeros((3, 2, 2))}, ValueError, r"out: expected shape \(4, 2, 2\), got \(3, 2, 2\)"),
    ({"out": np.frombuffer(bytes(128)).reshape(4, 2, 2)}, ValueError, "out: expected a writeable, aligned array"),
    ({"out": np.zeros(129, "u1")[1:].view("f8").reshape(4, 2, 2)}, ValueError, "out: expected a writeable, aligned array"),
    ({"out": np.zeros((4, 2, 4))[..., ::2]}, ValueError, "out: expected a C-contiguous array, got one that is not"),
]  # fmt: skip


@pytest.mark.parametrize(("bad", "error", "message"), BAD_BODIES)
def test_bodies(bad, error, message):
    given = {"I1": 4, "I2": 1, "I13": -0.5, "I23": -0.3, **bad}
    with pytest.raises(error, match=message):
        sf.SuslovGyrostat(**{"k": 0.1, **given})
    if "k" not in bad:
        with pytest.raises(error, match=message):
            sf.Suslov3D(**given)


@pytest.mark.parametrize(("bad", "error", "message"), BAD_ARGUMENTS)
def test_iterate(body, bad, error, message):
    out = np.full((4, 2, 2), 7.0)
    arguments = {"body": body, "omega0": OMEGA, "eps": 0.2, "steps": 3, "out": out, **bad}
    with pytest.raises(error, match=message):
        sf.iterate(**arguments)
    assert (out == 7).all()


ONES, ID = np.ones((4, 2)), np.eye(3)
ND, ROTOR = sf.SuslovND([1, 2, 3], [1, 1, 1]), sf.SuslovGyrostat(4, 1, -0.5, -0.3, 0.9)
BAD_CALLS = [
    (lambda b: sf.first_integral(ND, [1, 2, 3], 0.1), ": expected a body .*: use modified_energy"),
    (lambda b: sf.criticality(ND, [1, 2, 3], 0.1), ": expected a body .*: use iterate, and compare"),
    (lambda b: sf.limits(ND, [1, 2, 3], 0.1), ": expected a body .*: use iterate"),
    (lambda b: sf.exact(ND, [1, 2, 3], 0.1, 3), ": expected a body .*: use iterate"),
    (lambda b: sf.flow(ND, [1, 2, 3], 3.0), ": expected a body .*: use vector_field with scipy"),
    (lambda b: sf.from_xy(sf.Suslov3D(1, 2, [0, 1], 0), [1, 2]), "body: expected I13 or I23 other than 0, got both 0"),
    (lambda b: sf.closed_form(ROTOR, [1, 2], 0.1), "without a rotor, got SuslovGyrostat.*use exact"),
    (lambda b: sf.to_xy(ROTOR, [1, 2]), "without a rotor, got .*use iterate or flow"),
    (lambda b: sf.from_xy(ROTOR, [1, 2]), "without a rotor, got .*use iterate or flow"),
    (lambda b: sf.scattering_angle(ROTOR), "without a rotor, got .*use iterate or flow"),
    (lambda b: sf.step_full(ROTOR, [1, 2, 0], 0.1), "without a rotor, got .*use iterate or flow"),
    (lambda b: sf.iterate_full(ROTOR, [1, 2, 0], 0.1, 3), "without a rotor, got .*use iterate or flow"),
    (lambda b: sf.RandomStarts(3, 1.0).states(-1), "count: expected an integer of at least 0, got -1"),
    (lambda b: sf.scattering_angle(ND), "body: expected Suslov3D, got SuslovND"),
    (lambda b: sf.lyapunov_exponents(b, [1, 2], 0.1, 0), "steps: expected an integer of at least 1, got 0"),
    (lambda b: sf.iterate_full(b, [1.0, 0.5, 0.1], 0.1, 4, 3.0, out=np.empty((3, 3))), r"out: expected shape \(5, 3\), got \(3, 3\)"),
    (lambda b: sf.step_full(b, [1, 2, 3], 0.1, 0), r"I3: expected a positive moment of inertia, got 0\.0"),
    (lambda b: sf.iterate_full(b, [1, 2, 3], 0.1, 4, 0), r"I3: expected a positive moment of inertia, got 0\.0"),
    (lambda b: sf.step_full(b, np.zeros((3, 3)), 0.1, [3, 3]), r"expected batch shapes that broadcast .* body \(2,\)"),
    (lambda b: sf.iterate_full(b, np.zeros((3, 3)), 0.1, 4, [3, 3]), r"expected batch shapes that broadcast .* body \(2,\)"),
    (lambda b: sf.exact(b, [1, 2], 0.2, [[1, 2]]), "n: expected a number or a 1-D array, got"),
    (lambda b: sf.exact(b, [1, 2], 0.2, "3"), "n: expected real numbers, got '3'"),
    (lambda b: sf.exact(b, [1, 2], 0.2, NAN), "n: expected finite real numbers, got nan"),
    (lambda b: sf.flow(b, [1, 2], [[1]]), r"time: expected a number or a 1-D array"),
    (lambda b: sf.flow(b, [1, 2], INF), "time: expected finite real .* got inf"),
    (lambda b: sf.attitude(b, [1.0, 0.5], 0.2), r"omega: expected shape \(N \+ 1, ..., 2\), got \(2,\)"),
    (lambda b: sf.attitude(b, np.ones((0, 2)), 0.2), r"omega: expected shape \(N \+ 1, ..., 2\), got \(0, 2\)"),
    (lambda b: sf.attitude(b, np.ones((4, 5, 2)), [1, 2]), r"broadcast .* omega \(5,\), eps \(2,\)"),
    (lambda b: sf.attitude(b, ONES, 0.2, np.eye(2)), r"R0: expected shape \(..., 3\), got \(2, 2\)"),
    (lambda b: sf.attitude(b, ONES, 0.2, np.ones(3)), r"R0: expected shape \(..., 3, 3\), got \(3,\)"),
    (lambda b: sf.attitude(b, ONES, 0.2, 2 * ID), "R0: expected rotation matrices, got .* = 3"),
    (lambda b: sf.attitude(b, ONES, 0.2, -ID), "R0: expected rotation .* determinant -1"),
    (lambda b: sf.to_matrix(b, [1, 2], rotation=np.eye(2)), r"rotation: expected shape"),
    (lambda b: sf.to_matrix(b, [1, 2], attitude=np.ones(3)), r"attitude: expected shape"),
    (lambda b: sf.to_matrix(b, ONES, attitude=np.ones((3, 3, 3))), "broadcast"),
    (lambda b: sf.momentum(b, [1, 2], rotation=ID, attitude=ID), "at most one of them, got both"),
    (lambda b: sf.from_matrix(b, np.ones((3, 3))), "matrix: expected antisymmetric"),
    (lambda b: sf.from_matrix(b, np.ones((2, 2))), r"matrix: expected shape \(..., 3\)"),
    (lambda b: sf.from_matrix(b, [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]), "obey the constraint .* got 1"),
    (lambda b: sf.from_vector(b, [1, 2, 3]), "normal to the axis .* 3 along it"),
    (lambda b: sf.SuslovND.from_mass_tensor(np.diag([1.0, 2.0, -0.1]), [1, 2, 3]), "positive definite"),
    (lambda b: sf.SuslovND.from_mass_tensor(ID, ID), r"a: expected shape \(3,\)"),
    (lambda b: b.from_inertia(np.eye(2), [0, 0, 1]), r"I: expected shape \(..., 3, 3\), got \(2, 2\)"),
    (lambda b: b.from_inertia(ID, [0, 1]), r"a: expected shape \(..., 3\), got \(2,\)"),
    (lambda b: b.from_inertia(ID, [0, 0, 0]), "a: expected an axis other than 0"),
    (lambda b: b.from_inertia(np.triu(np.ones((3, 3))), [0, 0, 1]), "I: expected a symmetric inertia matrix"),
    (lambda b: b.from_inertia(np.diag([1, 1, -1]), [0, 0, 1]), "I: expected a positive definite .* eigenvalue -1.0"),
    (lambda b: b.from_inertia(np.diag([1, 1, 1e-17]), [1, 2, 3]), "I: expected a positive definite"),
    (lambda b: b.from_inertia(np.full((3, 3), NAN), [0, 0, 1]), "I: expected finite real numbers"),
    (lambda b: b.from_inertia(np.tile(ID, (2, 1, 1)), np.ones((3, 3))), r"broadcast .* I \(2,\), a \(3,\)"),
    (lambda b: b.from_inertia(np.diag([1, 2, 4]), [1, 2, 3]), "no principal moment larger than the sum of the others"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "message"), BAD_CALLS)
def test_other_functions(body, call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call(body)


OPERATIONS = "f: expected polynomials of degree at most 2, by .* got another operation on x"
AUTONOMOUS = "a field is autonomous: add the time as a variable, t' = 1, or a forcing as two"
FIELD = sf.QuadraticField.from_function(lambda x: (x[0] * x[1], -x[0]), 2)
BAD_FUNCTIONS = [
    (lambda x: (x[0] * x[1], x[0]), 3, "f: expected 3 components, got 2 in 3 dimensions"),
    (lambda x: (x[0] * x[2], x[0]), 2, r"f: expected x\[0\] to x\[1\]: the dimension is 2"),
    (lambda x, t: (x[0] * t, x[1]), 2, f"got other arguments t; {AUTONOMOUS}"),
    (lambda x: (np.sin(x[0]), x[1]), 2, OPERATIONS),
    (np.sin, 2, OPERATIONS),
    (lambda x: (1 / x[0], x[1]), 2, OPERATIONS),
    (lambda x: (max(x[0], 0), x[1]), 2, OPERATIONS),
    (lambda x: (float(x[0]), x[1]), 2, OPERATIONS),
    (lambda x: (x[0] ** 0.5, x[1]), 2, "f: power: expected a small integer of at least 0, got 0.5"),
    (lambda x: (x[0] * NAN, x[1]), 2, "f: .*expected finite numbers, got nan"),
    (lambda x: (x[0] ** 3, x[1]), 2, "got degree 3; x.3 is x y with a variable y = x.2, .*, which steps keep to order eps.2$"),
    (lambda x: None, 2, "f: expected a tuple of 2 components, got None"),
    (lambda x: x[0] * x[1], 2, r"f: expected a tuple of 2 components, got x1\*x2"),
    (lambda x: {x[0], x[1]}, 2, "f: expected a tuple of 2 components, got {x1, x2}"),
    (lambda x: (None, x[0]), 2, "the value of f: expected integers, fractions or floats, got NoneType"),
    (None, 2, "f: expected a function of x, the tuple of variables, got NoneType"),
    ([FIELD, FIELD], 2, "f: expected a function of x, the tuple of variables, got list"),
]  # fmt: skip


@pytest.mark.parametrize(("f", "dimension", "message"), BAD_FUNCTIONS)
def test_functions_that_are_no_fields(f, dimension, message):
    with pytest.raises((TypeError, ValueError), match=message) as caught:
        sf.QuadraticField.from_function(f, dimension)
    assert not re.search("Polynomial|ufunc|lambda|\n", str(caught.value))


STATES = np.ones((3, 2))
FIRST_HOUR = [
    (lambda b: sf.QuadraticField.from_hamiltonian(None, 2), "H: expected a function .* got NoneType"),
    (lambda b: sf.QuadraticField.from_function(None, 2, a=[3.0]), "f: expected a function .* got NoneType"),
    (lambda b: sf.ensemble(b, OMEGA, 0.2, 3, store="no.zarr", scheduler="foo"), "scheduler: expected an address .* got 'foo'"),
    (lambda b: sf.ensemble(b, OMEGA, 0.2, 3, store=3), "store: expected the name of a folder, .* got 3"),
    (lambda b: sf.QuadraticField.from_hamiltonian(lambda x: x[0] ** 4, 2), "H: .* degree at most 3, got degree 4$"),
    (lambda b: sf.QuadraticField.from_hamiltonian(lambda q, p: q * p, 2), "H: expected .*time as a variable"),
    (lambda b: sf.QuadraticField.from_hamiltonian(lambda x: (x[0], x[1]), 2), "the value of H: expected integers, fractions or floats, got tuple"),
    (lambda b: sf.iterate(b, STATES, [0.1, 0.2], 3), r"got body \(\), omega0 \(3,\), eps \(2,\); eps\[:, None\] would fit"),
    (lambda b: sf.energy(sf.Suslov3D([4, 3], 1, 0, 0), STATES), r"omega\[:, None\] would fit"),
    (lambda b: sf.step(b, np.ones((4, 3, 2)), [1, 2, 3, 4, 5]), r"eps\[:, None, None\] would fit"),
    (lambda b: sf.Suslov3D([4, 3], [1, 2, 3], 0, 0), r"I2\[:, None\] would fit"),
    (lambda b: sf.Suslov3D(np.ones((2, 1)), np.ones((3, 2)), 0, 0), r"I13 \(\), I23 \(\)$"),
    (lambda b: sf.to_vector(ND, [1, 2, 3]), "expected one in three dimensions, got SuslovND: use to_matrix"),
    (lambda b: sf.from_vector(ND, [1, 2, 3]), "got SuslovND: use from_matrix"),
    (lambda b: sf.body_from_dict(json.dumps(b.to_dict())), r"expected a dictionary, .* got text: pass json\.loads"),
    (lambda b: sf.Suslov3D.from_dict("{}"), r"got text: pass json\.loads"),
    (lambda b: sf.QuadraticField.from_dict([]), "expected a dictionary, .* got list"),
    (lambda b: sf.body_from_dict({"body": "Suslov3D", "I1": 4, "I2": 1}), "expected the names .* missing: I13, I23"),
    (lambda b: sf.body_from_dict({**b.to_dict(), "mass": 3}), "expected the names .* unknown: mass"),
    (lambda b: sf.iterate(sf.Suslov3D, [1, 2], 0.1, 3), "body: expected .* got the class Suslov3D"),
    (lambda b: sf.exact(FIELD, [1, 2], 0.1, 3), "got QuadraticField; fields have step, iterate"),
    (lambda b: sf.energy(FIELD, [1, 2]), "a field made by QuadraticField.from_hamiltonian, got"),
    (lambda b: sf.iterate(FIELD, [1, 2], 0.1, 3).omega, "omega: expected x or states, .* a run of QuadraticField"),
    (lambda b: sf.iterate(FIELD, [1, 2], 0.1, 3, attitude=True), "states of QuadraticField have no orientation"),
    (lambda b: sf.iterate(b, [1, 2], 0.1, 3).x, "x: expected omega or states, .* a run of Suslov3D"),
    (lambda b: sf.ensemble(b, __file__, 0.1, 3, store="no.zarr"), "omega0: expected the name of a .npy file"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "message"), FIRST_HOUR)
def test_the_first_hour(body, call, message):
    with pytest.raises((TypeError, ValueError, AttributeError), match=message):
        call(body)


MISSING = [
    ("xarray", "xarray", lambda run: run.to_xarray()),
    ("xarray", "xarray", lambda run: sf.Trajectories.from_xarray(None)),
    ("tqdm", "progress", lambda run: run.extend(3, progress=True)),
    ("flint", "algebra", lambda run: import_module("suslov_fast.integrability")),
]
LARGE = [
    (name, "large", lambda run: sf.ensemble(run.body, OMEGA, 0.2, 3, store="no.zarr"))
    for name in ("dask", "zarr", "xarray", "filelock")
]


@pytest.mark.parametrize(("library", "extra", "call"), MISSING + LARGE)
def test_missing_libraries(body, monkeypatch, library, extra, call):
    run = sf.iterate(body, OMEGA, 0.2, 3)
    monkeypatch.delitem(sys.modules, "suslov_fast.integrability", raising=False)
    for name in {library, *(each for each in sys.modules if each.startswith(f"{library}."))}:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=rf"pip install '\.\[{extra}\]'"):
        call(run)


def test_unusual_numbers_are_welcome(body):
    expected = sf.iterate(body, [0.5, 2.0], 0.25, 2).final
    for omega in ([Fraction(1, 2), 2], np.array([0.5, 2], np.longdouble), np.float16([0.5, 2])):
        assert (sf.iterate(body, omega, Fraction(1, 4), np.int8(2)).final == expected).all()
    assert sf.criticality(body, [0.5, 2], Fraction(1, 4)) == sf.criticality(body, [0.5, 2], 0.25)
    if np.finfo(np.longdouble).max > np.finfo(np.float64).max:
        with pytest.raises(ValueError, match="expected finite real numbers, got inf"):
            sf.step(body, [np.longdouble("1e400"), 1], 0.1)


class WithUnit(np.ndarray):
    """Array with a unit, like quantities of astropy and unyt; NumPy drops the unit."""

    unit = "ms"


class Magnitude:
    """Quantity like those of pint."""

    units = "ms"

    def __init__(self, magnitude):
        self.magnitude = magnitude

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.magnitude, dtype)


class Quantity(float):
    units = "ms"


WITH_UNITS = [
    (lambda value: np.array(value).view(WithUnit), r"got WithUnit in ms: .*\.to\(\.\.\.\)\.value"),
    (Magnitude, r"got Magnitude in ms: .*\.to\(\.\.\.\)\.magnitude"),
    (lambda value: [Magnitude(each) for each in np.atleast_1d(value)], "got Magnitude in ms"),
    (np.vectorize(Quantity, otypes=[object]), "got Quantity in ms"),
]


@pytest.mark.parametrize(("wrap", "message"), WITH_UNITS)
def test_units_are_refused(body, wrap, message):
    """Numbers with a unit are rejected: 20 ms must never be read as 20."""
    calls = {
        "eps": lambda: sf.iterate(body, OMEGA, wrap(20.0), 3),
        "omega0": lambda: sf.iterate(body, wrap([1.0, 0.5]), 0.2, 3),
        "omega": lambda: sf.energy(body, wrap([1.0, 0.5])),
        "n": lambda: sf.exact(body, [1.0, 0.5], 0.2, wrap(3.0)),
        "time": lambda: sf.flow(body, [1.0, 0.5], wrap(3.0)),
        "I1": lambda: sf.Suslov3D(wrap(4.0), 1, -0.5, -0.3),
        "I3": lambda: sf.step_full(body, [1.0, 0.5, 0.1], 0.2, wrap(3.0)),
        "attitude": lambda: sf.iterate(body, OMEGA, 0.2, 3, attitude=wrap(np.eye(3)[2])),
    }
    for name, call in calls.items():
        with pytest.raises(TypeError, match=f"{name}: expected numbers without a unit, {message}"):
            call()


def labelled(dims, **coords):
    return xarray.DataArray(OMEGA, dims=dims, coords=coords, attrs={"units": "1/s"})


IN_ORDER = labelled(("start", "component"), start=["p", "q"], component=["Omega1", "Omega2"])
SERIES = Series([1.0, 0.5], index=["Omega2", "Omega1"])
LABELS = [
    (lambda: labelled(("component", "start")), r"got .*: pass omega\.transpose\(\.\.\., 'component'\)$"),
    (lambda: labelled(("component", "n")), r"pass omega\.transpose\('n', \.\.\., 'component'\)$"),
    (lambda: labelled(("Omega", "start"), Omega=["Omega1", "Omega2"]), r"pass omega\.transpose\(\.\.\., 'Omega'\)$"),
    (lambda: labelled(("Omega", "start"), Omega=[1, 2]), r"got the axes \('Omega', 'start'\): .* pass omega\.values$"),
    (lambda: labelled(("start", "foo")), "expected a last axis 'component', or one with the labels .'Omega1', 'Omega2'., got"),
    (lambda: labelled(("start", "foo")).to_dataset(name="omega"), "got Dataset: pass one variable"),
    (lambda: [SERIES], "in order, got .'Omega2', 'Omega1'."),
    (lambda: ([1.0, 0.5], SERIES), "in order, got .'Omega2', 'Omega1'."),
    (lambda: [IN_ORDER[0], IN_ORDER[1, ::-1]], "in order, got .'Omega2', 'Omega1'."),
    (lambda: [IN_ORDER, IN_ORDER], r"got one with the axes \('start', 'component'\) at \[0\]: pass its values"),
    (lambda: [IN_ORDER[0, 1], 2.0], r"expected Omega2 at \[1\], got it at \[0\]"),
    (lambda: xarray.DataArray([OMEGA], dims=("start", "n", "component")), r"got \('start', 'n', 'component'\): pass omega\.transpose\('n', \.\.\., 'component'\)$"),
    (lambda: labelled(("start", "component"), component=["Omega2", "Omega1"]), "expected the components .'Omega1', 'Omega2'. in order, got .'Omega2', 'Omega1'."),
    (lambda: labelled(("start", "component"), component=[1, 0]), "in order, got"),
    (lambda: labelled(("start", "axis"), axis=["y", "x"]), r"got the axes \('start', 'axis'\)"),
    (lambda: DataFrame({"Omega2": [1.0, 2.0], "Omega1": [2.0, 3.0]}), "got DataFrame, .*to_numpy"),
    (lambda: DataFrame({"a": [1.0, 2.0]}).set_index([["Omega2", "Omega1"]])["a"], "in order, got"),
]  # fmt: skip


@pytest.mark.parametrize(("omega", "message"), LABELS)
def test_conflicting_labels(body, omega, message):
    value = omega()
    for call in (lambda: sf.step(body, value, 0.2), lambda: sf.energy(body, value)):
        with pytest.raises((TypeError, ValueError), match=f"omega: .*{message}"):
            call()


def test_labels_in_order(body):
    expected = sf.step(body, OMEGA, 0.2)
    for value in (
        labelled(("start", "component"), component=["Omega1", "Omega2"]),
        labelled(("n", "component"), component=[0, 1]),
        labelled(("start", "Omega"), Omega=["Omega1", "Omega2"]),
        labelled(("start", "component")).variable,
        xarray.DataArray(OMEGA),
        [IN_ORDER[0], IN_ORDER[1]],
        (IN_ORDER[0], [IN_ORDER[1, 0], 0.3]),
    ):
        assert (sf.step(body, value, 0.2) == expected).all()
    series = Series([1.0, 2.0])
    assert (sf.step(body, series, 0.2) == sf.step(body, [1.0, 2.0], 0.2)).all()


def test_arrays_of_our_datasets_are_accepted_everywhere(tmp_path):
    """Labelled axes are matched by name, not by position."""
    body = sf.Suslov3D(4, 1, np.array([-0.5, -0.4])[:, None], -0.3)
    sizes = np.array([0.2, 0.3])[:, None, None]
    run = sf.iterate(body, OMEGA, sizes, 6, attitude=True)
    data = run.to_xarray(dims=("eps", "I13", "start"))
    assert (sf.energy(body, data.omega) == run.energy()).all()
    assert (sf.first_integral(body, data.omega, data.eps) == run.first_integral()).all()
    assert (sf.reaction(body, data.omega, data.eps) == run.reaction()).all()
    again = sf.iterate(body, data.omega[0], data.eps, 6, attitude=data.attitude[0])
    assert (again.attitude == run.attitude).all()
    assert (again.omega == run.omega).all()
    for name, starts in {"numpy": data.omega[0], "dask": data.omega[0].chunk()}.items():
        stored = sf.ensemble(body, starts, data.eps, 6, store=tmp_path / name)
        assert (stored.final.values == run.final).all()
    other = data.attitude.transpose("n", "start", "I13", "eps", ...)
    expected = sf.momentum(body, run.omega, attitude=run.attitude)
    assert (sf.momentum(body, data.omega, attitude=other) == expected).all()
    turned = sf.attitude(body, data.omega, data.eps)
    np.testing.assert_allclose(turned, run.attitude, rtol=0, atol=1e-14)
    with pytest.raises(ValueError, match=r"eps: expected axes among .* got \('other',\)"):
        sf.iterate(body, data.omega[0], data.eps.rename(eps="other"), 6)


def test_labels_that_cannot_be_honoured():
    """Parameters of a body lose their labels, and arguments are not aligned by coordinates."""
    body, sizes = sf.Suslov3D(4, 1, -0.5, -0.3), xarray.DataArray([3.0, 5.0], dims="a")
    assert sf.Suslov3D(xarray.DataArray(4.0), 1, -0.5, -0.3) == body
    with pytest.raises(ValueError, match=r"I1: .* got the axes \('a',\): pass its values"):
        sf.Suslov3D(sizes, 1, -0.5, -0.3)
    ab, ba = Series([4.0, 3.0], index=["a", "b"]), Series([1.0, 2.0], index=["b", "a"])
    assert sf.Suslov3D(ab, ab, -0.5, -0.3).shape == (2,)
    with pytest.raises(ValueError, match="I2: expected the index of I1, got another"):
        sf.Suslov3D(ab, ba, -0.5, -0.3)
    with pytest.raises(ValueError, match="I: expected the index of J, got another"):
        sf.SuslovND(ab, ba)
    with pytest.raises(ValueError, match="I: expected the index of J, got another"):
        sf.SuslovND([ab], (ba,))
    with pytest.raises(ValueError, match=r"I1: .* got the axes \('a',\): pass its values"):
        sf.Suslov3D([sizes], 1, -0.5, -0.3)
    with pytest.raises(ValueError, match=r"constant: .* got the axes \('a',\)"):
        sf.QuadraticField(np.ones((2, 2, 2)), constant=sizes)
    tensors = xarray.DataArray([np.eye(3)] * 2, dims=("a", "space", "body"))
    axes = xarray.DataArray(np.ones((2, 3)), dims=("b", "component"))
    with pytest.raises(ValueError, match=r"a: expected axes among \('a',\), .* got \('b',\)"):
        sf.Suslov3D.from_inertia(tensors, axes)
    starts = labelled(("a", "component"), a=["p", "q"])
    with pytest.raises(ValueError, match="eps: expected the coordinates of omega along 'a'"):
        sf.step(body, starts, sizes.assign_coords(a=["q", "p"]))
    same = sf.step(body, starts, sizes.assign_coords(a=["p", "q"]))
    assert (same == sf.step(body, OMEGA, sizes.values)).all()
    with pytest.raises(ValueError, match=r"time: .* without labels, .* the axes \('a',\)"):
        sf.flow(body, starts, sizes)
    assert sf.flow(body, starts, sizes.rename(a="time")).shape == (2, 2, 2)


@pytest.mark.parametrize(
    "call",
    [
        lambda b: sf.step(b, [True, 0.5], 0.2),
        lambda b: sf.step(b, [[1.0, 0.5], (np.True_, 2)], 0.2),
        lambda b: sf.step(b, np.array([1.0, False], object), 0.2),
        lambda b: sf.iterate(b, [np.array([True, False])], 0.2, 3),
        lambda b: sf.exact(b, [1.0, 0.5], [0.2, True], 3),
        lambda b: sf.exact(b, [1.0, 0.5], 0.2, [1, True]),
        lambda b: sf.flow(b, [1.0, 0.5], (0.5, False)),
        lambda b: sf.Suslov3D([4, True], 1, -0.5, -0.3),
        lambda b: sf.SuslovND([1.0, True], [0.5, 0.5]),
        lambda b: sf.Suslov3D.from_inertia([[4, 0, 0], [0, 3, 0], [0, False, 2]], [0, 0, 1]),
        lambda b: sf.QuadraticField([[[True]]]),
        lambda b: sf.QuadraticField(np.array([[[True]]])),
        lambda b: sf.QuadraticField.from_function(lambda x: (True,), 1),
        lambda b: sf.QuadraticField([[[1]]])([True]),
    ],
)
def test_booleans_are_no_numbers(body, call):
    with pytest.raises(TypeError, match=r"expected .*(numbers|fractions).*, got .*bool"):
        call(body)
