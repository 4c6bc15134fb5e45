"""Elimination in a large sparse matrix A by columns, planned as arrays of integers.

In the order of pivots column j of A = L D U, where L and U have ones on the diagonal, follows from
those before it. The numbers w_i of a work row begin with a_ij; then, for each k < j with u_kj != 0,

w_i -= l_ik w_k for i > k;    u_ij = w_i / d_i (i < j),    d_j = w_j,    l_ij = w_i / d_j (i > j).

The rows of a column in L, or in U, are spans that follow each other, so that a loop needs two
integers for many products; dense matrices have one span a column. Spans that are less than NEAR
apart are joined, because a span costs as much as some NEAR products with 0.
"""

from typing import NamedTuple

import numpy as np

from .planned_elimination import bits_of, elimination_order

# On lattices of 144 to 4,096 variables 8 to 32 take the least time: joining adds 15 % of products,
# and leaves a third of the spans.
NEAR = 8


class Head(NamedTuple):
    """Where the parts of a column begin; those of the next column are the ends."""

    entries: int  # in `rows` and `numbers`
    pivots: int  # in `pivots`
    spans: int  # in `spans`; those of U come first
    lower: int  # those of L
    of_upper: int  # among the numbers of U
    of_lower: int  # among those of L


SLOT = Head(*range(len(Head._fields)))


class Sparse:
    """The plan of elimination in A, for entries at places (i, j); those of the diagonal are added.

    Columns and rows are places in the order of pivots, but for `lower` and `upper`.

    order        (D,) the unknowns
    heads        (D + 1, 6) `Head` of each column
    rows         of the entries, column by column
    numbers      of these entries in `places`
    pivots       the k < j with u_kj != 0, of each column j
    spans        (-, 2) first row and number of rows
    lower, upper   (-, 2) the unknowns of row and column, for each number of L and of U
    operations   about how many the list of this elimination has
    """

    def __init__(self, places, D):
        order = elimination_order(places, D)
        self.order = np.array(order, np.int32)
        rank = np.empty(D, np.int64)
        rank[order] = np.arange(D)
        i, j = rank[np.array([*places], np.int64).reshape(-1, 2).T]
        by_column = np.lexsort((i, j))
        self.rows, self.numbers = i[by_column].astype(np.int32), by_column.astype(np.int32)
        lower = _filled(i, j, D)
        counts = np.bincount(lower[0], minlength=D)
        self.operations = int(2 * counts @ counts + 4 * counts.sum())
        by_row = np.lexsort(lower)
        upper = lower[1][by_row], lower[0][by_row]
        self.pivots = upper[1].astype(np.int32)
        of_upper, of_lower = _spans(*upper), _spans(*lower)
        self.upper, self.lower = (self._in_full(of) for of in (of_upper, of_lower))
        columns = np.arange(D + 1)
        first_upper, first_lower = (np.searchsorted(of[0], columns) for of in (of_upper, of_lower))
        own = np.concatenate([of_upper, of_lower], axis=1)
        self.spans = own[1:, np.argsort(own[0], kind="stable")].T.astype(np.int32)
        head = Head(
            entries=np.searchsorted(j[by_column], columns),
            pivots=np.searchsorted(upper[0], columns),
            spans=first_upper + first_lower,
            lower=np.append(first_upper[1:], first_upper[-1]) + first_lower,
            of_upper=np.append(0, np.cumsum(of_upper[2]))[first_upper],
            of_lower=np.append(0, np.cumsum(of_lower[2]))[first_lower],
        )
        self.heads = np.stack(head, axis=1).astype(np.int64)

    def _in_full(self, spans):
        """Return the unknowns (-, 2) of row and column of all numbers of spans."""
        column, first, count = spans
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        return self.order[[np.repeat(first, count) + within, np.repeat(column, count)]].T.copy()

    size = property(lambda self: len(self.lower) + len(self.upper))


def _filled(i, j, D):
    """Return columns and rows of L below the diagonal, for entries at (i, j); those of U are equal.

    Zeros of A whose transposed entry is not 0 count as entries: then column k of L has its first
    row k' > k in common with column k', which has all rows of column k after that.
    """
    later, columns, rows = [0] * D, [], []  # sets of rows are bits
    low, high = np.minimum(i, j), np.maximum(i, j)
    for k, number in zip(low.tolist(), high.tolist(), strict=True):
        later[k] |= 1 << number
    for k in range(D):
        own = [*bits_of(later[k] >> (k + 1) << (k + 1))]
        if own:
            later[own[0]] |= later[k]
        columns += [k] * len(own)
        rows += own
    return np.array(columns, np.int64), np.array(rows, np.int64)


def _spans(columns, rows):
    """Return the spans (3, -) of rows of columns: column, first row and number of rows."""
    is_first = np.ones(len(rows), bool)
    is_first[1:] = (np.diff(columns) != 0) | (np.diff(rows) > NEAR)
    begin = np.flatnonzero(is_first)
    last = np.append(begin[1:], len(rows))[: len(begin)] - 1
    return np.stack([columns[begin], rows[begin], rows[last] - rows[begin] + 1])
