"""Machine code of elimination in a sparse matrix, for any plan (`sparse_elimination`)."""

import functools
from types import SimpleNamespace

from ..expressions.sparse_elimination import SLOT, ColumnOffsets
from .text import Carried, Code, Index, Integers
from .tolerances import ROWS_OF_SPAN


def _parts(text, plan, *names):
    """Return an object with addresses of the arrays `names` of a plan, and counts of numbers."""
    arrays = {"D": plan.order, "entries": plan.rows, "of_lower": plan.lower, "of_upper": plan.upper}
    counts = {name: Index(text, len(array)) for name, array in arrays.items()}
    addresses = {name: text.constants(getattr(plan, name)).base for name in names}
    return SimpleNamespace(**counts, **addresses)


def _between(text, begin, end):
    """Add a loop to `text`; yield its integer, from `begin` to end - 1; none if begin >= end."""
    with text.when(begin < end):
        for n in text.each(end - begin):
            yield begin + n


def _offsets(text, parts, j):
    """Return where columns j and j + 1 of A begin: two `ColumnOffsets`, read at `parts.offsets`."""
    offsets = Integers(text, parts.offsets + j * (8 * len(SLOT)))
    return tuple(ColumnOffsets(*(offsets[k + first] for k in SLOT)) for first in (0, len(SLOT)))


def _along(text, parts, begin, end, row_0, numbers=0):
    """Add loops to `text` over the rows of the spans begin, ..., end - 1 in `parts.spans`.

    A span is a range of consecutive rows with entries of a column of L or U, and small gaps.
    Yield the text for a loop's body, the address of a row in a column, and the address of the entry
    of L or U in this row. `row_0` is the address of row 0, `numbers` of the first entry. If W is 1,
    one loop takes ROWS_OF_SPAN rows as lanes of a wider text; the bits are the same.
    """
    inner = Code(max(text.W, ROWS_OF_SPAN), text)
    size = text.size
    with text.when(begin < end):
        for now in text.rounds(Carried(span=begin, number=numbers)):
            first, count = (text.short(parts.spans, now.span * 2 + k) for k in range(2))
            first = row_0 + first * size
            rest = 0
            if text.W == 1:
                rest = count - (count & (ROWS_OF_SPAN - 1))
                for n in _between(text, 0, rest // ROWS_OF_SPAN):
                    yield inner, first + n * inner.size, now.number + n * inner.size
            for n in _between(text, rest, count):
                yield text, first + n * size, now.number + n * size
            now.span = now.span + 1
            now.number = now.number + count * size
            now.goes_on = now.span < end


def _for_rows(text, value):
    """Return {W: `value` in W lanes} for the texts of W lanes that `_along` yields."""
    if text.W > 1:
        return {text.W: value}
    return {1: value, ROWS_OF_SPAN: text.lanes(ROWS_OF_SPAN).splat(value)}


def add_factors(text, name, plan):
    """Add void name(from, table, to, scratch) to `text`: it factors A = 1 - s J by a `Sparse` plan.

    It reads the entries of J and s at `from`, and writes the inverse pivots (D), L and U at `to`.
    At `scratch` is room for a column (D); `table` is not read.
    """
    with text.function(name):
        of = _parts(text, plan, "offsets", "rows", "numbers", "pivots", "spans")
        along = functools.partial(_along, text, of)
        entries, inverses = text.array("%from"), text.array("%to")
        w, size = text.array("%scratch"), text.size
        s = entries[of.entries]
        lower = inverses.at(of.D)
        upper = lower + of.of_lower * size
        for j in text.each(of.D):
            column, following = _offsets(text, of, j)
            for inner, row, _ in along(column.spans, following.spans, w.at()):
                inner.array(row)[0] = 0.0
            w[j] = 0.0
            for n in _between(text, column.entries, following.entries):
                product = s * entries[text.short(of.numbers, n)]
                w[text.short(of.rows, n)] = 0.0 - product
            w[j] = 1.0 + w[j]
            for n in _between(text, column.pivots, following.pivots):
                k = text.short(of.pivots, n)
                column_k, next_k = _offsets(text, of, k)
                factor = _for_rows(text, w[k])
                numbers = lower + column_k.of_lower * size
                for inner, row, number in along(column_k.lower, next_k.spans, w.at(), numbers):
                    product = inner.array(number)[0] * factor[inner.W]
                    inner.array(row)[0] = inner.array(row)[0] - product
            inverses[j] = inverse = 1.0 / w[j]
            inverse = _for_rows(text, inverse)
            numbers = upper + column.of_upper * size
            apart = inverses.at() - w.at()
            for inner, row, number in along(column.spans, column.lower, w.at(), numbers):
                inner.array(number)[0] = inner.array(row)[0] * inner.array(row + apart)[0]
            numbers = lower + column.of_lower * size
            for inner, row, number in along(column.lower, following.spans, w.at(), numbers):
                inner.array(number)[0] = inner.array(row)[0] * inverse[inner.W]


def add_solution(text, name, plan):
    """Add void name(from, table, to, scratch) to `text`: it solves (1 - s J) v = g by `plan`.

    At `from` are factors, as `add_factors` writes them, and at `to` is g, which v replaces.
    """
    with text.function(name):
        of = _parts(text, plan, "order", "lower", "upper")
        inverses, v = text.array("%from"), text.array("%to")
        lower = inverses.from_here(of.D)
        upper = lower.from_here(of.of_lower)

        def subtract(numbers, places, n):
            row, column = (text.short(places, n * 2 + k) for k in range(2))
            product = numbers[n] * v[column]
            v[row] = v[row] - product

        for n in _between(text, 0, of.of_lower):
            subtract(lower, of.lower, n)
        for k in text.each(of.D):
            i = text.short(of.order, k)
            v[i] = v[i] * inverses[k]
        for n in _between(text, 0, of.of_upper):
            subtract(upper, of.upper, (of.of_upper - 1) - n)
