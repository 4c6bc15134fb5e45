"""The projection of a state onto given values c of invariants I(x): one Newton step, as formulas.

With J = I'(x), and W = diag(w_j**2) with the allowed errors w_j of the components,

x <- x - W J^T (J W J^T)**-1 (I(x) - c).

An invariant that depends on those before it, up to rounding, is left out: its pivot is LEAST of its
diagonal entry or less. A projection that moves a component by more than MOST allowed errors, or
changes a sign that f keeps, is left out, as near states where J loses rank.
"""

import functools

from .programs import Expressions, dot, emitted, program_of
from .symbolic_elimination import elimination_order
from .values import larger

LEAST, MOST = 2.0**-40, 64.0
# States are on the constraints if residuals are at most OFF times the sums of moduli of their
# terms, or ROUNDING times the largest of these sums.
OFF, ROUNDING = 1e-7, 1e-13


def projection_of(f):
    """Return the `Program` that projects x, and reads x, w (D each), c, and f's table."""
    D, k = f.D, f.invariants_count
    first = 2 * D + k
    values = Expressions(first + len(f.table))
    known = {i: i for i in range(D)} | {a: first + place for a, place in f.places.items()}
    found, J = emitted(values, f.invariants, known), [{} for _ in range(k)]
    for (a, j), slope in zip(f.invariants_places, found[k:], strict=True):
        if j not in f.steady:
            J[a][j] = slope
    emit = values.emit
    r = [emit("fsub", found[a], 2 * D + a) for a in range(k)]
    scaled = [{j: emit("fmul", slope, D + j) for j, slope in row.items()} for row in J]
    G = [{} for _ in range(k)]
    for a in range(k):
        for b in range(a, k):
            common = [(scaled[a][j], scaled[b][j]) for j in scaled[a] if j in scaled[b]]
            if common or a == b:
                G[a][b] = G[b][a] = dot(emit, common) if common else 0.0
    mu = _solved(values, G, r)
    results, is_right = [*range(D)], values.number(0.0).equals(0.0)
    for j in range(D):
        pairs = [(scaled[a][j], mu[a]) for a in range(k) if j in scaled[a]]
        if pairs:
            part = values.number(dot(emit, pairs))  # the move in units of allowed errors
            new = values.number(j) - part * values.number(D + j)
            is_right = is_right & (abs(part) <= MOST)
            if j in f.of_one_sign:
                is_right = is_right & (new * values.number(j) >= 0.0)
            results[j] = new
    chosen = [a if a is j else is_right.select(a, values.number(j)) for j, a in enumerate(results)]
    return program_of(values.operations, [getattr(a, "number", a) for a in chosen])


def on_constraints_of(f):
    """Return the `Program` that reads x and f's table: 1 if x is on the constraints, else 0."""
    D, k = f.D, f.constraints_count
    values = Expressions(D + len(f.table))
    known = {i: i for i in range(D)} | {a: D + place for a, place in f.places.items()}
    found, number = emitted(values, f.invariants, known), values.number
    sizes, slopes = [number(0.0)] * k, found[f.invariants_count :]
    for (a, j), slope in zip(f.invariants_places, slopes, strict=True):
        if a < k:
            sizes[a] = sizes[a] + abs(number(slope) * number(j))
    largest = functools.reduce(larger, sizes)
    is_on = number(0.0).equals(0.0)
    for residual, size in zip(found[:k], sizes, strict=True):
        is_on = is_on & (abs(number(residual)) <= larger(OFF * size, ROUNDING * largest))
    return program_of(values.operations, [is_on.select(1.0, 0.0).number])


def _solved(values, G, r):
    """Return the solution of G mu = r for rows {column: operand} of a symmetric, positive G."""
    emit = values.emit
    least = [emit("fmul", LEAST, row[a]) for a, row in enumerate(G)]
    order = elimination_order([(a, b) for a, row in enumerate(G) for b in row], len(G))
    steps, mu = [], [None] * len(G)
    for n, a in enumerate(order):
        pivot = values.number(G[a][a])
        inverse = (pivot > values.number(least[a])).select(1.0 / pivot, 0.0).number
        later = [b for b in order[n + 1 :] if b in G[a]]
        for m, b in enumerate(later):
            factor = emit("fmul", G[a][b], inverse)
            r[b] = emit("fsub", r[b], emit("fmul", factor, r[a]))
            for c in later[m:]:
                part = emit("fmul", factor, G[a][c])
                G[b][c] = G[c][b] = emit("fsub", G[b].get(c, 0.0), part)
        steps.append((a, inverse, later))
    for a, inverse, later in reversed(steps):
        known = dot(emit, [(G[a][b], mu[b]) for b in later])
        rest = r[a] if known is None else emit("fsub", r[a], known)
        mu[a] = emit("fmul", rest, inverse)
    return mu
