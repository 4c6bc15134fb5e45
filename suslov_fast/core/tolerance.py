"""The motion of a field to a tolerance, as lists of operations: stages, and the length of steps.

An extrapolated step of length h (`stages`) gives the next state and one of two orders less. Their
difference, plus the tenth difference of the states of the last column over 2**10, is the estimate e
of the error. Modes that decay much faster than h need the latter: stages change their signs, and
all columns multiply them by almost 1, so they would neither decay nor be seen. The difference is
what is left of them; of smooth solutions it is of order 10. The next length follows from

rho = max_i |e_i| / max(rtol s_i, 2**-46 h sum |terms of f_i(x)|),    h_next = 0.85 rho**(-1/8) h.

s_i is the largest |x_i| so far, but at least 2**-20 max_j s_j, because a component that is reached
through m others begins as t**m, and no step has relative digits of it for m > 10. The second bound
is what rounding leaves of components that cancel. Powers are square roots, which have the same bits
on every processor. A step is taken if rho <= 1 and the pivots of all its stages are above
LEAST_PIVOT: Kahan's map is exact for x' = x**2, so beyond a pole all columns agree. Pivots tend to
1 with h, so this only shortens steps, and stages need no other test: what rounding does to a stage
the estimate sees.

A trajectory ends where h falls below 2**-42 of the time, or far below its first length at time 0;
it then has the length 0. With the length 0 a step changes nothing.
"""

import functools

import numpy as np

from .elimination import LEAST_PIVOT
from .operations import Step, Values, evaluate
from .planned_elimination import Matrix

SMALLEST, OF_ROUNDING, SHORTEST = 2.0**-20, 2.0**-46, 2.0**-42
# With lengths that grow up to fourfold, a step sometimes misses a transient: HIRES loses 4000 rtol
# at 1e-5. Up to threefold it loses 50 at most between 1e-4 and 1e-6.
SAFETY, SHORTER, LONGER, REFUSED = 0.85, 0.2, 3.0, 0.5


class Stage(Step):
    """The operations of a stage: those of a step, with the least pivot as the only test.

    least    the least pivot
    choice   the `Choice` of the next length
    """

    least = None  # without a plan

    def __init__(self, indices, D):
        super().__init__(indices, D)
        self.choice = Choice(indices, D)
        self._values = Values(D + self.T, ())
        f = Matrix(indices, D, self._values, range(D), range(D, D + self.T))
        self._rates = [f.right_side(k) for k in range(D)]

    def rates(self, x, v):
        """Return f(x) (D, ...) of states (D, ...), with the bits that a single state has."""
        found = dict(enumerate([*x, *v]))
        evaluate(self._values.operations, found)
        return np.array([0.0 * x[0] if n is None else found[n] + 0.0 * x[0] for n in self._rates])

    def _add_tests(self, halves):
        pivots = [self.factors.pivot[k] for k in sorted(self.factors.pivot)]
        self.least = self.values.joined("min", pivots) if pivots else self._one()

    def _one(self):
        return self.values.emit("fadd", 1.0, 0.0)

    def _results(self):
        return [*self.after, self.least]


@functools.lru_cache(32)
def stage_of(places, D):
    """Return the `Stage` of fields with terms at these indices, given by their bytes."""
    return Stage(np.frombuffer(places, np.int64).reshape(3, -1), D)


class Choice:
    """The operations at the end of a step: the next state, time and length.

    Values are given by `inputs`, in this order: the state x, x_next - x, the same without the
    shortest column, the largest moduli so far (D each), the values v of the terms (T), and t, the
    length wanted, the length taken, the first length, the least pivot, the end of time, and rtol.

    results   numbers of the next state and the largest moduli (D each), t and the length
    """

    def __init__(self, indices, D):
        self.D, T = D, indices.shape[1]
        values = Values(4 * D + T + 7, ())
        emit, joined = values.emit, values.joined
        x, total, second, largest = (range(k * D, k * D + D) for k in range(4))
        t, wanted, taken, first, least, end, rtol = range(4 * D + T, 4 * D + T + 7)
        after = [emit("fadd", x[k], total[k]) for k in range(D)]
        errors = [emit("fabs", emit("fsub", total[k], second[k])) for k in range(D)]
        sizes = [emit("max", emit("fabs", after[k]), largest[k]) for k in range(D)]
        floor = emit("fmul", SMALLEST, joined("max", sizes))
        sizes = [emit("max", size, floor) for size in sizes]
        terms = Matrix(
            indices, D, values,
            [emit("fabs", k) for k in x],
            [emit("fabs", 4 * D + k) for k in range(T)],
        )  # fmt: skip
        rounding, ratios = emit("fmul", OF_ROUNDING, taken), []
        for k in range(D):
            allowed, of_terms = emit("fmul", rtol, sizes[k]), terms.right_side(k)
            if of_terms is not None:
                allowed = emit("max", emit("fmul", rounding, of_terms), allowed)
            ratio = emit("fdiv", errors[k], allowed)
            ratios.append(emit("select", emit("oeq", errors[k], 0.0), 0.0, ratio))
        rho = joined("max", ratios)
        numbers = [emit("fabs", after[k]) for k in range(D)] + errors
        finite = joined("and", [emit("olt", number, np.inf) for number in numbers])
        good = [finite, emit("oge", 1.0, rho), emit("ogt", least, LEAST_PIVOT)]
        good = joined("and", good)
        root = emit("select", finite, rho, 1e30)
        for _ in range(3):
            root = emit("sqrt", root)
        factor = emit("max", emit("fdiv", SAFETY, root), SHORTER)
        factor = emit("min", factor, LONGER)
        factor = emit("select", good, factor, emit("min", factor, REFUSED))
        length = emit("fmul", taken, factor)
        # A step that was cut at the end of time says nothing against the length wanted.
        is_cut = emit("and", good, emit("olt", taken, wanted))
        length = emit("select", is_cut, wanted, length)
        arrives = emit("oeq", taken, emit("fsub", end, t))
        later = emit("select", arrives, end, emit("fadd", t, taken))
        later = emit("select", good, later, t)
        limit = emit("fmul", SHORTEST, emit("max", later, first))
        ended = emit("olt", length, limit)
        states = [emit("select", good, after[k], x[k]) for k in range(D)]
        states = [emit("select", ended, np.nan, state) for state in states]
        moduli = [emit("select", good, sizes[k], largest[k]) for k in range(D)]
        self.results = [*states, *moduli, later, emit("select", ended, 0.0, length)]
        self.operations = values.operations
