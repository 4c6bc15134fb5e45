"""The two halves of the motion of a right-hand side: what their code is made of."""

import functools

from ..lists.elimination import Elimination
from ..lists.right_hand_side import List
from ..operations import Values
from .columns import EXPLICIT, IMPLICIT
from .rows import rows_of, work_of


class Half:
    """The explicit or the implicit half of the motion of a `RightHandSide`.

    elimination  `Elimination` in 1 - s f'; None in the explicit half
    power        `List` of the entries of f', of s, and of a vector (D); the results are f' times it
    rows, work   `Rows` of a line and `Work`
    """

    def __init__(self, f, is_implicit, has_atol):
        self.f, self.is_implicit, self.has_atol = f, is_implicit, has_atol
        D, extended = f.D, len(f.denominators)
        self.rows = rows_of(D, extended)
        columns, entries, factors = len(EXPLICIT), 0, 0
        self.elimination = self.power = None
        if is_implicit:
            self.elimination, self.power = Elimination(f.pattern, D), _product(f)
            columns, factors = len(IMPLICIT), len(self.elimination.factors.results)
            entries = len(f.pattern) + 1 + D
        self.work = work_of(D, extended, columns, entries, factors)

    @functools.cached_property
    def key(self):
        """What tells the code of this half from others."""
        return self.f.key, self.is_implicit, self.has_atol


def _product(f):
    """Return the `List` of f' times a vector."""
    entries = len(f.pattern)
    values, totals = Values(entries + 1 + f.D, ()), {}
    for k, (i, j) in enumerate(f.pattern):
        product = values.emit("fmul", k, entries + 1 + j)
        totals[i] = values.emit("fadd", totals[i], product) if i in totals else product
    return List(values.operations, [totals.get(i, 0.0) for i in range(f.D)])
