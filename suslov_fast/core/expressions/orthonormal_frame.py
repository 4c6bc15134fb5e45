"""Right-hand side of a motion with orthonormal tangent vectors (a frame) and their growth.

The columns of Q are tangent vectors that stay orthonormal: with M = Q^T f' Q and the skew matrix S
that has the entries of M below its diagonal,

Q' = Q S,     l_i' = M_ii,

where l_i are the logarithms of the diagonal of R in V = Q R, for V' = f' V. Columns of V decay at
different rates, and lose their digits; Q changes only as fast as the motion. The variables are the
entries of Q plus SHIFT: allowed errors are relative, and would be needlessly small for entries
near 0.
"""

import functools
import itertools

from .programs import Expressions, dot, emitted, united
from .right_hand_side import RightHandSide

SHIFT = 2.0


@functools.lru_cache(64)
def with_frame(f, moving):
    """Return the `RightHandSide` of x, of an orthonormal frame Q, and of the logarithms l.

    Q has tangent vectors as columns, and l the logarithms of their growth, as in the head of this
    file; the variables are x, the rows of Q + SHIFT, and l. f in x' = f(x) has no branches. Tangent
    vectors have entries for the components `moving` of x. The parameters are the numbers in the
    table of f, which also contains the starts of clocks.
    """
    D, n = f.D, len(moving)
    first = D + n * n + n
    values = Expressions(first + len(f.table), range(first, first + len(f.table)))
    known = {i: i for i in range(D)} | {a: first + k for k, a in enumerate(f.table)}
    results = emitted(values, united((f.rates, f.derivative)), known)
    of_x, entries = results[:D], results[D:]
    place = {i: k for k, i in enumerate(moving)}
    slopes = {
        (place[i], place[j]): a
        for (i, j), a in zip(f.pattern, entries, strict=True)
        if i in place and j in place
    }
    rows, emit = range(n), values.emit
    Q = {(i, j): emit("fsub", D + i * n + j, SHIFT) for i in rows for j in rows}
    turned = {(j, i): a for (i, j), a in Q.items()}
    M = _product(emit, turned, _product(emit, slopes, Q, n), n)
    S = {}
    for (i, j), a in M.items():
        if i > j:
            S[i, j], S[j, i] = a, emit("fmul", -1.0, a)
    of_Q = _product(emit, Q, S, n)
    rates = [of_Q.get((i, j), 0.0) for i in rows for j in rows]
    results = [*of_x, *rates, *(M.get((i, i), 0.0) for i in rows)]
    table = range(first, first + len(f.table))
    return RightHandSide(values, results, len(f.table), table=table, is_written=False)


def _product(emit, a, b, n):
    """Return the product of n by n matrices a and b, dicts {(i, j): operand} of entries not 0."""
    product = {}
    for i, j in itertools.product(range(n), repeat=2):
        pairs = [(a[i, k], b[k, j]) for k in range(n) if (i, k) in a and (k, j) in b]
        if pairs:
            product[i, j] = dot(emit, pairs)
    return product
