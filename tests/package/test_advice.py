"""The texts of other packages that advice depends on, each raised by the versions at hand."""

import math

import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast.bodies.fields.advice import TEXTS, says

FUNCTIONS = {
    "array of a number": lambda x, a: (a[0] * x[0], x[1]),
    "product of a number": lambda x, a: a @ np.array([x[0], x[1]]),
    "linear algebra of symbols": lambda x, a: np.linalg.solve(np.array([[x[0], 1], [0, 1]]), x),
    "function of math": lambda x, a: (math.sin(x[0]), x[1]),
    "function without symbols": lambda x, a: np.gradient(x),
    "time is None": lambda x, a: (None * x[0], x[1]),
    "number of a symbol": lambda x, a: (float(x[0]), x[1]),
    "unpacking": lambda x, a: unpacked(x),
}


def unpacked(x):
    u, v, _ = x
    return u, v


@pytest.mark.parametrize("what", FUNCTIONS)
def test_texts_of_errors(monkeypatch, what):
    """`explained` sees the text that is expected, and knows it."""
    seen = []

    def explained(error, *arguments):
        seen.append(" ".join(str(error).split()))
        return seen[-1]

    monkeypatch.setattr("suslov_fast.bodies.fields.tracing.explained", explained)
    with pytest.raises((TypeError, ValueError)):
        sf.QuadraticField.from_function(FUNCTIONS[what], 2, a=[1.0, 2.0])
    assert says(seen[0], what), seen


@pytest.mark.compiled
def test_the_text_of_numba():
    """The only error of Numba that is of a class of Python."""
    with pytest.raises(ValueError) as error:  # noqa: PT011  (its text is what is tested)
        numba.njit(lambda x: x)([])
    assert says(str(error.value), "argument of Numba")
    assert {*FUNCTIONS, "argument of Numba"} == TEXTS.keys()
