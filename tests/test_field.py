"""Quadratic fields and their Kahan maps, against the Runge-Kutta form in 60 digits."""

import json
import math
import pickle
import subprocess
import sys
from fractions import Fraction as F

import mpmath
import numpy as np
import pytest

from suslov_fast import (
    QuadraticField,
    SingularStepWarning,
    Status,
    Suslov3D,
    SuslovGyrostat,
    SuslovND,
    Trajectories,
    energy,
    exact,
    first_integral,
    invariant_density,
    iterate,
    jacobian,
    lyapunov_exponents,
    matrix,
    modified_energy,
    open_ensemble,
    step,
    vector_field,
)
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


def volterra(n):
    return of_function(lambda x: [x[i] * (x[(i + 1) % n] - x[i - 1]) for i in range(n)], n)


def random_field(rng, D, shape=()):
    size = 0.3 / D
    coefficients = (size * rng.normal(size=(*shape, *(D,) * k)) for k in (3, 2, 1))
    return QuadraticField(*coefficients)


def runge_kutta_step(f, x, eps):
    """Solve (y - x) / eps = -f(x) / 2 + 2 f((x + y) / 2) - f(y) / 2, which is linear in y."""

    def residual(y):
        return y - x - eps * (2 * f((x + y) / 2) - (f(x) + f(y)) / 2)

    start = residual(0 * x)
    columns = [residual(unit) - start for unit in np.eye(len(x), dtype=object)]
    matrix = mpmath.matrix(np.transpose(columns).tolist())
    return np.array([*mpmath.lu_solve(matrix, mpmath.matrix([*-start]))], object)


def precise(x):
    return np.array([*map(mpmath.mpf, x)], object)


def exactly(field):
    """The field as a function of arrays of numbers of any type."""

    def value(polynomial, x):
        terms = polynomial.terms.items()
        return sum(
            math.prod([mpmath.mpf(c.numerator) / c.denominator, *(x[i] for i in powers)])
            for powers, c in terms
        )

    return lambda x: np.array([value(each, x) for each in field.polynomials], object)


@pytest.mark.parametrize(
    ("field", "x", "eps", "steps"),
    [
        (LORENZ, [1.0, 2.0, 20.0], 1 / 64, 40),
        (HENON, [0.125, 0.25, 0.25, -0.125], -0.25, 200),
        (volterra(7), [1.0, 0.5, 0.75, 1.25, 0.5, 1.0, 2.0], 0.125, 60),
        (QuadraticField.of(SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9)), [1.1, -0.4], 0.35, 60),
        (QuadraticField(np.zeros((1, 1, 1)), [[-0.5]], [0.25]), [3.0], 0.5, 30),
    ],
)  # fmt: skip
def test_orbits_against_the_runge_kutta_form(field, x, eps, steps):
    with mpmath.workdps(60):
        expected, f = [precise(x)], exactly(field)
        for _ in range(steps):
            expected.append(runge_kutta_step(f, expected[-1], eps))
        found = iterate(field, x, eps, steps).x
        for row, y in zip(found, expected, strict=True):
            assert max(abs(row - y)) <= 1e-13 * max(abs(y))


def test_published_orbits():
    """Values of runs in 60 digits."""
    prey = of_function(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)
    np.testing.assert_allclose(
        iterate(prey, [0.5, 0.7], 1 / 8, 200).final,
        [0.4904468907172823201, 1.337749716137072884],
        rtol=1e-13,
    )
    np.testing.assert_allclose(
        iterate(HENON, [1 / 8, 1 / 4, 1 / 4, -1 / 8], 1 / 4, 500).final,
        [0.251219885039800047, 0.12357749590236766, -0.02024485246071989, -0.2466615457776315],
        rtol=1e-13,
    )


def test_poles_overflow_and_rest():
    square = QuadraticField([[[1]]])  # x / (1 - eps x)
    x = [[8.0], [7.0], [np.nan], [1e200], [0.0], [-0.0], [4.0]]
    with pytest.warns(
        SingularStepWarning, match="2 of 7 traj.*: singular step, first: 0 at step 1"
    ):
        run = iterate(square, x, 1 / 8, 3)
    S, N, ok = Status.SINGULAR, Status.NONFINITE, Status.OK
    assert run.status.tolist() == [S, ok, N, N, ok, ok, S]
    assert run.failed_at.tolist() == [1, -1, 0, 1, -1, -1, 2]
    assert np.isnan(run.x[[1, 2, 3], [0, 6, 6]]).tolist() == [[True], [True], [True]]
    np.testing.assert_allclose(run.x[:, 1, 0], [7, 56, -28 / 3, -56 / 13], rtol=1e-14)
    assert np.signbit(run.x[:, 5]).all()
    # A regular matrix with rows of very different size, and a singular one.
    stiff = QuadraticField(np.zeros((2, 2, 2)), np.diag([-1e40, -1.0]))
    assert iterate(stiff, [1.0, 1.0], 0.5, 2).x.tolist() == [[1, 1], [-1, 0.6], [1, 0.36]]
    swap = QuadraticField(np.zeros((2, 2, 2)), [[0, 1e30], [1e-30, 0]])
    assert iterate(swap, [1.0, 1.0], 2.0, 1, on_singular="ignore").status == S
    field = QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25))
    assert (iterate(field, [-0.75, 1.5], 0.3, 5).x == [-0.75, 1.5]).all()  # f = 0
    assert (iterate(LORENZ, [0.0, 0.0, 0.0], 1 / 64, 5).x == 0).all()


@pytest.mark.parametrize("D", [1, 2, 3, 12])
def test_bits_depend_on_the_problem_alone(D):
    rng = np.random.default_rng(D)
    field, x, eps = random_field(rng, D), rng.normal(size=(70, D)), rng.uniform(-0.2, 0.2, 70)
    run = iterate(field, x, eps, 9)
    assert run.ok
    for k in (0, 33, 69):
        np.testing.assert_array_equal(iterate(field, x[k], eps[k], 9).x, run.x[:, k])
    np.testing.assert_array_equal(
        iterate(field, x[::-1], eps[::-1], 9, save_every=3).x, run.x[::3, ::-1]
    )
    np.testing.assert_array_equal(iterate(field, x, eps, 4).extend(5).x, run.x)
    coefficients = [
        np.asarray(each, float) for each in (field.quadratic, field.linear, field.constant)
    ]
    batch = QuadraticField(np.tile(coefficients[0], (70, 1, 1, 1)), *coefficients[1:])
    np.testing.assert_array_equal(iterate(batch, x, eps, 9).x, run.x)
    # Other units of length, 2**k, and of time, 2**m.
    for k, m in ((3, 5), (600, -300), (-650, 300), (0, 900), (-400, -500)):
        scaled = (
            np.ldexp(each, power)
            for each, power in zip(coefficients, (-k - m, -m, k - m), strict=True)
        )
        other = iterate(QuadraticField(*scaled), np.ldexp(x, k), np.ldexp(eps, m), 9)
        np.testing.assert_array_equal(other.x, np.ldexp(run.x, k))


def test_threads_and_batches_of_fields():
    rng = np.random.default_rng(0)
    fields, x = random_field(rng, 5, (40, 1)), rng.normal(size=(40, 50, 5))
    run = iterate(fields, x, 0.1, 300, save_every=None)
    np.testing.assert_array_equal(iterate(fields, x, 0.1, 300, save_every=None, threads=1).x, run.x)
    one = QuadraticField(fields.quadratic[7, 0], fields.linear[7, 0], fields.constant[7, 0])
    np.testing.assert_array_equal(iterate(one, x[7], 0.1, 300).final, run.final[7])
    np.testing.assert_array_equal(run.status < 0, np.isnan(run.final).any(axis=-1))


def test_bodies_as_fields():
    for body, eps in (
        (Suslov3D(4.1, 1, -0.5, [0.3, -0.25]), 0.2),
        (SuslovGyrostat(2, 3, 0.5, -0.25, [0.75, -2.0]), -0.3),
        (SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5]), 0.4),
    ):
        x = np.full((2, body.dimension), 0.4)
        np.testing.assert_allclose(
            iterate(QuadraticField.of(body), x, eps, 20).x, iterate(body, x, eps, 20).omega, 1e-12
        )


@pytest.mark.parametrize(
    "field", [of_function(lambda x: (x[0] / 3, x[0] - x[1]), 2), HENON, BATCH], ids=str
)
def test_files_and_datasets_hold_the_field_exactly(field, tmp_path):
    x = np.full((3, 2, field.dimension), 0.1)
    run, whole = iterate(field, x, 0.01, 5), iterate(field, x, 0.01, 8)
    run.save(tmp_path / "run.npz")
    loaded = Trajectories.load(tmp_path / "run.npz")
    assert loaded == run
    assert (loaded.body, loaded.body.H) == (field, field.H)
    assert loaded.extend(3) == whole
    pytest.importorskip("xarray")
    data = run.to_xarray()
    assert data.attrs["title"] == "Kahan map of a quadratic field"
    assert data.component.values.tolist() == [f"x{i + 1}" for i in range(field.dimension)]
    assert Trajectories.from_xarray(data).body == field
    assert iterate(field, data.x[-1], 0.01, 3).x.shape == (4, *x.shape)


def test_what_a_run_of_a_field_refuses():
    with pytest.raises(TypeError, match=r"attitude: .*QuadraticField have no orientation"):
        iterate(LORENZ, [1.0, 2.0, 3.0], 0.1, 3, attitude=True)
    with pytest.raises(ValueError, match=r"omega: expected shape \(..., 3\), got \(2,\)"):
        step(LORENZ, [1.0, 2.0], 0.1)
    with pytest.raises(AttributeError, match="x"):
        _ = iterate(LORENZ, [1.0, 2.0, 3.0], 0.1, 3).omega
    huge = QuadraticField([[[F(10) ** 400]]])
    with pytest.raises(ValueError, match="body: expected coefficients in the range of float64"):
        step(huge, [1.0], 0.1)


@pytest.mark.parametrize(("field", "x", "eps"), [
    (LORENZ, [1.0, 2.0, 20.0], 0.1), (HENON, [0.3, -0.5, 0.2, 0.7], -0.4),
    (QuadraticField([[[1]]], [[0.5]], [-0.25]), [1.5], 0.2),
])  # fmt: skip
def test_derivative_and_equations(field, x, eps):
    h = mpmath.mpf(10) ** -25
    with mpmath.workdps(60):
        f, x = exactly(field), precise(x)
        state = x.astype(float)
        for j, unit in enumerate(np.eye(len(x), dtype=object)):
            ahead, behind = (runge_kutta_step(f, x + s * h * unit, eps) for s in (1, -1))
            column = ((ahead - behind) / (2 * h)).astype(float)
            found = jacobian(field, state, eps)[:, j]
            np.testing.assert_allclose(found, column, 0, 1e-13 * abs(column).max())
            expected = unit - eps * (f(x + unit) - f(x - unit)) / 4
            found = matrix(field, state, eps)[:, j]
            np.testing.assert_allclose(found, expected.astype(float), 0, 1e-14)
        np.testing.assert_allclose(vector_field(field, state), f(x).astype(float), 1e-14, 1e-15)


def test_hamiltonian_fields_conserve_modified_energy_and_measure():
    orbit = iterate(HENON, [1 / 8, 1 / 4, 1 / 4, -1 / 8], 1 / 4, 500)
    np.testing.assert_allclose(orbit.modified_energy(), 0.07516523812165594102, rtol=1e-14)
    np.testing.assert_allclose(
        orbit.energy()[[0, -1]], [0.0768229166666667, 0.0769873869], rtol=1e-7
    )
    for field, eps in ((HENON, 0.25), (RIGID, -0.02)):
        x = np.random.default_rng(0).uniform(-0.5, 0.5, (6, field.dimension))
        after = step(field, x, eps)
        np.testing.assert_allclose(
            modified_energy(field, after, eps), modified_energy(field, x, eps), rtol=1e-13
        )
        np.testing.assert_allclose(
            energy(field, x), [float(field.H(list(map(F, y)))) for y in x], 1e-14
        )
        determinant = np.linalg.det(jacobian(field, x, eps))
        np.testing.assert_allclose(
            invariant_density(field, after, eps) * determinant,
            invariant_density(field, x, eps),
            1e-12,
        )
    assert np.isnan(modified_energy(HENON, [np.nan] * 4, 0.1))


def test_exponents_of_fields():
    x, steps = [1.0, 2.0, 20.0], 400
    logs = np.log(
        abs(np.linalg.det(jacobian(LORENZ, iterate(LORENZ, x, 1 / 64, steps - 1).x, 1 / 64)))
    )
    found = lyapunov_exponents(LORENZ, x, 1 / 64, steps)
    assert abs(found.sum() - logs.mean()) <= 1e-12 * abs(logs).mean()
    assert found[0] > found[1] > found[2]
    both = QuadraticField(np.stack([LORENZ.quadratic.astype(float)] * 2), LORENZ.linear)
    np.testing.assert_allclose(lyapunov_exponents(both, x, 1 / 64, steps), [found] * 2, rtol=1e-9)


def test_quantities_of_batches():
    x = np.random.default_rng(0).normal(size=(7, 2, 3))
    for function, *more in ((vector_field,), (matrix, 0.1), (jacobian, 0.1)):
        whole = function(BATCH, x, *more)
        for k in range(2):
            one = QuadraticField(BATCH.quadratic[k], BATCH.linear)
            np.testing.assert_allclose(function(one, x[:, k], *more), whole[:, k], 1e-12, 1e-12)
        assert np.isnan(function(LORENZ, [np.nan, 1, 2], *more)).all()
    far = np.array([1e200, -1e199, 1e198])  # in another unit
    np.testing.assert_array_equal(
        vector_field(QuadraticField(LORENZ.quadratic * F(1, 2**660)), far * 1.0),
        2.0**660 * vector_field(QuadraticField(LORENZ.quadratic), far / 2.0**660),
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: energy(LORENZ, [1, 2, 3]), "from_hamiltonian, got a field without a Hamiltonian"),
        (lambda: modified_energy(LORENZ, [1, 2, 3], 0.1), "without a Hamiltonian"),
        (lambda: invariant_density(LORENZ, [1, 2, 3], 0.1), "without a Hamiltonian"),
        (lambda: iterate(LORENZ, [1, 2, 3], 0.1, 1).energy(), "without a Hamiltonian"),
        (lambda: first_integral(HENON, np.ones(4), 0.1), "got QuadraticField; fields have step"),
        (lambda: exact(HENON, np.ones(4), 0.1, 3), "got QuadraticField; fields have step, iterate"),
    ],
)
def test_quantities_that_a_field_lacks(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_stores_and_the_command_hold_the_hamiltonian(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pytest.importorskip("zarr")
    pytest.importorskip("dask")
    (tmp_path / "field.json").write_text(json.dumps(HENON.to_dict()))
    starts = "--omega0 0.125,0.25,0.25,-0.125 --eps 0.25 --steps 20 --save-every 4"
    for line in (f"run --body field.json -o run.zarr {starts}", "info run.zarr"):
        with pytest.raises(SystemExit) as ended:
            cli.main(line.split())
        assert not ended.value.code
    said = capsys.readouterr().out
    assert said.count("H = x1^2*x2") == 2
    assert "drift of E_mod" in said
    run = Trajectories.from_xarray(open_ensemble(tmp_path / "run.zarr"))
    assert run.body == HENON
    np.testing.assert_array_equal(
        run.x[:, 0], iterate(HENON, [0.125, 0.25, 0.25, -0.125], 0.25, 20, save_every=4).x
    )
