"""Steps of fields whose elimination fills most of the matrix, such as dense or Galerkin systems.

Lanes solve A(x) x_next = x + (eps/2) l x + eps c (`pivoting`) without row exchanges. A(x) is filled
by columns, to read each coefficient once. If a lane loses digits, `pivoting.solve_lane` is used.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from ..expressions.tolerances import LEAST_PIVOT
from ..numba.arrays import array_at, uncounted
from ..numba.decorators import c_function, function, kernel, lesser, share
from ..numba.gauss import simd_max, simd_min
from ..numba.intrinsics import call_code
from ..numba.status_codes import OK, PASSED_POLE
from .kahan_step import of_one_sign
from .packs import note_undefined
from .pivoting import crosses_0, solve_lane

# Lanes that share one reading of a coefficient; coefficients are most of the memory of a step.
LANES = 8


class Dense(NamedTuple):
    """Fields for `take_dense_steps`: the terms v x_j x_k of each f_i, with x_D = 1, and eps.

    A run is a sequence of terms with the same j and the same k in consecutive equations i.
    """

    runs: Any  # (S, 5): j, k, first i, number of terms, first coefficient
    terms: Any  # (T,), number of the term of each coefficient, in the order of runs
    of_one_sign: Any  # (D,), true for components that keep their sign along the motion
    indices: Any  # (3, T), i, j and k of the terms
    fractions: Any  # (stages,), step sizes of stages as fractions of eps
    values: Any  # (1 or B, T), v of the terms
    eps: Any  # (1 or B,)
    solve_at: int  # address of the kernel `solve_at`, 0 before it is compiled
    needs: Any  # (1,), set to 1 by a lane that needs `solve_at` while its address is 0


class Memory(NamedTuple):
    """Work arrays of `take_dense_steps`; the first axis is over parts of the work: threads."""

    a: Any  # (parts, lanes, D, D + 1), matrices A(x) with right sides
    columns: Any  # (parts, lanes, D + 1, D), columns of N, see `fill`
    bases: Any  # (parts, lanes, D), the states before a step
    halves: Any  # (parts, stages, 1 or lanes, T), half the eps of a stage times v of the terms
    coefficients: Any  # (parts, stages, 1 or lanes, T), `halves` in the order of `Dense.runs`
    of_one: Any  # (parts, D (D + 3)), memory of `solve_at` for one lane


@functools.lru_cache(8)
def _runs_of(step):
    """Return the first four items of a `Dense`."""
    i, j, k = step.indices
    terms = np.lexsort((i, k, j))
    i, j, k = i[terms], j[terms], k[terms]
    follows = np.zeros(len(i), bool)
    follows[1:] = (j[1:] == j[:-1]) & (k[1:] == k[:-1]) & (i[1:] == i[:-1] + 1)
    [at] = np.nonzero(~follows)
    runs = np.stack([j[at], k[at], i[at], np.diff(np.append(at, len(i))), at], axis=1)
    return runs, terms, np.isin(np.arange(step.D), [*of_one_sign(step.indices)]), step.indices


def take_dense(threads, arguments, x0, span, output):
    """Take the steps of a `Span` on `threads` threads, with the arguments of `maps.kernel`.

    If a lane loses digits, compile `solve_at`, and repeat the steps.
    """
    scheme, *parameters = arguments
    trajectories = slice(span.begin, span.end)
    if span.start == 0:
        saved, final, [poles], status, failed_at = output.of(trajectories)
        final[:] = x0[trajectories]
        note_undefined(final, (status, failed_at, poles))
        final[status < 0] = np.nan
        if span.every:
            saved[span.row] = final
            span = span._replace(row=span.row + 1)
    D, T, fractions = scheme.step.D, scheme.step.T, np.array(scheme.stages.fractions)
    W = max(min(LANES, span.end - span.begin), 1)  # at least 1 for an empty batch, too
    of_terms = len(fractions), W if max(map(len, parameters)) > 1 else 1, T
    shapes = (W, D, D + 1), (W, D + 1, D), (W, D), of_terms, of_terms, (D * (D + 3),)
    memory = Memory(*(np.empty((threads, *shape)) for shape in shapes))
    address = solve_at.address() if solve_at.is_compiled else 0
    needs = np.zeros(1, np.int64)
    field = Dense(*_runs_of(scheme.step), fractions, *parameters, address, needs)
    changed = output.final, output.carry, output.status, output.failed_at
    before = [] if address else [array.copy() for array in changed]
    call = take_dense_steps.serial
    if threads > 1:
        call = functools.partial(take_dense_steps.parallel, threads)
    call(field, memory, span, output)
    if needs[0] and not address:
        for array, copy in zip(changed, before, strict=True):
            array[:] = copy
        call(field._replace(solve_at=solve_at.address()), memory, span, output)


@function
def fill(runs, coefficients, states, columns, a):
    """Fill `a` with the systems of W lanes: A(x) = 1 - N, then the right side, x + column D of N.

    A term h v x_j x_k of f_i adds h v x_k to N_ij and h v x_j to N_ik. `coefficients` are the h v
    in the order of `runs`; `columns` is memory for N.
    """
    W, D = states.shape
    for l in range(W):
        for j in range(D + 1):
            for i in range(D):
                columns[l, j, i] = states[l, i] if j == D else 0.0
    for r in range(len(runs)):
        j, k, begin, n, at = runs[r, 0], runs[r, 1], runs[r, 2], runs[r, 3], runs[r, 4]
        for l in range(W):
            values = coefficients[l % len(coefficients), at : at + n]
            N_j = columns[l, j, begin : begin + n]
            N_k = columns[l, k, begin : begin + n]
            x_j = states[l, j] if j < D else 1.0
            x_k = states[l, k] if k < D else 1.0
            for c in range(n):
                N_j[c] += values[c] * x_k
                N_k[c] += values[c] * x_j
    for l in range(W):
        for i in range(D):
            for j in range(D):
                a[l, i, j] = -columns[l, j, i]
            a[l, i, i] += 1.0
            a[l, i, D] = columns[l, D, i]


@function
def solve_rows(a):
    """Solve a system (D, D + 1) in place, without row exchanges, in the order of its rows.

    The solution replaces the right side. Return True if it keeps its digits, because no pivot is
    relatively small, and True if det A < 0.
    """
    D = len(a)  # row by row, so that a row stays in the L1 cache; loops over unsigned j are SIMD
    least, largest, negative = np.inf, 1.0, False
    for i in range(D):
        largest = simd_max(abs(a[i, i]), largest)
    for i in range(D):
        for k in range(0, i - 1, 2):
            first = a[i, k] * a[k, k]
            second = (a[i, k + 1] - first * a[k, k + 1]) * a[k + 1, k + 1]
            for j in range(np.uint64(k + 2), np.uint64(D + 1)):
                a[i, j] = a[i, j] - first * a[k, j] - second * a[k + 1, j]
            a[i, k], a[i, k + 1] = first, second
        if i % 2:
            first = a[i, i - 1] * a[i - 1, i - 1]
            for j in range(np.uint64(i), np.uint64(D + 1)):
                a[i, j] -= first * a[i - 1, j]
            a[i, i - 1] = first
        pivot = a[i, i]
        least = simd_min(abs(pivot), least)
        largest = simd_max(abs(pivot), largest)
        negative ^= pivot < 0.0
        a[i, i] = 1.0 / pivot
    for i in range(D - 1, -1, -1):
        for j in range(D - 1, i, -1):
            a[i, D] -= a[i, j] * a[j, D]
        a[i, D] *= a[i, i]
    return least > LEAST_PIVOT * largest, negative


@c_function
def solve_at(indices, half, x, memory, D, T):
    """Take the step of a state, by addresses of arrays; return -status, plus 256 if det A < 0."""
    status, negative = solve_lane(
        array_at(indices, (3, T), np.int64),
        array_at(half, (T,), np.float64),
        array_at(x, (D,), np.float64),
        array_at(memory, (D, D + 1), np.float64),
        array_at(memory + 8 * D * (D + 1), (2, D), np.float64),
    )
    return np.int64(256 if negative else 0) - status


@function
def prepare(field, i, l, halves, coefficients):
    """Write the h v of trajectory i to lane l of two arrays of a `Memory`, with h = eps / 2."""
    values = field.values[i % len(field.values)]
    half = 0.5 * field.eps[i % len(field.eps)]
    for s in range(len(field.fractions)):
        for t in range(len(values)):
            halves[s, l, t] = field.fractions[s] * (half * values[t])
            coefficients[s, l, t] = field.fractions[s] * (half * values[field.terms[t]])


@kernel
def take_dense_steps(part, parts, field, memory, span, output):
    """Take part `part` of `parts` of the steps of a `Span`, for `Dense` fields."""
    field, memory, output = uncounted((field, memory, output))
    saved, final, carry, status, failed_at = output
    begin, end, start, stop, every, row = span
    a, columns, bases = memory.a[part], memory.columns[part], memory.bases[part]
    halves, coefficients = memory.halves[part], memory.coefficients[part]
    W, D, T = len(a), final.shape[1], len(field.terms)
    first, last = share((end - begin + W - 1) // W, part, parts)
    for lo in range(begin + first * W, lesser(begin + last * W, end), W):
        x = final[lo : lesser(lo + W, end)]
        place = row
        for l in range(lesser(len(x), halves.shape[1])):
            prepare(field, lo + l, l, halves, coefficients)
        for n in range(start + 1, stop + 1):
            for l in range(len(x)):
                for k in range(D):
                    bases[l, k] = x[l, k]
            for s in range(len(field.fractions)):
                fill(field.runs, coefficients[s], x, columns, a)
                for l in range(len(x)):
                    i, undefined, bits = lo + l, 0.0, np.int64(0)
                    if status[i] < 0:
                        continue
                    is_accurate, negative = solve_rows(a[l])
                    for k in range(D):
                        undefined += 0.0 * a[l, k, D]
                    is_accurate = is_accurate and undefined == 0.0
                    for k in range(D if is_accurate else 0):
                        x[l, k] = a[l, k, D]
                    if not is_accurate and field.solve_at == 0:
                        field.needs[0] = 1
                        return
                    if not is_accurate:
                        half = halves[s, l % halves.shape[1]].ctypes.data
                        places = field.indices.ctypes.data, half, x.ctypes.data + 8 * l * D
                        memory_of_one = memory.of_one[part].ctypes.data
                        bits = call_code(field.solve_at, (*places, memory_of_one, D, T))
                        negative = bits >= 256
                    if bits & 255 != OK:
                        status[i] = -(bits & 255)
                        failed_at[i] = n
                    elif negative and carry[0, i] == 0.0:
                        carry[0, i], status[i], failed_at[i] = n, PASSED_POLE, n
            for l in range(len(x)):
                i = lo + l
                for k in range(D if status[i] >= 0 and carry[0, i] == 0.0 else 0):
                    if field.of_one_sign[k] and crosses_0(bases[l, k], x[l, k]):
                        carry[0, i], status[i], failed_at[i] = -n, PASSED_POLE, n
                for k in range(D if every and n % every == 0 else 0):
                    saved[place, i, k] = x[l, k]
            place += every > 0 and n % every == 0
