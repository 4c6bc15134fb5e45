"""Right-hand side of a motion with orthonormal tangent vectors (a frame) and their growth.

The columns of Q are tangent vectors that stay orthonormal: with M = Q^T f' Q and the skew matrix S
that has the entries of M below its diagonal,

Q' = Q S,     l_i' = M_ii,

where l_i are the logarithms of the diagonal of R in V = Q R, for V' = f' V. Columns of V decay at
different rates, and lose their digits; Q changes only as fast as the motion. The variables are the
entries of Q plus SHIFT: allowed errors are relative, and would be needlessly small for entries
near 0.

With constraints, tangent vectors V satisfy C V = 0, and off the constraints perturbations would
grow beside columns that decay fast. So V has coordinates W of the tangent space: with orthogonal
axes U = (U_t, U_n), where U_t spans a tangent space near x,

V = U_t W + U_n G W,     G = -(C U_n)^-1 C U_t,     W' = A W,     A = U_t^T f' (U_t + U_n G),

and Q has the columns of W, and A the place of f'. C U_n is a lower triangle where U is exact, so
the elimination needs no exchange of rows.
"""

import functools
import itertools

from .programs import Expressions, dot, emitted, united
from .projection import Invariants
from .right_hand_side import RightHandSide

SHIFT = 2.0


@functools.lru_cache(64)
def with_frame(f, moving):
    """Return the `RightHandSide` of x, of an orthonormal frame Q, and of the logarithms l.

    Q has tangent vectors as columns, and l the logarithms of their growth, as in the head of this
    file; the variables are x, the rows of Q + SHIFT, and l. f in x' = f(x) has no branches. Tangent
    vectors have entries for the components `moving` of x. The parameters are the numbers in the
    table of f, which also contains the starts of clocks, and then the rows of U if f has
    constraints.
    """
    D, n, place = f.D, len(moving), {i: k for k, i in enumerate(moving)}
    rows = _rows_of_constraints(f, place)
    m = n - len(rows)
    first = D + m * m + m
    fixed = range(first, first + len(f.table) + (n * n if rows else 0))
    values = Expressions(fixed.stop, fixed)
    known = {i: i for i in range(D)} | {a: first + k for k, a in enumerate(f.table)}
    results = iter(emitted(values, united((f.rates, f.derivative, f.invariants)), known))
    parts = (D, len(f.pattern), f.invariants_count, len(f.invariants_places))
    of_x, entries, levels, of_levels = ([next(results) for _ in range(count)] for count in parts)
    slopes = _matrix(f.pattern, entries, place, place)
    if rows:
        C = _matrix(f.invariants_places, of_levels, {a: k for k, a in enumerate(rows)}, place)
        U = _axes(f, moving, C, m, first + len(f.table))
        slopes = _within_constraints(values, slopes, C, U, (m, n))
    emit, square = values.emit, [*itertools.product(range(m), repeat=2)]
    Q = {(i, j): emit("fsub", D + i * m + j, SHIFT) for i, j in square}
    M = _product(emit, _transposed(Q), _product(emit, slopes, Q, m), m)
    S = {}
    for (i, j), a in M.items():
        if i > j:
            S[i, j], S[j, i] = a, emit("fmul", -1.0, a)
    of_Q = _product(emit, Q, S, m)
    rates = [of_Q.get(each, 0.0) for each in square]
    results = [*of_x, *rates, *(M.get((i, i), 0.0) for i in range(m))]
    invariants = Invariants(levels, f.constraints_count, f.positions)
    about = {"table": fixed, "invariants": invariants, "is_written": False}
    return RightHandSide(values, results, len(fixed), **about)


def _rows_of_constraints(f, moving):
    """Return the numbers of constraints on `moving` components, first those without velocities."""
    places = [(a, i) for a, i in f.invariants_places if a < f.constraints_count and i in moving]
    of_velocities = {a for a, i in places if i >= f.positions}
    return sorted({a for a, _ in places}, key=lambda a: (a in of_velocities, a))


def _matrix(places, entries, rows, columns):
    """Return a matrix {(row, column): operand} of the entries in `rows` and `columns`."""
    return {
        (rows[i], columns[j]): a
        for (i, j), a in zip(places, entries, strict=True)
        if i in rows and j in columns
    }


def _axes(f, moving, C, m, first):
    """Return the matrix U, the numbers from `first` on: its columns are coordinates, or velocities.

    Tangent axes are the first m columns; of these, and of the others, coordinates come first.
    """
    n, q = len(moving), sum(i < f.positions for i in moving)
    g = n - m - len({k for k, j in C if j >= q})
    of_q = {*range(q - g), *range(m, m + g)}
    square = itertools.product(range(n), repeat=2)
    return {(i, j): first + i * n + j for i, j in square if (i < q) == (j in of_q)}


def _within_constraints(values, slopes, C, U, sizes):
    """Return the matrix A (m, m) of the head of this file, for f' = slopes (n, n)."""
    (m, n), emit = sizes, values.emit
    inner = _product(emit, C, U, n)
    G, inverse, normal = {}, {}, range(n - m)
    for k in normal:
        inverse[k] = emit("fdiv", 1.0, inner[k, m + k])
        for i in normal[k + 1 :]:
            if (i, m + k) in inner:
                factor = emit("fmul", inner[i, m + k], inverse[k])
                for j in [*range(m), *range(m + k + 1, n)]:
                    if (k, j) in inner:
                        part = emit("fmul", factor, inner[k, j])
                        inner[i, j] = emit("fsub", inner.get((i, j), 0.0), part)
    for k, j in itertools.product(reversed(normal), range(m)):
        pairs = [
            (inner[k, m + i], G[i, j])
            for i in normal[k + 1 :]
            if (k, m + i) in inner and (i, j) in G
        ]
        total = dot(emit, pairs, inner.get((k, j)))
        if total is not None:
            G[k, j] = emit("fmul", -1.0, emit("fmul", total, inverse[k]))
    along = {(i, j): a for (i, j), a in _transposed(U).items() if i < m}
    whole = _product(emit, _product(emit, along, slopes, n), U, n)
    A = {(i, j): a for (i, j), a in whole.items() if j < m}
    across = {(i, j - m): a for (i, j), a in whole.items() if j >= m}
    for place, a in _product(emit, across, G, n - m).items():
        A[place] = emit("fadd", A[place], a) if place in A else a
    return A


def _transposed(a):
    return {(j, i): operand for (i, j), operand in a.items()}


def _product(emit, a, b, n):
    """Return the product of matrices a (-, n) and b (n, -), dicts {(i, j): operand} without 0."""
    product, rows, columns = {}, sorted({i for i, _ in a}), sorted({j for _, j in b})
    for i, j in itertools.product(rows, columns):
        pairs = [(a[i, k], b[k, j]) for k in range(n) if (i, k) in a and (k, j) in b]
        if pairs:
            product[i, j] = dot(emit, pairs)
    return product
