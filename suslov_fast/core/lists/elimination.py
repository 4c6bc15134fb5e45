"""Elimination in A = 1 - s J as lists of operations, planned on the pattern of J.

Pivots k follow an order with little fill-in, without a choice of rows:

l_ik = a_ik / a_kk,    a_ij -= l_ik a_kj    for i and j that come later.

A small pivot shows as a value that is not finite, or as an error of the step, which is refused.
"""

from collections import defaultdict

from .planned_elimination import before_and_after
from .right_hand_side import List, needed_for, renumbered
from .step import Values


class Elimination:
    """The lists that factorise A, and that solve A v = g.

    factors   `List` of the entries of J (in the order of the pattern) and of s; the results are
              inverses of pivots, l_ik and a_kj
    solution  `List` of these results and of g (D); the results are v (D)

    `fill` is what `filled` returns for this order.
    """

    def __init__(self, pattern, order, fill):
        D = len(order)
        entries = {place: number for number, place in enumerate(pattern)}
        count = len(entries)
        values, s = Values(count + 1 + D, ()), count
        right = {i: count + 1 + i for i in range(D)}
        before, after = before_and_after(order, fill)
        below = defaultdict(list)
        for i in order:
            for k in before[i]:
                below[k].append(i)
        emit, lower, upper, inverse = values.emit, {}, {}, {}

        def entry(i, j):
            """Return a_ij after elimination with the pivots before i and j; None if it is 0."""
            a = 1.0 if i == j else None
            if (i, j) in entries:
                product = emit("fmul", s, entries[i, j])
                a = emit("fsub", 1.0, product) if i == j else emit("fmul", -1.0, product)
            for k in before[i]:
                if (i, k) in lower and (k, j) in upper:
                    product = emit("fmul", lower[i, k], upper[k, j])
                    a = emit("fsub", 0.0 if a is None else a, product)
            return a

        for k in order:
            pivot = entry(k, k)
            if pivot != 1.0 or not isinstance(pivot, float):
                inverse[k] = emit("fdiv", 1.0, pivot)
            for i in below[k]:
                a = entry(i, k)
                lower[i, k] = emit("fmul", a, inverse[k]) if k in inverse else a
            for j in after[k]:
                upper[k, j] = entry(k, j)
        found = [*inverse.values(), *lower.values(), *upper.values()]
        self.factors = List(needed_for(values.operations, found), found)
        del values.operations[:]
        for k in order:
            for i in before[k]:
                product = emit("fmul", lower[k, i], right[i])
                right[k] = emit("fsub", right[k], product)
        for k in reversed(order):
            for j in after[k]:
                product = emit("fmul", upper[k, j], right[j])
                right[k] = emit("fsub", right[k], product)
            if k in inverse:
                right[k] = emit("fmul", right[k], inverse[k])
        given = {number: place for place, number in enumerate(found)}
        given |= {count + 1 + i: len(found) + i for i in range(D)}
        solution = List(values.operations, [right[i] for i in range(D)])
        self.solution = renumbered(solution, given)


def operations_of(fill):
    """Return about how many operations the list of factors has."""
    count = 0
    for k, (row, column) in enumerate(zip(*fill, strict=True)):
        later, below = (row >> (k + 1)).bit_count(), (column >> (k + 1)).bit_count()
        count += 2 * (later * below + later + below)
    return count
