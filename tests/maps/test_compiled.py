"""Functions for loops of users, called from compiled code and from Python."""

import pickle

import children
import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from systems import LORENZ as FIELD

import suslov_fast as sf
from suslov_fast import compiled
from suslov_fast.compiled import step_system, system, work

# Long steps on purpose, from states with det A < 0.
pytestmark = pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")

BODY, EPS = sf.Suslov3D(4, 3, -0.4, -0.2), 0.2
GYROSTAT = sf.Suslov3D(2.3, 1.4, 0.5, -0.7, 0.9)
ND = sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])


@njit
def after(system, omega, steps):
    out = np.empty(omega.shape)
    for i in range(len(omega)):
        omega1, omega2 = omega[i]
        for _ in range(steps):
            omega1, omega2 = compiled.step(system, omega1, omega2)
        out[i] = omega1, omega2
    return out


@njit
def system_after(system, x, steps):
    """Take some steps of states (batch, D), in place; return the last statuses."""
    status, memory = np.zeros(len(x)), work(system)
    for k in range(len(x)):
        for _ in range(steps):
            status[k] = step_system(system, x[k], x[k], memory)
    return status


OTHERS = [sf.Suslov3D(1, 1, 1, 0), sf.Suslov3D(0.3, 7, 1e-3, 2)]
OTHERS += [sf.Suslov3D(2.3, 1.4, 0.5, -0.7, k) for k in (1e6, 1e-9)]
OTHERS += [sf.Suslov3D(2.3, 1.4, 0, 0, 3)]


@pytest.mark.slow_to_compile
@pytest.mark.parametrize(
    ("body", "size", "eps", "method"),
    [
        (FIELD, 10.0, 1 / 64, "auto"),
        (FIELD, 1.0, 0.5, "auto"),  # with other pivots
        (GYROSTAT.field(), 1.0, 0.35, "auto"),
        (ND, 1.0, 0.4, "auto"),
        (ND, 10.0, -3.0, "auto"),  # by elimination
        (ND, 1.0, 0.4, "gauss"),
        (ND, 10.0, -3.0, "gauss"),
        (sf.SuslovND(J=[1.0], I=[2.0]), 1.0, 0.25, "auto"),
    ],
)
def test_steps_in_any_dimension_are_those_of_the_package(body, size, eps, method, rng):
    """Their accuracy is tested there. Views are taken, and out may be x."""
    constants = system(body, eps, method=method)
    x = rng.normal(size=(body.dimension, 8)) * size
    expected = sf.step(body, x.T, eps, method=method).T
    out, memory = np.zeros_like(x), work(constants)
    given = x.copy()
    given.setflags(write=False)
    for k in range(8):
        status = step_system(constants, given[:, k], out[:, k], memory)
        beyond = np.linalg.det(sf.kahan.matrix(body, given[:, k], eps)) < 0
        assert status == (sf.Status.PASSED_POLE if beyond else sf.Status.OK)
    assert (system_after(constants, x.T, 1) >= 0).all()
    np.testing.assert_array_equal(out, expected)
    np.testing.assert_array_equal(x, expected)


@pytest.mark.parametrize("body", [BODY, GYROSTAT, sf.Suslov3D(1, 2, 0, 0), *OTHERS], ids=repr)
def test_steps_in_three_dimensions_are_those_of_the_package(body, rng):
    """Of two numbers and of arrays, also far from the line; out may be the state."""
    constants, omega = system(body, EPS), rng.normal(size=(65, 2))
    omega[:9] *= 1e6
    expected = sf.step(body, omega, EPS)
    np.testing.assert_array_equal(after(constants, omega, 1), expected)
    assert (system_after(constants, omega, 1) == sf.Status.OK).all()
    np.testing.assert_array_equal(omega, expected)


GLOBAL = """
import sys
import numpy as np, suslov_fast as sf
from numba import njit
from suslov_fast.compiled import step_system, system, work
other = sf.Field.from_terms([[[1.0, 0.5], [0.0, 1.0]]] * 2)
first = [system(other, 0.1)] * int(sys.argv[1])  # the code of the field has another address then
field = sf.Field.from_terms([[[1.0]]], [[-1.0]])
systems = system(field, 0.1), system(field, 0.2)

@njit(cache=True)
def of_global(x):
    return step_system(systems[1], x, x, work(systems[1]))

@njit(cache=True)
def of_another(x):
    return of_global(x)

@njit(cache=True)
def of_argument(x, system):
    return step_system(system, x, x, work(system))

for function, arguments in ((of_another, ()), (of_argument, systems[1:])):
    x = np.array([0.5])
    assert function(x, *arguments) == 0, function
    assert x == sf.step(field, [0.5], 0.2), function
    print(len(function.stats.cache_hits))
"""


@pytest.mark.compiled
@pytest.mark.slow
def test_a_system_that_is_a_global_of_a_cached_function(tmp_path):
    """Its address is of one process: code that contains it is not kept, and Numba warns."""
    path = tmp_path / "loops.py"
    path.write_text(GLOBAL)
    for process in (0, 1):
        done = children.attempt(path, process)
        assert done.returncode == 0, done.stderr[-2000:]
        assert done.stdout.split() == ["0", str(process)]
        assert done.stderr.count("Cannot cache compiled function") == 2


@pytest.mark.slow_to_compile
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of interpreted code
def test_what_does_not_exist_is_nan():
    unit = system(sf.Suslov3D(1, 1, 1, 0), 2.0)  # X = Omega1, Y = -Omega2: poles are Y = 1 + 2 X**2
    for X in np.array([0.0, 0.25, 1 / 3, 3.0, 1e8]):
        assert np.isnan(compiled.step(unit, X, -(1 + 2 * X * X))).all()
    assert np.isnan(compiled.step(unit, np.nan, 1.0)).all()
    rotor = system(sf.Suslov3D(1, 1, 1, 0, 0.5), 1.0)
    assert np.isnan(compiled.step(rotor, 1.0, -3.875)).all()
    assert np.isnan(compiled.step(rotor, 1e9, 2e9)).all()  # too large
    square = system(sf.Field.from_terms([[[1]]]), 0.5)  # x' = x**2
    body = sf.SuslovND(J=[1.0, 1.0, 1.0], I=[0.5, -0.75, 0.5])
    nd, gauss = system(body, 1.0), system(body, 1.0, method="gauss")
    for constants, x, status in (
        (unit, [0.25, -1.125], sf.Status.SINGULAR),
        (unit, [0.25, np.nan], sf.Status.NONFINITE),
        (square, [2.0], sf.Status.SINGULAR),
        (square, [np.nan], sf.Status.NONFINITE),
        (nd, [1.0, -1.0, 1.5], sf.Status.SINGULAR),
        (nd, [1.0, np.nan, 1.5], sf.Status.NONFINITE),
        (gauss, [1.0, -1.0, 1.5], sf.Status.SINGULAR),
        (gauss, [1.0, np.nan, 1.5], sf.Status.NONFINITE),
        (gauss, [np.nan, 1.0, 1.5], sf.Status.NONFINITE),
        (gauss, [np.nan] * 3, sf.Status.NONFINITE),
    ):
        out = np.array(x)
        assert step_system(constants, out, out, work(constants)) == status
        assert np.isnan(out).all()


@njit
def one_step(system, x, out, memory):
    return step_system(system, x, out, memory)


@pytest.mark.compiled
@pytest.mark.parametrize("body", [ND, FIELD], ids=["nd", "field"])
def test_what_does_not_fit_is_refused_when_a_loop_is_compiled(body):
    """Integers would be truncated; a line names the argument."""
    constants, three = system(body, 0.1), np.ones(3)
    memory = work(constants)
    for call in (one_step, step_system):
        for arguments, words in (
            ((np.ones(3, int), three), "^x"),
            ((three, np.ones(3, np.float32)), "^out"),
            ((np.ones((3, 1)), three), "^x"),
        ):
            with pytest.raises(TypeError, match=words):
                call(constants, *arguments, memory)
        with pytest.raises(TypingError):
            call(constants, three, three, 4)
    with pytest.raises(TypingError):
        compiled.step(constants, 1.0, 2.0)


@pytest.mark.parametrize(
    "body", [pytest.param(ND, marks=pytest.mark.slow), FIELD], ids=["nd", "field"]
)
def test_arrays_of_another_length_are_refused(body):
    """Nothing else would notice: compiled code checks no index."""
    constants, three, four = system(body, 0.1), np.ones(3), np.ones(4)
    larger = sf.SuslovND(J=[1, 2, 3, 4], I=[1, 1, 1, 1])
    larger = work(system(larger if body is ND else larger.field(), 0.1))
    memory = work(constants)
    for arguments in ((four, three, memory), (three, four, memory), (three, three, larger)):
        with pytest.raises(ValueError, match="dimension of the system"):
            step_system(constants, *arguments)


def test_systems_are_plain_data():
    for body in (BODY, GYROSTAT):
        made = system(body, EPS)
        numbers = *(getattr(body, name) for name in "I1 I2 I13 I23 k".split()), EPS, 2
        assert pickle.loads(pickle.dumps(made)) == made == numbers
    for made in (system(ND, 0.4), system(FIELD, 0.1)):
        for one, other in zip(made, pickle.loads(pickle.dumps(made)), strict=True):
            np.testing.assert_array_equal(one, other)
