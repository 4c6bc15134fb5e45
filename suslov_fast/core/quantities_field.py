"""Quantities of states of a field, as universal functions of states in rows.

They take the terms v x_j x_k of the equations i, with x_D = 1, as places (3, T) and values (T,), a
step size for each of B states (B,), used or not, and the states (B, D). Terms of a Hamiltonian are
v x_i x_j x_k. A loop over the states, of one term at a time, is within a loop over blocks of them;
matrices are those of `steps_field`, in lanes.
"""

import numpy as np

from .codes import OK
from .elimination import determinant_of, eliminate, keeps_digits, substitute
from .numba import formula, function
from .steps_field import (
    LARGEST,
    LEAST,
    ROWS,
    advance,
    advance_one,
    enter_field,
    fill,
    is_accurate,
    lanes_of,
    memory_of_one,
)
from .tangent import derive
from .universal import universal

FIELD = "(c,t),(t),(b),(b,d)->"
BLOCK = 128


@formula
def factor(x, b, j):
    """x_j of state b, or 1."""
    return x[b, j] if j < x.shape[1] else 1.0


@universal(FIELD + "(b,d)")
def vector_field(places, values, eps, x, out):
    for first in range(0, len(x), BLOCK):
        last = min(first + BLOCK, len(x))
        for b in range(first, last):
            for i in range(x.shape[1]):
                out[b, i] = 0.0 * x[b, i]  # NaN where the state is
        for t in range(len(values)):
            i, j, k = int(places[0, t]), int(places[1, t]), int(places[2, t])
            for b in range(first, last):
                out[b, i] += values[t] * factor(x, b, j) * factor(x, b, k)


@universal(FIELD + "(b,d,d)")
def matrix(places, values, eps, x, out):
    """1 - (eps / 2) f'."""
    D = x.shape[1]
    for first in range(0, len(x), BLOCK):
        last = min(first + BLOCK, len(x))
        for b in range(first, last):
            for i in range(D):
                for j in range(D):
                    out[b, i, j] = (1.0 if i == j else 0.0) + 0.0 * x[b, i]
        for t in range(len(values)):
            i, j, k = int(places[0, t]), int(places[1, t]), int(places[2, t])
            for b in range(first, last):
                half = 0.5 * eps[b] * values[t]
                if j < D:
                    out[b, i, j] -= half * factor(x, b, k)
                if k < D:
                    out[b, i, k] -= half * factor(x, b, j)


@universal(FIELD + "(b)")
def hamiltonian(places, values, eps, x, out):
    for first in range(0, len(x), BLOCK):
        last = min(first + BLOCK, len(x))
        for b in range(first, last):
            out[b] = 0.0
            for i in range(x.shape[1]):
                out[b] += 0.0 * x[b, i]
        for t in range(len(values)):
            i, j, k = int(places[0, t]), int(places[1, t]), int(places[2, t])
            for b in range(first, last):
                out[b] += values[t] * factor(x, b, i) * factor(x, b, j) * factor(x, b, k)


@universal("(c,t),(t),(b),(b,d),(b,d)->(b)")
def polarised_hamiltonian(places, values, eps, x, after, out):
    """H(x, x, after), the symmetric trilinear form in (x, 1) for which H(x) = H(x, x, x)."""
    for b in range(len(x)):
        total = 0.0
        for t in range(len(values)):
            i, j, k = int(places[0, t]), int(places[1, t]), int(places[2, t])
            first, second, third = factor(x, b, i), factor(x, b, j), factor(x, b, k)
            form = first * second * factor(after, b, k) + first * factor(after, b, j) * third
            total += values[t] * (form + factor(after, b, i) * second * third)
        out[b] = total / 3.0


@function
def enter_states(terms, values, eps, x, first, states, fixed, half, a):
    """Fill the lanes of a block with states from `first` on; lanes beyond the last repeat it."""
    for l in range(states.shape[2]):
        b = min(first + l, len(x) - 1)
        enter_field(terms, values, eps[b], fixed, half, l)
        for i in range(x.shape[1]):
            states[0, i, l] = x[b, i]
    fill(terms, half, fixed, states[0], a, states.shape[2])


@universal(FIELD + "(b)")
def density(places, values, eps, x, out):
    """1 / det A, infinite where the determinant is 0 to rounding."""
    D, T, lanes = x.shape[1], len(values), lanes_of(x.shape[1], len(x))
    terms, one = places.astype(np.int64), memory_of_one(D, T)
    states, half, b = np.empty((2, D, lanes)), np.empty((T, lanes)), np.empty((ROWS, lanes))
    fixed, a = np.empty((D, D + 1, lanes)), np.empty((D, D + 1, lanes))
    for first in range(0, len(x), lanes):
        enter_states(terms, values, eps, x, first, states, fixed, half, a)
        eliminate(a, b[LEAST], b[LARGEST], lanes)
        for l in range(min(lanes, len(x) - first)):
            out[first + l] = 1.0
            for i in range(D):
                out[first + l] *= a[i, i, l]
            if not keeps_digits(b[LEAST, l], b[LARGEST, l]):
                advance_one(terms, states, fixed, half, l, one)
                out[first + l] = 1.0 / determinant_of(one[3], one[4])
            for i in range(D):
                out[first + l] += 0.0 * x[first + l, i]


@universal(FIELD + "(b,d,d)")
def jacobian(places, values, eps, x, out):
    """A(x)**-1 (2 - A(x_next))."""
    D, T, lanes = x.shape[1], len(values), lanes_of(x.shape[1], len(x))
    terms, one, system = places.astype(np.int64), memory_of_one(D, T), np.empty((D, 2 * D, 1))
    states, half, b = np.empty((2, D, lanes)), np.empty((T, lanes)), np.empty((ROWS, lanes))
    fixed, a = np.empty((D, D + 1, lanes)), np.empty((D, D + 1, lanes))
    after, one_after, right = np.empty_like(a), np.empty((D, D + 1, 1)), np.empty((D, D, lanes))
    for first in range(0, len(x), lanes):
        enter_states(terms, values, eps, x, first, states, fixed, half, a)
        advance(states, a, b, lanes)
        fill(terms, half, fixed, states[1], after, lanes)
        for i in range(D):
            for j in range(D):
                unit = 2.0 if i == j else 0.0
                for l in range(lanes):
                    right[i, j, l] = unit - after[i, j, l]
        substitute(a, right)
        for l in range(min(lanes, len(x) - first)):
            exists = 1.0
            if not is_accurate(b, l, D):
                for i in range(D):
                    for j in range(D):
                        system[i, D + j, 0] = 1.0 if i == j else 0.0
                code = derive(terms, states, fixed, half, l, one, one_after, system)
                exists = 1.0 if code == OK else np.nan
                right[:, :, l] = system[:, D:, 0]
            for i in range(D):
                for j in range(D):
                    out[first + l, i, j] = right[i, j, l] * exists
