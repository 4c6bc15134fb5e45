"""Products with dense matrices in f: the bits of written sums, one state or many, in all ways."""

import pickle
import re
import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import suslov_fast as sf
from suslov_fast import Field
from suslov_fast.compiled import step_system, system, work
from suslov_fast.core.expressions import dense_product
from suslov_fast.fields import right_hand_sides
from suslov_fast.motions import integration

N = 18
NAMES = [f"x{i}" for i in range(N)]
RNG = np.random.default_rng(5)
W, V = RNG.normal(size=(2, N, N)) * 1.5 / np.sqrt(N)
HOLLOW = W * ~np.eye(N, dtype=bool)
C = np.linspace(0.0, 1.0, N)
X0 = RNG.normal(size=(9, N))
FORMS = {
    "a product": lambda x, a: -x + W @ np.tanh(x) + a,
    "from the right": lambda x, a: -a * x + np.tanh(x) @ W,
    "np.dot": lambda x, a: -a * x + np.dot(W, np.sin(x)),
    "one of another": lambda x, a: W @ np.tanh(V @ x) - a * x,
    "of parameters": lambda x, a: -x + W @ np.tanh(x) + W @ (a * C),
    "method of the matrix": lambda x, a: W.dot(np.tanh(x)) - x + a,
    "einsum without the diagonal": lambda x, a: np.einsum("ij,j", HOLLOW, np.tanh(x)) - a * x,
    "loops": lambda x, a: [sum(W[i, j] * x[j] for j in range(N)) - x[i] ** 3 for i in range(N)],
    "ReLU": lambda x, a: -x + np.maximum(W.dot(x) + a, 0.0),
    "jumps": lambda x, a: -x + np.where(np.sin(2.0 * (W @ x)) > a, 0.3, 0.0),
    "bumps": lambda x, a: -a * x + np.where(np.exp(-((W @ x) ** 2)) > 0.5, 0.3, 0.0),
}


@pytest.fixture(autouse=True)
def small_matrices_are_large(monkeypatch):
    monkeypatch.setattr(dense_product, "LEAST_ENTRIES", 200)


def both(f, monkeypatch):
    """Return fields with products as operations, and as written sums."""
    short = Field(f, NAMES, a=0.3)
    monkeypatch.setattr(dense_product, "LEAST_ENTRIES", 10**9)
    long = Field(f, NAMES, a=0.3)
    counts = [len(own._equations.products[0].operations) for own in (short, long)]
    assert 3 * counts[0] < counts[1]
    return short, long


SLOW = "jumps", "bumps"
WITH_SURFACES = "ReLU", *SLOW  # the step to a surface has other roundings than with written sums


@pytest.mark.slow_cases(*SLOW)
@pytest.mark.parametrize("name", FORMS)
@pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")  # some states slide
def test_have_the_bits_of_written_sums(name, monkeypatch):
    short, long = both(FORMS[name], monkeypatch)
    np.testing.assert_array_equal(short(X0), long(X0))
    np.testing.assert_allclose(short.jacobian(X0), long.jacobian(X0), rtol=1e-14, atol=1e-14)
    for x0 in (X0[0], X0):
        states = [sf.flow(own, x0, time=[1.0, 3.0], stiff=False).states for own in (short, long)]
        np.testing.assert_allclose(*states, rtol=1e-8 if name in WITH_SURFACES else 0.0)
    alone = sf.flow(short, X0[3], time=[1.0, 3.0], stiff=False).states
    np.testing.assert_array_equal(alone, states[0][:, 3])


def test_sums_that_share_parts_stay_as_they_are():
    """Running sums take one operation each, and would take n as a product with a matrix."""
    field = Field(lambda x: np.cumsum(x) * x - x, 40)
    assert len(field._equations.products[0].operations) == 3 * 40 - 1


def test_a_family_of_matrices_with_a_factor():
    """Factors 1 / 2 and 4 change no digits of the entries."""
    family = Field(lambda x, g: (g * W) @ np.tanh(x) - 6.0 * x, NAMES, g=[0.5, 4.0])
    divided = Field(lambda x, g: (W / g).dot(np.tanh(x)) - 6.0 * x, NAMES, g=[2.0, 0.25])
    assert len(family._equations.products[0].operations) < 6 * N
    for k, g in enumerate([0.5, 4.0]):
        own = Field(lambda x, g=g: (g * W) @ np.tanh(x) - 6.0 * x, NAMES)
        right = sf.flow(own, X0[0], time=2.0, stiff=False).final
        for each in (family, divided):
            found = sf.flow(each, X0[0], time=2.0, stiff=False).final[k]
            np.testing.assert_array_equal(found, right)


def _nested(x):
    return np.tanh(V @ x + V @ (0.3 * C))


DERIVATIVES = {  # f, f' and df/da
    "one of another": (
        lambda x, a: W @ np.tanh(V @ x + V @ (a * C)) - x,
        lambda x: (W * (1.0 - _nested(x) ** 2)) @ V - np.eye(N),
        lambda x: W @ ((1.0 - _nested(x) ** 2) * (V @ C)),
    ),
    "ReLU": (
        lambda x, a: -x + np.maximum(W @ x + a, 0.0),
        lambda x: (W @ x + 0.3 > 0.0)[:, np.newaxis] * W - np.eye(N),
        lambda x: (W @ x + 0.3 > 0.0) * 1.0,
    ),
}


@pytest.mark.parametrize("name", DERIVATIVES)
@pytest.mark.parametrize("stiff", [False, True])
def test_derivatives(name, stiff):
    """Beside the variational equations, solved by SciPy."""
    f, slopes, by_a = DERIVATIVES[name]
    field = Field(f, NAMES, a=0.3)
    np.testing.assert_allclose(field.jacobian(X0[1]), slopes(X0[1]), rtol=1e-13, atol=1e-13)

    def rates(t, y):
        x, columns = y[:N], y[N:].reshape(N, N + 1)
        changes = slopes(x) @ columns
        changes[:, N] += by_a(x)
        return np.concatenate([f(x, 0.3), changes.ravel()])

    start = np.concatenate([X0[0], np.eye(N, N + 1).ravel()])
    right = solve_ivp(rates, (0.0, 1.0), start, method="DOP853", rtol=1e-10, atol=1e-11).y[:, -1]
    motion = sf.flow(field, X0[0], time=1.0, derivatives=("x0", "a"), stiff=stiff)
    found = [motion.derivatives["x0"][-1], motion.derivatives["a"][-1].reshape(N, 1)]
    np.testing.assert_allclose(motion.final, right[:N], rtol=1e-7)
    np.testing.assert_allclose(np.hstack(found), right[N:].reshape(N, N + 1), rtol=1e-5, atol=1e-6)


def test_exponents_of_a_linear_field():
    A = (W + W.T) / 2.0 - 2.0 * np.eye(N)
    exponents = sf.lyapunov_exponents(Field(lambda x: A @ x, NAMES), X0[0], time=60.0)
    right = np.sort(np.linalg.eigvalsh(A))[::-1]
    np.testing.assert_allclose(exponents, right, rtol=0.05, atol=0.05)


def test_in_loops_with_a_late_clock_and_pickled():
    """The table of f has a product, which the code of the table computes in its workspace."""

    def f(x, a):
        force = W @ (a * C)
        return np.concatenate([-x[:-1] + W @ np.tanh(x[:-1]) + force * np.cos(x[-1]), [1.0]])

    field = pickle.loads(pickle.dumps(Field(f, [*NAMES, "t"], a=0.3)))
    x0 = np.append(X0[0], 2.0)
    right = sf.flow(field, x0, time=3.0).final
    np.testing.assert_array_equal(sf.flow(field, [x0, x0], time=3.0).final[1], right)
    motion, out = system(field, time=3.0), np.empty(N + 1)
    assert step_system(motion, x0, out, work(motion)) == sf.Status.OK
    np.testing.assert_array_equal(out, right)


@pytest.mark.parametrize("stiff", [None, True])
def test_dense_implicit_steps_are_told_of_once(stiff, monkeypatch):
    monkeypatch.setattr(integration, "EQUATIONS_OF_LARGE_F", N - 1)
    decays = np.logspace(0.0, 4.0, N) * (1.0 if stiff else 2.0)
    field = Field(lambda x: -decays * x + W @ np.tanh(x), NAMES)
    with pytest.warns(UserWarning, match=f"{N} x {N}"):
        first = sf.flow(field, X0[0], time=5.0, stiff=stiff).final
    with warnings.catch_warnings(action="error"):
        np.testing.assert_array_equal(sf.flow(field, X0[0], time=5.0, stiff=stiff).final, first)


def test_long_functions_are_told_of_before_they_are_compiled(monkeypatch):
    monkeypatch.setattr(integration, "OPERATIONS_OF_LONG_F", 2 * N * N)
    field = Field(lambda x: [sum(np.sin(b - a) for b in x) for a in x], NAMES)
    with pytest.warns(UserWarning, match="operations") as told:
        sf.flow(field, X0[0], time=0.1)
    [count] = [int(re.search(r"(\d+) operations", str(each.message))[1]) for each in told]
    assert 2 * N * N < count < 4 * N * N


def test_long_sparse_functions_are_not_told_to_be_products(monkeypatch):
    monkeypatch.setattr(integration, "OPERATIONS_OF_LONG_F", N // 2)
    ring = Field(lambda x: [x[i - 1] - x[i] for i in range(N)], NAMES)
    sf.flow(ring, X0[0], time=0.1)  # warnings are errors


@pytest.mark.parametrize("stiff", [None, True])
def test_full_quadratic_fields(stiff, monkeypatch):
    monkeypatch.setattr(right_hand_sides, "TERMS_OF_FULL_FIELD", N)  # loops over all coefficients
    linear = W - 2.0 * np.eye(N)
    field = Field.from_terms(RNG.normal(size=(N, N, N)) / N**2, linear, C)
    motion = sf.flow(field, X0, time=1.0, stiff=stiff)
    given = {"rtol": 1e-11, "atol": 1e-12, "method": "DOP853"}
    for x, final in zip(X0, motion.final, strict=True):
        right = solve_ivp(lambda t, y: field(y), (0.0, 1.0), x, **given).y[:, -1]
        np.testing.assert_allclose(final, right, rtol=1e-6, atol=1e-7)
