"""Quadratic fields and their Kahan maps, against the Runge-Kutta form in 60 digits."""

import json
import math
import pickle
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction as F
from functools import partial

import naive
import numpy as np
import pytest
from pandas import Series
from test_quantities import error

import suslov_fast as sf
from suslov_fast import QuadraticField, Status, Suslov3D, SuslovGyrostat, SuslovND
from suslov_fast import _cli as cli

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
    second = QuadraticField(BATCH.quadratic[1], LORENZ.linear)
    np.testing.assert_allclose(BATCH(state)[1], second(state), rtol=1e-14)


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
        np.testing.assert_allclose(field(x), sf.vector_field(body, x), atol=1e-14)
        assert (field.shape, field.dimension) == (body.shape, body.dimension)
        assert QuadraticField.of(field) is field
    single = QuadraticField.of(SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9))
    assert single.linear.tolist() == [[0, -F(0.9) / F(2.3)], [F(0.9) / F(1.4), 0]]


@pytest.mark.parametrize("field", [LORENZ, HENON, RIGID, BATCH], ids=str)
def test_copies_are_equal(field):
    written = json.loads(json.dumps(field.to_dict()))
    copies = QuadraticField.from_dict(written), pickle.loads(pickle.dumps(field))
    copies += replace(field), *(pickle.loads(pickle.dumps(field, k)) for k in (0, 1))
    for copy in copies:
        assert copy == field
        assert hash(copy) == hash(field)
        assert copy.H == field.H
        assert copy.to_dict() == written
    assert field != QuadraticField(field.quadratic)
    plain = QuadraticField(field.quadratic, field.linear, field.constant)
    assert (field == plain) == (field.H is None)
    if field.H is not None:
        with pytest.raises(ValueError, match="H, K: expected those of the coeff"):
            replace(field, constant=np.arange(field.dimension))


def test_equal_fields_have_equal_hamiltonians_and_matrices():
    K = np.zeros((3, 3), int)
    K[1, 0], K[0, 1], K[1, 2], K[2, 1] = 1, -1, 5, -5
    others = K * [[1, 1, 1], [1, 1, 2], [1, 2, 1]], K
    one, two = (of_hamiltonian(lambda x: x[0] ** 2, 3, K) for K in others)
    assert one.polynomials == two.polynomials
    assert one != two
    assert one != of_hamiltonian(lambda x: x[0] ** 2 + 1, 3, others[0])


def test_the_structure_of_a_hamiltonian_field():
    """K is part of a field, also where grad H = (1, 0, 0) does not see all of it."""
    K = np.array([[0, 1, 2], [-1, 0, 3], [-2, -3, 0]])
    field, twin = (of_hamiltonian(lambda x: x[0], 3, k) for k in (K, np.where(abs(K) == 3, -K, K)))
    assert (field.constant == twin.constant).all()
    assert field != twin
    assert sf.step(of_hamiltonian(lambda x: x[0] ** 2, 1, [[0]]), [2.0], 0.1) == 2.0


def test_what_is_printed():
    assert repr(LORENZ) == (
        "QuadraticField(x1' = -10*x1 + 10*x2, x2' = -x1*x3 + 28*x1 - x2, "
        "x3' = x1*x2 - 2.6666666666666665*x3)"
    )
    H = "x1^2*x2 - 1/3*x2^3 + 1/2*x1^2 + 1/2*x2^2 + 1/2*x3^2 + 1/2*x4^2"
    assert repr(HENON).endswith(f"H = {H})")
    assert repr(QuadraticField([[[0]]], constant=[0])) == "QuadraticField(x1' = 0)"
    for large in (QuadraticField(np.ones((9, 9, 9))), QuadraticField(np.ones((99, 9, 9, 9)))):
        assert len(repr(large)) < 320


def test_python_flint_is_not_needed():
    code = (
        "import sys; sys.modules['flint'] = None; from suslov_fast import QuadraticField as Q;"
        "print(Q.from_function(lambda x: (x[0] * (1 - x[0]),), 1)([2]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "(Fraction(-2, 1),)\n"


class Milliseconds(float):
    unit = "ms"


TIMES = [[[Milliseconds(20)]]]
HUGE, ONES = QuadraticField([[[F(10) ** 400]]]), np.ones(4)


def changed(field, **entries):
    return QuadraticField.from_dict(field.to_dict() | entries)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: QuadraticField([[1, 2], [3, 4]]), ValueError, r"quadratic: .*D, D, D\).*2, 2"),
        (lambda: QuadraticField(TIMES), TypeError, "quadratic: .* unit, got Milliseconds in ms"),
        (lambda: QuadraticField(np.array(TIMES, object)), TypeError, "got Milliseconds in ms"),
        (lambda: QuadraticField([]), ValueError, r"quadratic: .*D, D, D\), got \(0,\)"),
        (lambda: QuadraticField([[[1j]]]), TypeError, "quadratic: .*floats, got complex"),
        (lambda: QuadraticField([[[None]]]), TypeError, "quadratic: .*floats, got NoneType"),
        (lambda: QuadraticField(np.ma.masked_less([[[-1]]], 0)), ValueError, "quadr.*masked array"),
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
        (lambda: LORENZ([[1, 2, 3], [4]]), ValueError, "x: expected a rectangular array"),
        (lambda: LORENZ(Series([1, 2, 3], ["x1", "x3", "x2"])), ValueError, "x: .*the components"),
        (lambda: changed(LORENZ, linear=[["a"]]), ValueError, 'linear: .*"p/q", got \'a\''),
        (lambda: changed(HENON, H=[[1.0, 0]]), ValueError, "H, K: expected those of the coeffic"),
        (lambda: sf.step(HUGE, [1.0], 0.1), ValueError, "body: .* in the range of float64"),
        (lambda: HUGE([1.0]), ValueError, "body: .* in the range of float64"),
        (lambda: sf.energy(LORENZ, ONES[:3]), TypeError, "from_hamiltonian, got a field without"),
        (lambda: sf.modified_energy(LORENZ, ONES[:3], 1), TypeError, "without a Hamiltonian"),
        (lambda: sf.invariant_density(LORENZ, ONES[:3], 1), TypeError, "without a Hamiltonian"),
        (lambda: sf.iterate(LORENZ, ONES[:3], 1, 1).energy(), TypeError, "without a Hamiltonian"),
        (lambda: sf.first_integral(HENON, ONES, 1), TypeError, "got .*; fields have step, iterate"),
        (lambda: sf.exact(HENON, ONES, 1, 3), TypeError, "got .*; fields have step, iterate"),
    ],
)  # fmt: skip
def test_bad_input(call, error, message):
    with pytest.raises(error, match=message):
        call()


def henon_rates(x):
    q1, q2, p1, p2 = x
    return p1, p2, -q1 - 2 * q1 * q2, q2**2 - q2 - q1**2


def volterra(x):
    return [x[i] * (x[i + 1 - len(x)] - x[i - 1]) for i in range(len(x))]


def rotor(x):
    return naive.vector_field(2.3, 1.4, 0.5, -0.7, x, 0.9)


def decay(x):
    return (0.25 - 0.5 * x[0],)


PROBLEMS = [
    (LORENZ, lorenz, [1.0, 2.0, 20.0], 1 / 64, 40),
    (HENON, henon_rates, [0.125, 0.25, 0.25, -0.125], -0.25, 200),
    (of_function(volterra, 7), volterra, [1.0, 0.5, 0.75, 1.25, 0.5, 1.0, 2.0], 0.125, 60),
    (QuadraticField.of(SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9)), rotor, [1.1, -0.4], 0.35, 60),
    (of_function(decay, 1), decay, [3.0], 0.5, 30),
]


@pytest.mark.parametrize(("field", "f", "x", "eps", "steps"), PROBLEMS)
def test_against_the_runge_kutta_form(field, f, x, eps, steps):
    step = partial(naive.kahan_step, f, eps)
    exact = naive.iterated(step, x, steps)
    assert naive.worst_error(sf.iterate(field, x, eps, steps).x, exact) < 1e-13
    assert error(sf.vector_field(field, x), f(naive.exactly(*x))) < 1e-14
    assert error(sf.jacobian(field, x, eps), naive.derivative(step, x)) < 1e-13
    slope = np.array(naive.derivative(f, x), float)
    np.testing.assert_allclose(sf.matrix(field, x, eps), np.eye(len(x)) - eps / 2 * slope, 1e-14)


def test_published_orbits():
    """Values of runs in 60 digits."""
    prey = of_function(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)
    expected, run = [0.4904468907172823201, 1.337749716137072884], (prey, [0.5, 0.7], 1 / 8, 200)
    np.testing.assert_allclose(sf.iterate(*run).final, expected, rtol=1e-13)
    orbit = sf.iterate(HENON, [1 / 8, 1 / 4, 1 / 4, -1 / 8], 1 / 4, 500)
    last = [0.251219885039800047, 0.12357749590236766, -0.02024485246071989, -0.2466615457776315]
    np.testing.assert_allclose(orbit.final, last, rtol=1e-13)
    np.testing.assert_allclose(orbit.modified_energy(), 0.07516523812165594102, rtol=1e-14)
    ends = [0.0768229166666667, 0.0769873869]
    np.testing.assert_allclose(orbit.energy()[[0, -1]], ends, rtol=1e-7)


def test_poles_overflow_and_rest():
    square = QuadraticField([[[1]]])  # x / (1 - eps x)
    x = [[8.0], [7.0], [np.nan], [1e200], [0.0], [-0.0], [4.0]]
    message = "2 of 7 traj.*: singular step, first: 0 at step 1"
    with pytest.warns(sf.SingularStepWarning, match=message):
        run = sf.iterate(square, x, 1 / 8, 3)
    S, N, ok = Status.SINGULAR, Status.NONFINITE, Status.OK
    assert run.status.tolist() == [S, ok, N, ok, ok, ok, S]
    assert run.failed_at.tolist() == [1, -1, 0, -1, -1, -1, 2]
    assert np.isnan(run.x[[1, 2, 3], [0, 6, 6]]).tolist() == [[True], [True], [True]]
    np.testing.assert_allclose(run.x[:, 1, 0], [7, 56, -28 / 3, -56 / 13], rtol=1e-14)
    np.testing.assert_allclose(run.x[1:, 3, 0], [-8, -4, -8 / 3], rtol=1e-15)
    falling = QuadraticField([[[0]]], [[0]], [1e300])
    assert sf.iterate(falling, [1.0], 1e10, 1, on_singular="ignore").status == N
    assert np.signbit(run.x[:, 5]).all()
    # A regular matrix with rows of very different size, and a singular one.
    stiff = QuadraticField(np.zeros((2, 2, 2)), np.diag([-1e40, -1.0]))
    assert sf.iterate(stiff, [1.0, 1.0], 0.5, 2).x.tolist() == [[1, 1], [-1, 0.6], [1, 0.36]]
    swap = QuadraticField(np.zeros((2, 2, 2)), [[0, 1e30], [1e-30, 0]])
    assert sf.iterate(swap, [1.0, 1.0], 2.0, 1, on_singular="ignore").status == S
    field = QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25))
    assert (sf.iterate(field, [-0.75, 1.5], 0.3, 5).x == [-0.75, 1.5]).all()  # f = 0
    assert (sf.iterate(LORENZ, [0.0, 0.0, 0.0], 1 / 64, 5).x == 0).all()


def test_many_variables(rng):
    """One field, and as many equal ones as there are states."""
    q, l, c = (0.025 * rng.normal(size=(12,) * axes) for axes in (3, 2, 1))
    x, eps = rng.normal(size=(70, 12)), rng.uniform(-0.2, 0.2, 70)
    run = sf.iterate(QuadraticField(q, l, c), x, eps, 9)
    several = QuadraticField(np.tile(q, (70, 1, 1, 1)), l, c)
    np.testing.assert_array_equal(sf.iterate(several, x, eps, 9).x, run.x)
    alone = sf.iterate(QuadraticField(q, l, c), x[69], eps[69], 9)
    np.testing.assert_array_equal(alone.x, run.x[:, 69])


def test_bodies_as_fields():
    for body, eps in (
        (Suslov3D(4.1, 1, -0.5, [0.3, -0.25]), 0.2),
        (SuslovGyrostat(2, 3, 0.5, -0.25, [0.75, -2.0]), -0.3),
        (SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5]), 0.4),
    ):
        x = np.full((2, body.dimension), 0.4)
        run = sf.iterate(QuadraticField.of(body), x, eps, 20)
        np.testing.assert_allclose(run.x, sf.iterate(body, x, eps, 20).omega, 1e-12)


@pytest.mark.parametrize(("field", "eps"), [(HENON, 0.25), (RIGID, -0.02)])
def test_hamiltonian_fields_conserve_modified_energy_and_measure(rng, field, eps):
    x = rng.uniform(-0.5, 0.5, (6, field.dimension))
    after = sf.step(field, x, eps)
    before = sf.modified_energy(field, x, eps)
    np.testing.assert_allclose(sf.modified_energy(field, after, eps), before, rtol=1e-13)
    exact = [float(field.H(list(map(F, y)))) for y in x]
    np.testing.assert_allclose(sf.energy(field, x), exact, 1e-14)
    density, following = (sf.invariant_density(field, state, eps) for state in (x, after))
    determinant = np.linalg.det(sf.jacobian(field, x, eps))
    np.testing.assert_allclose(following * determinant, density, 1e-12)
    x[1, 0] = np.nan
    for quantity in (sf.modified_energy, sf.invariant_density):
        assert np.isnan(quantity(field, x, eps)).tolist() == [False, True] + [False] * 4


def test_a_store_holds_the_hamiltonian(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "field.json").write_text(json.dumps(HENON.to_dict()))
    with pytest.raises(SystemExit, match="0"):
        cli.main("run --body field.json --eps 0.25 --steps 9 --save-every 3 -o run.zarr".split())
    said = capsys.readouterr().out
    assert "H = x1^2*x2" in said
    assert "drift of E_mod" in said
    data = sf.open_ensemble(tmp_path / "run.zarr")
    assert sf.Trajectories.from_xarray(data).body == HENON
    assert HENON(data.x).shape == data.x.shape
