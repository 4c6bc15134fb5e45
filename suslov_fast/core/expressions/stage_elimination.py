"""Elimination in A = 1 - s J as expression programs, planned on the pattern of J.

`core.maps.kahan_step` has the equations, with N = s J. If a pivot is too small, the result is not
finite, or the error estimate of the step is large, and the step is rejected.
"""

from .programs import Program, Values, dot, program_of, renumbered
from .symbolic_elimination import Factors


class Elimination:
    """The programs that factorise A = 1 - s J, and that solve A v = g.

    factors   `Program` that reads the entries of J (in the order of `pattern`) and s; its results
              are the inverse pivots, and the numbers below and above the diagonal
    solution  `Program` that reads these results and g (D); its results are v (D)

    `order` has the unknowns in the order of pivots, and `fill` is from `filled`.
    """

    def __init__(self, pattern, order, fill):
        D, s = len(order), len(pattern)
        values, first = _Products(s + 1 + D, ()), s + 1
        factors = Factors(_Scaled(values, pattern), order, fill)
        numbers = [*factors.inverse.values(), *factors.lower.values(), *factors.upper.values()]
        self.factors = program_of(values.operations, numbers)
        values.operations, v = [], {}
        for k in order:
            v[k] = factors.forward(k, first + k, v)
        for k in reversed(order):
            v[k] = factors.backward(k, v)
        given = {number: place for place, number in enumerate(numbers)}
        given |= {first + i: len(numbers) + i for i in range(D)}
        solution = Program(values.operations, [v[i] for i in range(D)])
        self.solution = renumbered(solution, given)


class _Products(Values):
    """Values that write each sum as products and additions: LLVM compiles short blocks of them."""

    def total_of(self, start, factors):
        return dot(self.emit, zip(factors[::2], factors[1::2], strict=True), start)


class _Scaled:
    """The matrix s J, with the methods of a `Matrix` that `Factors` calls to eliminate."""

    def __init__(self, values, pattern):
        self.values, self.numbers = values, {place: k for k, place in enumerate(pattern)}

    def entry(self, i, j):
        """Return the operand of s J_ij, None if it is 0; and None, as there is no right side."""
        k, s = self.numbers.get((i, j)), len(self.numbers)
        return (None if k is None else self.values.emit("fmul", s, k)), None


def operations_of(fill):
    """Return about how many operations the factors take; `fill` is from `filled`."""
    count = 0
    for k, (row, column) in enumerate(zip(*fill, strict=True)):
        later, below = (row >> (k + 1)).bit_count(), (column >> (k + 1)).bit_count()
        count += 2 * (later * below + later + below)
    return count
