"""Quantities of states of a field, as universal functions of states in rows.

They take the terms v x_j x_k of the components i, with x_D = 1, as indices (3, T) and values (T,),
step sizes (B,), used or not, and states (B, D). Terms of a Hamiltonian are v x_i x_j x_k. States
of a block are lanes, as in `steps_field`.
"""

import numpy as np

from . import steps_field as steps
from .elimination import (
    TO_SOLVE,
    determinant_of,
    eliminate,
    keeps_digits,
    memory_of_one,
    substitute,
)
from .numba import function, inlined, lesser, universal
from .tangent import derive

FIELD = "(c,t),(t),(b),(b,d)->"


@function
def read(x, first, y):
    """Fill rows y with states from `first` on; return their number."""
    count = lesser(y.shape[1], len(x) - first)
    for i in range(x.shape[1]):
        for l in range(count):
            y[i, l] = x[first + l, i]
    return count


@universal(FIELD + "(b,d)")
def vector_field(places, values, eps, x, out):
    D, terms = x.shape[1], places.astype(np.int64)
    y = np.ones((D + 1, steps.lanes_of(D, len(x))))  # x_D = 1
    f = np.empty_like(y)
    for first in range(0, len(x), y.shape[1]):
        count = read(x, first, y)
        f[:] = 0.0 * y  # NaN where the state is
        for t in range(len(values)):
            (i, j, k), v = terms[:, t], values[t]
            for l in range(count):
                f[i, l] += v * y[j, l] * y[k, l]
        for i in range(D):
            for l in range(count):
                out[first + l, i] = f[i, l]


@universal(FIELD + "(b)")
def energy(places, values, eps, x, out):
    """H(x)."""
    add_terms(places, values, x, None, out)


@universal("(c,t),(t),(b),(b,d),(b,d)->(b)")
def cubic_form(places, values, eps, x, z, out):
    """The sum of v x_i x_j z_k."""
    add_terms(places, values, x, z, out)


@inlined
def add_terms(places, values, x, z, out):
    """Fill the sum of v x_i x_j z_k, where z is x if it is None."""
    D, terms = x.shape[1], places.astype(np.int64)
    y = np.ones((D + 1, steps.lanes_of(D, len(x))))  # x_D = 1
    after, h = y if z is None else np.ones_like(y), np.empty(y.shape[1])
    for first in range(0, len(x), len(h)):
        count = read(x, first, y)
        if z is not None:
            read(z, first, after)
        h[:] = 0.0
        for i in range(D):
            for l in range(count):
                h[l] += 0.0 * y[i, l]  # NaN where the state is
        for t in range(len(values)):
            (i, j, k), v = terms[:, t], values[t]
            for l in range(count):
                h[l] += v * y[i, l] * y[j, l] * after[k, l]
        for l in range(count):
            out[first + l] = h[l]


@function
def memory_of(places, x):
    """Return the terms, and the arrays x, fixed, half and `a` of a block of `steps_field`."""
    D, T, lanes = x.shape[1], places.shape[1], steps.lanes_of(x.shape[1], len(x))
    fixed, a = np.empty((D, D + 1, lanes)), np.empty((D, D + 1, lanes))
    return places.astype(np.int64), np.zeros((D, lanes)), fixed, np.zeros((T, lanes)), a


@function
def fill_block(block, values, eps, x, first):
    """Fill a block with states from `first` on; return their number."""
    terms, states, fixed, half, a = block
    D, count = x.shape[1], read(x, first, states)
    for i in range(D):
        for j in range(D + 1):
            fixed[i, j] = 1.0 if i == j else 0.0
    for t in range(len(values)):
        (i, j, k), v = terms[:, t], values[t]
        for l in range(count):
            half[t, l] = 0.5 * eps[first + l] * v
        if k == D:
            fixed[i, j] -= half[t]
    steps.fill(terms, half, fixed, states, a, 0, a.shape[2])
    return count


@universal(FIELD + "(b,d,d)")
def matrix(places, values, eps, x, out):
    """1 - (eps / 2) f'."""
    block, D = memory_of(places, x), x.shape[1]
    a = block[-1]
    for first in range(0, len(x), a.shape[2]):
        count = fill_block(block, values, eps, x, first)
        for i in range(D):
            for j in range(D):
                for l in range(count):
                    out[first + l, i, j] = a[i, j, l] + 0.0 * x[first + l, i]


@universal(FIELD + "(b)")
def invariant_density(places, values, eps, x, out):
    """1 / det A, infinite where the determinant is 0 to rounding."""
    block, D = memory_of(places, x), x.shape[1]
    terms, states, fixed, half, a = block
    lanes, one = a.shape[2], memory_of_one(D)
    b = np.empty((TO_SOLVE + 1, lanes))
    for first in range(0, len(x), lanes):
        count = fill_block(block, values, eps, x, first)
        eliminate(a, b, lanes)
        for l in range(count):
            found = 1.0
            for i in range(D):
                found *= a[i, i, l]
            if not keeps_digits(b, l):
                steps.advance_one(terms, states, fixed, half, l, one)
                found = 1.0 / determinant_of(*one)
            for i in range(D):
                found += 0.0 * x[first + l, i]
            out[first + l] = found


@universal(FIELD + "(b,d,d)")
def jacobian(places, values, eps, x, out):
    """A(x)**-1 (2 - A(x_next))."""
    block, D = memory_of(places, x), x.shape[1]
    terms, states, fixed, half, a = block
    lanes, one, system = a.shape[2], memory_of_one(D), np.empty((D, 2 * D, 1))
    b, before, after = np.empty((TO_SOLVE + 1, lanes)), np.empty((D, lanes)), np.empty_like(a)
    unit, right = np.zeros((D, D, lanes)), np.empty((D, D, lanes))
    for i in range(D):
        unit[i, i] = 1.0
    for first in range(0, len(x), lanes):
        count = fill_block(block, values, eps, x, first)
        to_solve = steps.advance(a, states, b, lanes)
        for l in range(count if to_solve > 0 else 0):
            if b[TO_SOLVE, l] > 0.0:
                steps.advance_one(terms, states, fixed, half, l, one)
        steps.fill(terms, half, fixed, states, after, 0, lanes)
        for i in range(D):
            for j in range(D):
                two = 2.0 if i == j else 0.0
                for l in range(lanes):
                    right[i, j, l] = two - after[i, j, l]
        substitute(a, right)
        for l in range(count):
            if b[TO_SOLVE, l] > 0.0:
                for i in range(D):
                    before[i, l] = x[first + l, i]
                derive(terms, before, fixed, half, after, unit, right, l, system, one[1])
            for i in range(D):
                for j in range(D):
                    out[first + l, i, j] = right[i, j, l] + 0.0 * states[i, l]
