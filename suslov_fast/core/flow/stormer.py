"""The columns of an explicit step if the variables fall into two sets: Störmer's rule.

If the rates of A read B alone, and the rates of B read A alone (`partitioned`), Gragg's rule
(`gragg`) computes two leapfrogs that never meet. Störmer's rule is one of them: half the work.

b_B = x_B + s f_B(x_A),     a_A = a_A + 2 s f_A(b_B),     b_B = b_B + 2 s f_B(a_A),

at the end of the column b_B = b_B + s f_B(a_A). There a_A and b_B are the state at h, so that no
smoothing is needed. The rule is symmetric, and has the weights of Gragg's rule.

In close passages of Kepler's problem the error is up to 11 times that of Gragg's columns at equal
estimates; therefore the estimate is multiplied by CAUTION_OF_STORMER.

If f may have thin layers, Gragg's rule is used, because only the difference of its two leapfrogs
shows that all columns agree on a wrong end.
"""

from ..expressions.partitioned import part_of, sets_of
from ..llvm.text import Carried
from . import allowed_errors
from .gragg import ExplicitColumns, Gragg
from .tolerances import CAUTION_OF_STORMER
from .vector_functions import ProgramFunction

OF_SETS = "f_a", "f_b"  # functions for the rates of the first and second set


class Stormer(Gragg):
    """Störmer's rule for the two sets of components `sets`, which are `ComponentSets`."""

    sums = ()

    def __init__(self, f, columns):
        super().__init__(f, columns)
        self.sets = sets_of(f)
        self.error_weights = [CAUTION_OF_STORMER * w for w in self.error_weights]

    @classmethod
    def fits(cls, f):
        return sets_of(f) is not None

    def add_functions(self, functions):
        f = self.f
        for name, components in zip(OF_SETS, self.sets, strict=True):
            functions[name] = ProgramFunction(part_of(f.rates, components), f.D, f.places)

    def add(self, text, integrator, name, for_each):
        StormerColumns(text, integrator, name, for_each).add()

    def add_errors(self, code, i, sums, inverse):
        return {}

    def end_errors(self, code, errors):
        """Return `rates` and `states` of `DIFFERENCES`, and their `limit`.

        They are products of the sums over both sets of variables. So rates / states is (h |mu|)**4
        in place of (h |mu|)**2, and the limit of h |mu| is squared, too.
        """
        text, work, sums = code.text, code.work, []
        for components in self.sets:
            own = Carried(rates=0.0, states=0.0)
            for i in text.listed(components)(own):
                inputs = {"last": work.a[i], "inverse": work.inverse[i], "taken": work.taken[0]}
                own.update(code.apply(allowed_errors.DIFFERENCES, i, **vars(own) | inputs))
            sums.append(own)
        A, B = sums
        limit = code.number("limit")
        return {"rates": A.rates * B.rates, "states": A.states * B.states, "limit": limit * limit}

    def begin_trial(self, code):
        return lambda i: code.text.value(0.0)


class StormerColumns(ExplicitColumns):
    """Writer of `columns`, see `ExplicitColumns`, by Störmer's rule for two sets of components."""

    names = OF_SETS

    def __init__(self, text, integrator, name, for_each):
        super().__init__(text, integrator, name, for_each)
        self.rows = integrator.rule.sets

    def work_of_pair(self):
        """Return a third of Gragg's estimate, so that code three times as long is unrolled."""
        return super().work_of_pair() / 3.0  # saves 12 to 25 % of the time, costs LLVM 50 ms

    def end(self, a, b, x, ends, apart, of_a, of_b):
        """Write the end minus x to `ends`: a - x for i in `of_a`, b - x in `of_b`. Skip `apart`."""
        for i in of_a:
            ends[i] = a[i] - x[i]
        for i in of_b:
            ends[i] = b[i] - x[i]

    def put_rates_at_end(self, a, b, table, of_b, f):
        """Write the rates of the set A at the end of the last column to f; copy B (`of_b`) to a."""
        for i in of_b:
            a[i] = b[i]
        if not self.is_inlined:
            self.call(OF_SETS[0], b, table, f)
            return
        for i, value in self.value(OF_SETS[0], b, table).items():
            f[i] = value
