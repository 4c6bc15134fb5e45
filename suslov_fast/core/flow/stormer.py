"""The columns of an explicit step where the variables fall into two sets: Störmer's rule.

If the rates of A read B alone, and those of B read A alone (`partitioned`), Gragg's rule (`gragg`)
computes two leapfrogs that never meet. Störmer's rule is one of them, with half the operations:

b_B = x_B + s f_B(x_A),     a_A = a_A + 2 s f_A(b_B),     b_B = b_B + 2 s f_B(a_A),

at the end of the column b_B = b_B + s f_B(a_A). There a_A and b_B are both the state at h, so that
nothing has to be smoothed. The rule is symmetric, and has the weights of Gragg's.

In close passages of Kepler's problem the error is up to 11 times that of Gragg's columns where the
estimates are the same; therefore the estimate is multiplied by `tolerance.CAUTION`.

Nor are there two sequences that may lie apart, and the estimate of the error alone does not see all
layers of f that are thinner than a sub-step: where a step is tried again and again, it may be small
by chance. After ROUGH refusals (`step_length.REFUSALS`) a lane has Gragg's columns for some steps.
"""

from ..llvm.text import Index
from .gragg import ARGUMENTS, OF_SETS, ExplicitColumns
from .step_length import ROUGH


class StormerColumns(ExplicitColumns):
    """The function `columns` where there are `Integrator.sets`, see `ExplicitColumns`."""

    names = OF_SETS

    def __init__(self, text, integrator, name, for_each):
        super().__init__(text, integrator, name, for_each)
        self.rows = integrator.sets

    def add(self):
        """Add the function, after that for lines with rough lanes."""
        _Both(self.text, self.integrator, self.name, self.for_each).add()
        super().add()

    def leave_to_others(self):
        """Leave the function where some lane is rough."""
        with self.text.when(is_rough(self.work, self.integrator).any(), likely=False):
            self.text.invoke(f"{self.name}_both", *(Index(self.text, f"%{a}") for a in ARGUMENTS))
            self.text.leave("void")

    def work_of_pair(self):
        """Return a measure of a pair of sub-steps: those written out may be three times as long.

        That saves 12 to 25 % of the time, and costs LLVM up to 50 ms.
        """
        return super().work_of_pair() / 3.0

    def end(self, work, a, b, x, ends, apart, of_a, of_b):
        """Write the end of a column, less x."""
        for i in of_a:
            ends[i] = a[i] - x[i]
        for i in of_b:
            ends[i] = b[i] - x[i]

    def rates_at_end(self, a, b, table, of_b, call=None):
        """Return the rates in A at the end of the last column; `a` gets the state in B."""
        for i in of_b:
            a[i] = b[i]
        if self.is_inlined:
            return self.value(OF_SETS[0], b, table)
        call(OF_SETS[0], b)
        return {}


class _Both(ExplicitColumns):
    """The function `both`: Gragg's columns of rough lanes, and Störmer's of others.

    It is for few steps, and calls f.
    """

    function = "both"

    def add(self):
        """Add the function."""
        self.is_inlined = False
        with self.body():
            self.in_sets = [*map(self.text.listed, self.integrator.sets)]
            self.in_turn(self.text)

    def rates_at_end(self, a, b, table, of_b, call=None):
        """Return what Störmer's rule has, of all lanes."""
        return StormerColumns.rates_at_end(self, a, b, table, self.in_sets[1](), call)

    def end(self, work, a, b, x, ends, apart, of_a, of_b):
        """Write the end of a column, less x, and how far the halves of Gragg's lie apart."""
        others = ~is_rough(work, self.integrator)
        super().end(work, a, b, x, ends, apart, of_a, of_b)
        for own, components in zip((a, b), self.in_sets, strict=True):
            for i in components():
                ends.choose(others, i, own[i] - x[i])


def is_rough(work, integrator):
    """Return which lanes are rough."""
    return work.line.after(integrator.rows.rough)[0] >= ROUGH
