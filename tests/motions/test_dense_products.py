"""Products with dense matrices in f: the bits of written sums, one state or many, in all ways."""

import pickle

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import Field
from suslov_fast.compiled import step_system, system, work
from suslov_fast.core.expressions import dense_product

NAMES = [f"x{i}" for i in range(26)]
RNG = np.random.default_rng(5)
W = RNG.normal(size=(26, 26)) * 1.5 / np.sqrt(26)
X0 = RNG.normal(size=(9, 26))
FORMS = {
    "a product": lambda x, a: -x + W @ np.tanh(x) + a,
    "from the right": lambda x, a: -a * x + np.tanh(x) @ W,
    "np.dot": lambda x, a: -a * x + np.dot(W, np.sin(x)),
    "one of another": lambda x, a: W @ np.tanh(W @ x) - a * x,
    "of parameters": lambda x, a: -x + W @ np.tanh(x) + W @ (a * np.linspace(0.0, 1.0, 26)),
}


def both(f, monkeypatch):
    """Return fields with products as operations, and as written sums."""
    short = Field(f, NAMES, a=0.3)
    monkeypatch.setattr(dense_product, "LEAST", 10**9)
    long = Field(f, NAMES, a=0.3)
    counts = [len(own._equations.products[0].operations) for own in (short, long)]
    assert 4 * counts[0] < counts[1]
    return short, long


@pytest.mark.parametrize("name", FORMS)
def test_have_the_bits_of_written_sums(name, monkeypatch):
    short, long = both(FORMS[name], monkeypatch)
    np.testing.assert_array_equal(short(X0), long(X0))
    for x0 in (X0[0], X0):
        states = [sf.flow(own, x0, time=[1.0, 5.0], stiff=False).states for own in (short, long)]
        np.testing.assert_array_equal(*states)
    alone = sf.flow(short, X0[3], time=[1.0, 5.0], stiff=False).states
    np.testing.assert_array_equal(alone, states[0][:, 3])


@pytest.mark.parametrize("name", ["a product", "of parameters"])
def test_implicit_steps_and_derivatives(name, monkeypatch):
    short, long = both(FORMS[name], monkeypatch)
    motions = [sf.flow(own, X0[0], time=2.0, stiff=True) for own in (short, long)]
    np.testing.assert_allclose(motions[0].final, motions[1].final, rtol=1e-7)
    moved = [sf.flow(Field(FORMS[name], NAMES, a=a), X0[0], time=2.0).final for a in (0.31, 0.29)]
    motion = sf.flow(short, X0[0], time=2.0, derivatives=("x0", "a"))
    by_a, by_x0 = motion.derivatives["a"][-1], motion.derivatives["x0"][-1]
    turned = sf.flow(long, X0[0], time=2.0, derivatives="x0").derivatives["x0"][-1]
    np.testing.assert_allclose(by_x0, turned, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(by_a.ravel(), (moved[0] - moved[1]) / 0.02, rtol=3e-3, atol=3e-4)


def test_in_loops_with_a_late_clock_and_pickled():
    """The table of f has a product, which the code of the table computes in its workspace."""

    def f(x, a):
        force = W @ (a * np.linspace(0.0, 1.0, 26))
        return np.concatenate([-x[:-1] + W @ np.tanh(x[:-1]) + force * np.cos(x[-1]), [1.0]])

    field = pickle.loads(pickle.dumps(Field(f, [*NAMES, "t"], a=0.3)))
    x0 = np.append(X0[0], 2.0)
    right = sf.flow(field, x0, time=3.0).final
    np.testing.assert_array_equal(sf.flow(field, [x0, x0], time=3.0).final[1], right)
    motion, out = system(field, time=3.0), np.empty(27)
    assert step_system(motion, x0, out, work(motion)) == sf.Status.OK
    np.testing.assert_array_equal(out, right)
