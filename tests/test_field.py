"""Quadratic fields and their Kahan maps, against the Runge-Kutta form in 60 digits."""

import json
import math
import pickle
import subprocess
import sys
from fractions import Fraction as F

import numpy as np
import pytest

from suslov_fast import QuadraticField, Suslov3D, SuslovGyrostat, SuslovND, vector_field

of_function, of_hamiltonian = QuadraticField.from_function, QuadraticField.from_hamiltonian


def lorenz(x):
    return 10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]


def henon_heiles(x):
    q1, q2, p1, p2 = x
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + q1**2 * q2 - q2**3 / 3


LORENZ, HENON = of_function(lorenz, 3), of_hamiltonian(henon_heiles, 4)
RIGID = of_hamiltonian(  # K of rank 2
    lambda x: x[0] ** 3 - x[0] * x[1] * x[2] + F(1, 3) * x[2] ** 2 - 5 * x[1] + 2,
    3,
    [[0, 1, -2], [-1, 0, F(1, 7)], [2, F(-1, 7), 0]],
)
BATCH = QuadraticField(np.arange(54.0).reshape(2, 3, 3, 3), LORENZ.linear)


def test_coefficients_of_a_function_are_exact():
    assert LORENZ.linear[2, 2] == -F(8 / 3) != -F(8, 3)
    assert (LORENZ.quadratic[1, 0, 2], LORENZ.quadratic[1, 2, 0]) == (F(-1, 2), F(-1, 2))
    x = (F(1, 3), 2, F(-5, 7))
    assert LORENZ(x) == (*lorenz(x)[:2], x[0] * x[1] - F(8 / 3) * x[2])
    A = np.array([[0.1, 1], [-1, 0]])
    assert of_function(lambda x: A @ x, 2).linear.tolist() == [[F(0.1), 1], [-1, 0]]
    shifted = of_function(lambda x: [np.float32(0.1) - x[0] ** 2 / 3, +x[1] * np.int64(2)], 2)
    assert shifted([3, 4]) == (F(float(np.float32(0.1))) - 3, 8)
    assert QuadraticField([[[0.1]]], [[F(np.int64(2**62), 3)]])([2**40]) == (
        F(0.1) * 2**80 + F(2**102, 3),
    )
    # A list of integers and floats keeps the integers, and the antisymmetric part is dropped.
    plain = QuadraticField([[[0, 2**70 + 1], [0.5, 0]], [[0, 1], [-1, 0]]])
    assert plain([1, 1]) == (2**70 + F(3, 2), 0)
    assert not plain.quadratic[1].any()


def test_values_are_fractions_or_floats():
    state = [1.5, -2.0, 20.0]
    assert LORENZ(state) == pytest.approx(lorenz(state), rel=1e-15)
    assert type(LORENZ([1, 2, 3])[0]) is F
    assert BATCH(np.ones((4, 1, 3))).shape == (4, 2, 3)
    np.testing.assert_allclose(
        BATCH(state)[1], QuadraticField(BATCH.quadratic[1], LORENZ.linear)(state), rtol=1e-14
    )


@pytest.mark.parametrize("field", [HENON, RIGID])
def test_gradient_of_a_hamiltonian(field):
    x, h = [F(k, 7) for k in (3, -8, 5, 2)[: field.dimension]], F(1, 10**9)

    def difference(j):
        ahead, behind = ([a + s * h * (i == j) for i, a in enumerate(x)] for s in (1, -1))
        return (field.H(ahead) - field.H(behind)) / (2 * h)

    gradient = [difference(j) for j in range(field.dimension)]
    for slope, row in zip(field(x), field.K, strict=True):
        assert abs(slope - sum(row * gradient)) < F(1, 10**15)


def test_fields_of_bodies():
    rng = np.random.default_rng(1)
    for body in (
        Suslov3D(4.1, 1, -0.5, [0.3, -0.25]),
        SuslovGyrostat(2, 3, 0.5, -0.25, [[0.75], [-2.0]]),
        SuslovND(rng.uniform(1, 2, (3, 4)), rng.normal(size=4)),
    ):
        field = QuadraticField.of(body)
        x = rng.normal(size=(*body.shape, body.dimension))
        np.testing.assert_allclose(field(x), vector_field(body, x), atol=1e-14)
        assert (field.shape, field.dimension) == (body.shape, body.dimension)
        assert QuadraticField.of(field) is field
    single = QuadraticField.of(SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9))
    assert single.linear.tolist() == [[0, -F(0.9) / F(2.3)], [F(0.9) / F(1.4), 0]]


@pytest.mark.parametrize("field", [LORENZ, HENON, RIGID, BATCH], ids=str)
def test_copies_are_equal(field):
    written = json.loads(json.dumps(field.to_dict()))
    copies = QuadraticField.from_dict(written), pickle.loads(pickle.dumps(field))
    for copy in copies:
        assert copy == field
        assert hash(copy) == hash(field)
        assert copy.H == field.H
        assert copy.to_dict() == written
    assert field != QuadraticField(field.quadratic)
    assert (field == QuadraticField(field.quadratic, field.linear, field.constant)) == (
        field.H is None
    )


def test_what_is_printed():
    assert repr(LORENZ) == (
        "QuadraticField(x1' = -10*x1 + 10*x2, x2' = -x1*x3 + 28*x1 - x2, "
        "x3' = x1*x2 - 2.6666666666666665*x3)"
    )
    assert repr(HENON).endswith(
        "H = x1^2*x2 - 1/3*x2^3 + 1/2*x1^2 + 1/2*x2^2 + 1/2*x3^2 + 1/2*x4^2)"
    )
    assert repr(QuadraticField([[[0]]], constant=[0])) == "QuadraticField(x1' = 0)"
    assert HENON._repr_latex_().startswith(r"$\dot x_{1} = x_{3},\quad")
    assert r"\frac{1}{3}" in of_function(lambda x: (-(x[0] ** 2) / 3,), 1)._repr_latex_()
    for large in (QuadraticField(np.ones((9, 9, 9))), QuadraticField(np.ones((99, 9, 9, 9)))):
        assert len(repr(large)) < 320


def test_python_flint_is_not_needed():
    code = (
        "import sys; sys.modules['flint'] = None; from suslov_fast import QuadraticField as Q;"
        "print(Q.from_function(lambda x: (x[0] * (1 - x[0]),), 1)([2]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "(Fraction(-2, 1),)\n"


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: QuadraticField([[1, 2], [3, 4]]), ValueError, r"quadratic: .*D, D, D\).*2, 2"),
        (lambda: QuadraticField([]), ValueError, r"quadratic: .*D, D, D\), got \(0,\)"),
        (lambda: QuadraticField([[[1j]]]), TypeError, "quadratic: .*floats, got complex"),
        (lambda: QuadraticField([[[None]]]), TypeError, "quadratic: .*floats, got NoneType"),
        (lambda: QuadraticField([[[math.nan]]]), ValueError, "quadratic: .*finite.*got nan"),
        (lambda: QuadraticField(np.full((2, 1, 1, 1), np.nan)), ValueError, "quadratic: .*nan"),
        (lambda: QuadraticField([[[1]]], [1, 2]), ValueError, r"linear: .*1, 1\), got \(2,\)"),
        (lambda: QuadraticField([[[1]]], constant=1), ValueError, r"constant: .*1\), got \(\)"),
        (lambda: of_function(lambda x: (x[0] ** 3,), 1), ValueError, "f: .*at most 2.*degree 3"),
        (lambda: of_function(lambda x: (1 / x[0],), 1), TypeError, "f: .*divisions by numbers"),
        (lambda: of_function(lambda x: np.sin(x), 2), TypeError, "f: .*degree at most 2.*sin"),
        (lambda: of_function(lambda x: (x[0] ** 0.5,), 1), ValueError, "power: .*got 0.5"),
        (lambda: of_function(lambda x: (x[0],), 2), ValueError, "f: expected 2 components, got 1"),
        (lambda: of_function(lambda x: ("1",), 1), TypeError, "the value of f: .*got str"),
        (lambda: of_hamiltonian(lambda x: x[0] ** 4, 2), ValueError, "H: .*at most 3.*degree 4"),
        (lambda: of_hamiltonian(lambda x: x[0], 3), ValueError, "dimension: .*even.*got 3"),
        (lambda: of_hamiltonian(lambda x: x[0], 2, np.eye(2)), ValueError, "K: .*antisymmetric"),
        (lambda: of_hamiltonian(lambda x: x[0], 2, [[0]]), ValueError, r"K: .*\(2, 2\).*\(1, 1\)"),
        (lambda: QuadraticField.of(3), TypeError, "body: expected Suslov3D.*got int"),
        (lambda: LORENZ([1, 2]), ValueError, r"x: expected shape \(3,\), got \(2,\)"),
        (
            lambda: QuadraticField.from_dict(LORENZ.to_dict() | {"linear": [["a"]]}),
            ValueError,
            'linear: .*"p/q", got \'a\'',
        ),
        (
            lambda: QuadraticField.from_dict(HENON.to_dict() | {"H": [[1.0, 0]]}),
            ValueError,
            "H, K: expected those of the coefficients",
        ),
    ],
)  # fmt: skip
def test_bad_input(call, error, message):
    with pytest.raises(error, match=message):
        call()
