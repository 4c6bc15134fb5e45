"""Elimination in a large sparse matrix A by columns, planned as arrays of integers.

A = L D U, where L and U have unit diagonals. In the order of pivots, column j follows from the
columns before it. The numbers w_i of a work row begin with a_ij; then, for each k < j with u_kj !=
0,

w_i -= l_ik w_k for i > k;    u_ij = w_i / d_i (i < j),    d_j = w_j,    l_ij = w_i / d_j (i > j).

The rows of a column in L, or in U, form spans of consecutive rows. So a loop needs two integers for
many products; dense matrices have one span in each column. Spans that are less than JOINED_GAP rows
apart are joined, because a span costs as much time as some JOINED_GAP products with 0.
"""

from typing import NamedTuple

import numpy as np

from .symbolic_elimination import bits_of
from .tolerances import JOINED_GAP


class ColumnOffsets(NamedTuple):
    """The beginning of a column in the arrays of `Sparse`, where the column before it ends."""

    entries: int  # where the column begins in `rows` and `numbers`
    pivots: int  # where the column begins in `pivots`
    spans: int  # where the spans of U of the column begin in `spans`; spans of U come first
    lower: int  # where the spans of L of the column begin in `spans`
    of_upper: int  # where the column begins among the numbers of U
    of_lower: int  # where the column begins among the numbers of L


SLOT = ColumnOffsets(*range(len(ColumnOffsets._fields)))


class Sparse:
    """The plan of elimination in A = 1 - s J = L D U, as arrays that machine code reads.

    J has entries at `places` (i, j), and `fill` is from `filled`. Rows and columns are numbered in
    the order of pivots, except in `lower` and `upper`.

    order        (D,) the unknowns in the order of pivots
    offsets      (D + 1, 6) `ColumnOffsets` of each column
    rows         the row of each entry of J, column by column
    numbers      the number of each of these entries in `places`
    pivots       for each column j in turn, the rows k < j with u_kj != 0
    spans        (-, 2) first row and number of rows of each span: consecutive rows in which a
                 column of L or U has entries, and small gaps between such rows
    lower, upper   (-, 2) the unknowns of row and column, for each number of L and of U
    """

    def __init__(self, places, order, fill):
        D, columns = len(order), range(len(order) + 1)
        self.order, rank = np.array(order, np.int32), np.empty(D, np.int64)
        rank[order] = np.arange(D)
        i, j = rank[np.array([*places], np.int64).reshape(-1, 2).T]
        by_column = np.lexsort((i, j))
        self.rows, self.numbers = i[by_column].astype(np.int32), by_column.astype(np.int32)
        lower, upper = _below_and_above(fill[1])
        of_upper, of_lower = _spans(*upper), _spans(*lower)
        self.upper, self.lower = (self._in_full(of) for of in (of_upper, of_lower))
        first_upper, first_lower = (np.searchsorted(of[0], columns) for of in (of_upper, of_lower))
        spans = np.concatenate([of_upper, of_lower], axis=1)
        self.spans = spans[1:, np.argsort(spans[0], kind="stable")].T.astype(np.int32)
        of_pivots, self.pivots = upper[0], upper[1].astype(np.int32)
        offsets = ColumnOffsets(
            entries=np.searchsorted(j[by_column], columns),
            pivots=np.searchsorted(of_pivots, columns),
            spans=first_upper + first_lower,
            lower=np.append(first_upper[1:], first_upper[-1]) + first_lower,
            of_upper=np.append(0, np.cumsum(of_upper[2]))[first_upper],
            of_lower=np.append(0, np.cumsum(of_lower[2]))[first_lower],
        )
        self.offsets = np.stack(offsets, axis=1).astype(np.int64)

    def _in_full(self, spans):
        """Return unknowns (row, column) of all places in `spans` (column, first row, count)."""
        column, first, count = spans
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        return self.order[[np.repeat(first, count) + within, np.repeat(column, count)]].T.copy()

    size = property(lambda self: len(self.lower) + len(self.upper))


def _below_and_above(sets):
    """Return (columns, rows) below and above the diagonal; sets[k] has rows of column k as bits."""
    places = [(k, i) for k, rows in enumerate(sets) for i in bits_of(rows)]
    columns, rows = np.array(places, np.int64).reshape(-1, 2).T
    return [(columns[part], rows[part]) for part in (rows > columns, rows < columns)]


def _spans(columns, rows):
    """Return an array (3, n): column, first row and number of rows of each span.

    `columns` and `rows` are places of entries in order; gaps of less than JOINED_GAP rows are
    included.
    """
    is_first = np.ones(len(rows), bool)
    is_first[1:] = (np.diff(columns) != 0) | (np.diff(rows) > JOINED_GAP)
    begin = np.flatnonzero(is_first)
    last = np.append(begin[1:], len(rows))[: len(begin)] - 1
    return np.stack([columns[begin], rows[begin], rows[last] - rows[begin] + 1])
