"""The motion of a field to a tolerance, as lists of operations: stages, and the length of steps.

An extrapolated step of length h (`stages`) gives the next state and one of two orders less, whose
distance is the estimate e of the error. Modes that decay much faster than h need more: stages
change their signs, and all columns multiply them by almost 1, so they would neither decay nor be
seen. What is left of them is the tenth difference d of the states of the last column over 2**10.
It is subtracted from the next state, and |d| times OF_FAST is added to e. Of smooth solutions d is
of order 10 and may exceed the error of the step, so it is subtracted only where a mode decays so
fast that d is the better multiple of it, which h sum |terms of f_i(x)| > FAST |x_i| tells: terms of
this size have to cancel. Of lifted fields it is not subtracted, and |d| is added to e as it is: the
words move away from the state within a step, which d contains, and with d subtracted van der Pol's
equation with mu = 1000 has a hundred times the error. The next length follows from

rho = max_i e_i / max(rtol s_i, 2**-46 h sum |terms of f_i(x)|),    h_next = 0.8 rho**(-1/8) h.

s_i is the largest |x_i| so far, but at least 2**-20 max_j s_j, because a component that is reached
through m others begins as t**m, and no step has relative digits of it for m > 10. A component with
a constant rate, such as time, counts there with its change in the step, because time may be large
where all others are small. The second bound is what rounding leaves of components that cancel.
Powers are square roots, which have the same bits on every processor. A step is taken if rho <= 1
and the pivots of all its stages are above LEAST_PIVOT: Kahan's map is exact for x' = x**2, so
beyond a pole all columns agree. Pivots tend to 1 with h, so this only shortens steps, and stages
need no other test: what rounding does to a stage the estimate sees. A step that is refused for its
estimate is taken again with h_next, one that is refused for a pivot with half of its length at
most, because such an estimate means nothing. After a refused step the next one is not longer,
because it would often be refused as well.

A lifted field begins each step with the words of its state, and ends it with the state alone. Its
pivots are those of 1 - (h/4) f' of the equations as given, at the beginning. A step that changes a
sign which the motion keeps is not taken, because a population below 0 would leave the solution; but
what rounding leaves of a component that has decayed gets its sign back. Nor is a step taken at
whose end words have left the state: all columns may agree on words that no state has. The word
tanh(100 x) is -1 for negative x, where its derivative is 0, so it stays -1; and next to 0 stages
take x for sqrt(x**2 + 1e-6). A word g(p) has left the state if it differs by an eighth of itself
(tanh: of 1), and if this changes h f by more than the tolerance allows. Nor is a step taken over a
pole of a variable, such as 1 / (t - 1), or one in which the angle of a sine turns by more than 16:
with very long steps all columns leave an oscillation where it was. Nor is one taken over a pulse
exp(p(t)) or 1 / cosh(p); `agreement` has these tests.

The first length is that in which |x| changes by the part min(5 rtol**(1/8), 1), which is too short
for most motions: few first steps are refused, and the next one may be ten times as long.

A trajectory ends where h falls below 2**-42 of the time, or far below its first length at time 0,
and after MOST_STEPS steps that have not reached the next time; it then has the length 0. With the
length 0 a step changes nothing.
"""

import functools
from typing import NamedTuple

import numpy as np

from .agreement import compared, follows
from .lift import Lifting, Variables, needed_for
from .operations import Step, Values, evaluate, of_one_sign
from .planned_elimination import LEAST_PIVOT, Matrix

SMALLEST, OF_ROUNDING, SHORTEST = 2.0**-20, 2.0**-46, 2.0**-42
OF_SUBNORMAL = 2.0**-1067  # what rounding leaves of numbers below the normal ones, in a step
FAST = 2.0**10
# With 1, stiff problems take twice as many steps; with 1/32 some lose digits.
OF_FAST = 0.125
# With lengths that grow up to tenfold, van der Pol's equation with mu = 1000 has half as much error
# again, in as many operations.
SAFETY, SHORTER, LONGER, REFUSED = 0.8, 0.2, 3.0, 0.5
FIRST_PART = 5.0
SMALLEST_FIRST = 2.0**-60  # part of the first length at which a trajectory at time 0 may end
MOST_STEPS = 250_000  # 10,000 orbits of a planet at rtol 1e-9; a third of a second for one orbit
# In place of LONGER: for the first step, whose length is only a guess, and after a refused one.
AT_FIRST, AFTER_REFUSED = 10.0, 1.0
REACH = 0.92  # a step reaches the end of time if its length is this part of what is left


class Stage(Step):
    """The operations of a stage: those of a step, with the least pivot as the only test.

    least    the least pivot
    """

    least = None  # without a plan

    @functools.cached_property
    def beginning(self):
        """The `Beginning` of a trajectory."""
        return Beginning(self.indices, self.D, self.given)

    @functools.cached_property
    def choice(self):
        """The `Choice` of the next length."""
        lift, even = self.lift and self.lift[0], with_constant_rates(self.indices, self.D)
        signs = lift.signs if lift else of_one_sign(self.indices)
        return Choice(self.indices, self.D, self.given, signs, even, lift)

    def _add_tests(self, halves):
        self._test_pivots([self.factors.pivot[k] for k in sorted(self.factors.pivot)])

    def _test_pivots(self, pivots):
        one = [] if pivots else [self.values.emit("fadd", 1.0, 0.0)]
        self.least = self.values.joined("min", pivots or one)

    def _results(self):
        return [*self.after, self.least]


class LiftedStage(Lifting, Stage):
    """The operations of a stage of a lifted field; the least pivot is a value of the prologue."""

    def _add_tests(self, halves):
        pass

    def words(self, x, halves):
        """Return the words after the state (n, ...) of states x (given, ...), and the least pivot.

        After h v of the terms `halves` has the coefficients of the lift.
        """
        found = dict(enumerate(x)) | dict(enumerate(halves, self.D))
        evaluate(self.fixed, found)
        evaluate(self.prologue, found)
        return [found[number] for number in self.lifted], found[self.least]

    def _results(self):
        return [*super()._results(), *self.lifted]


@functools.lru_cache(32)
def _stage_of(places, D, *lift):
    kind = LiftedStage if lift else Stage
    return kind(np.frombuffer(places, np.int64).reshape(3, -1), D, *lift)


def stage_of(indices, D, lift=None):
    """Return the `Stage` of fields of D words with terms at these indices (3, T)."""
    places = np.ascontiguousarray(indices, np.int64).tobytes()
    return _stage_of(places, D) if lift is None else _stage_of(places, D, lift)


def with_constant_rates(indices, D):
    """Return the components whose rate does not depend on the state, such as time."""
    return {*range(D)} - {*indices[0, indices[1] < D].tolist()}


def _sums_over_terms(indices, D, n, values, x, v):
    """Return sums over the terms of n components of a field; None where there are none."""
    [of_state] = np.nonzero(indices[0] < n)
    terms = Matrix(indices[:, of_state], D, values, x, [v[k] for k in of_state.tolist()])
    return [terms.right_side(k) for k in range(n)]


class Beginning:
    """The operations before the first step: its length.

    Values are given in this order: the state x, of n components, with the words after it (D); the
    values v of the terms (T); the last time, and rtol. Without `indices` the components of f(x) (n)
    take the place of v.

    inputs    how many values are given
    results   numbers of x (NaN where f(x) has no value), the largest moduli (n each), the length,
              and the first length of `Choice`
    """

    def __init__(self, indices, D, n):
        T = n if indices is None else indices.shape[1]
        last, rtol = D + T, D + T + 1
        values = Values(D + T + 2, ())
        emit, joined = values.emit, values.joined
        f = v = range(D, D + T)
        if indices is not None:
            f = _sums_over_terms(indices, D, n, values, range(D), v)
        moduli = [emit("fabs", k) for k in range(n)]
        size = joined("max", moduli)
        rate = joined("max", [0.0, *(emit("fabs", change) for change in f if change is not None)])
        numbers = [*moduli, *(emit("fabs", change) for change in f if change is not None)]
        finite = joined("and", [emit("olt", number, np.inf) for number in numbers])
        part = rtol
        for _ in range(3):
            part = emit("sqrt", part)
        part = emit("min", emit("fmul", FIRST_PART, part), 1.0)
        length = emit("min", emit("fmul", part, emit("fdiv", size, rate)), last)
        moves = emit("and", emit("ogt", rate, 0.0), emit("ogt", size, 0.0))
        length = emit("select", finite, emit("select", moves, length, last), 0.0)
        states = [emit("select", finite, k, np.nan) for k in range(n)]
        self.results = [*states, *moduli, length, emit("fmul", SMALLEST_FIRST, length)]
        self.inputs, self.operations = D + T + 2, values.operations


class _OfTime(NamedTuple):
    """Values of `Choice` after those of the terms."""

    t: int
    wanted: int  # length
    longer: int  # its largest factor
    steps: int  # since the last time that was asked for
    taken: int  # length
    first: int  # length
    least: int  # pivot
    end: int  # the next time
    rtol: int


class Choice:
    """The operations at the end of a step: the next state, time and length.

    Values are given in this order: the state x, of n components, with the words after it (D);
    x_next - x before d is subtracted, the same without the shortest column, d, and the largest
    moduli so far (n each); the values v of the terms (T); those of `_OfTime`; with a `lift`, the
    words after x at the end of the last column (D - n) and the coefficients of the lift. `signs`
    has the components that keep their signs, `even` those with constant rates. Without `indices`
    the sums |terms of f_i| (n) take the place of v.

    inputs    how many values are given
    results   numbers of the next state and the largest moduli (n each), t, the length, its factor,
              and the steps
    """

    def __init__(self, indices, D, n, signs, even=(), lift=None):
        T = n if indices is None else indices.shape[1]
        first_value, first_word = D + 4 * n, D + 4 * n + T + len(_OfTime._fields)
        more = D - n + lift.coefficients if lift else 0
        self.values = Values(first_word + more, ())
        self.emit, self.joined = self.values.emit, self.values.joined
        self.indices, self.D, self.n, self.lift = indices, D, n, lift
        self.x, rows = range(D), [range(k, k + n) for k in range(D, first_value, n)]
        self.total, self.second, self.difference, self.largest = rows
        self.terms = range(first_value, first_value + T)
        self.of = _OfTime(*range(first_value + T, first_word))
        self.words = range(first_word, first_word + D - n)

        changes = self._changes()
        after = self._next_state(changes)
        after, is_resolved = self._with_signs(after, changes, signs)
        sizes, allowed = self._allowed(after, changes, even)
        if lift is not None:
            is_resolved += self._agreement(after, changes, allowed, even)
        is_resolved = self.joined("and", is_resolved)
        good, factor = self._judged(after, allowed, is_resolved)
        self._go_on(after, sizes, good, factor)
        self.inputs, self.operations = first_word + more, self.values.operations
        if lift is not None:  # derivatives of words have no use here
            self.operations = needed_for(self.results, self.operations)

    def _changes(self):
        """Return h sum |terms of f_i(x)|, by component."""
        emit, sums = self.emit, self.terms
        if self.indices is not None:
            x, v = [emit("fabs", k) for k in self.x], [emit("fabs", k) for k in self.terms]
            sums = _sums_over_terms(self.indices, self.D, self.n, self.values, x, v)
        return {
            k: emit("fmul", self.of.taken, sums[k]) for k in range(self.n) if sums[k] is not None
        }

    def _next_state(self, changes):
        """Return the next state, with d subtracted where a mode decays fast."""
        emit, n, of_fast = self.emit, range(self.n), []
        after = [emit("fadd", self.x[k], self.total[k]) for k in n]
        for k, change in changes.items():
            size = emit("max", emit("fabs", self.x[k]), emit("fabs", after[k]))
            of_fast.append(emit("ogt", change, emit("fmul", FAST, size)))
        if not of_fast or self.n < self.D:
            return after
        is_fast = self.joined("or", of_fast)
        slow = [emit("fsub", after[k], self.difference[k]) for k in n]
        return [emit("select", is_fast, slow[k], after[k]) for k in n]

    def _with_signs(self, after, changes, signs):
        """Return the next state with the signs that rounding changed, and what has to be true."""
        emit, after = self.emit, [*after]
        is_resolved = [emit("ogt", self.of.least, LEAST_PIVOT)]
        for k in sorted(signs):
            other = emit("fsub", 0.0, after[k])
            is_kept = emit("oge", self.x[k], 0.0)
            is_kept = emit("oge", emit("select", is_kept, after[k], other), 0.0)
            after[k] = emit("select", is_kept, after[k], other)
            if k in changes:
                rounding = emit("fmul", OF_ROUNDING, changes[k])
                is_kept = emit("or", is_kept, emit("oge", rounding, emit("fabs", after[k])))
            is_resolved.append(is_kept)
        return after, is_resolved

    def _allowed(self, after, changes, even):
        """Return the largest |x_i| so far, and how large errors may be."""
        emit = self.emit
        sizes = [
            emit("max", emit("fabs", now), so_far)
            for now, so_far in zip(after, self.largest, strict=True)
        ]
        others = [changes.get(k, 0.0) if k in even else sizes[k] for k in range(self.n)]
        floor = emit("fmul", SMALLEST, self.joined("max", others))
        allowed = [emit("fmul", self.of.rtol, emit("max", size, floor)) for size in sizes]
        allowed = [emit("max", each, OF_SUBNORMAL) for each in allowed]
        for k, change in changes.items():
            allowed[k] = emit("max", emit("fmul", OF_ROUNDING, change), allowed[k])
        return sizes, allowed

    def _agreement(self, after, changes, allowed, even):
        """Return truth values: whether words at the end of the step are those of its state."""
        emit, joined, lift = self.emit, self.joined, self.lift
        before, at_end = (
            Variables(self.values, lift, self.words.stop, state)
            for state in (self.x[: self.n], after)
        )
        is_kept = follows(self.indices, self.values, even, before, at_end)
        own, near = compared(self.values, at_end, lift, self.words)
        if not near:
            return is_kept
        f, of_words = (
            _sums_over_terms(self.indices, self.D, self.n, self.values, [*after, *each], self.terms)
            for each in (own, self.words)
        )
        apart = {k: emit("fabs", emit("fsub", f[k], of_words[k])) for k in changes}
        small = [emit("oge", allowed[k], emit("fmul", self.of.taken, apart[k])) for k in changes]
        return [*is_kept, emit("or", joined("and", near), joined("and", small))]

    def _judged(self, after, allowed, is_resolved):
        """Return whether the step is taken, and the factor of the next length."""
        emit, joined, ratios, errors = self.emit, self.joined, [], []
        part = 1.0 if self.n < self.D else OF_FAST
        for k in range(self.n):
            fast = emit("fmul", part, emit("fabs", self.difference[k]))
            distance = emit("fabs", emit("fsub", self.total[k], self.second[k]))
            errors.append(emit("fadd", distance, fast))
            ratio = emit("fdiv", errors[k], allowed[k])
            ratios.append(emit("select", emit("oeq", errors[k], 0.0), 0.0, ratio))
        rho = joined("max", ratios)
        numbers = [emit("fabs", now) for now in after] + errors
        finite = joined("and", [emit("olt", number, np.inf) for number in numbers])
        good = joined("and", [finite, emit("oge", 1.0, rho), is_resolved])
        root = emit("select", finite, rho, 1e30)
        for _ in range(3):
            root = emit("sqrt", root)
        factor = emit("max", emit("fdiv", SAFETY, root), SHORTER)
        factor = emit("min", factor, self.of.longer)
        return good, emit("select", is_resolved, factor, emit("min", factor, REFUSED))

    def _go_on(self, after, sizes, good, factor):
        """Choose the next length, and whether the trajectory ends; make `results`."""
        emit, of = self.emit, self.of
        length = emit("fmul", of.taken, factor)
        # A step that was cut at the end of time says nothing against the length wanted, and one of
        # length 0 nothing at all, even if f has no value at x.
        is_nothing = emit("oeq", of.taken, 0.0)
        is_cut = emit("or", good, is_nothing)
        is_cut = emit("and", is_cut, emit("olt", of.taken, of.wanted))
        length = emit("select", is_cut, of.wanted, length)
        arrives = emit("oeq", of.taken, emit("fsub", of.end, of.t))
        later = emit("select", arrives, of.end, emit("fadd", of.t, of.taken))
        later = emit("select", good, later, of.t)
        limit = emit("fmul", SHORTEST, emit("max", later, of.first))
        steps = emit("select", is_nothing, of.steps, emit("fadd", of.steps, 1.0))
        steps = emit("select", emit("and", good, arrives), 0.0, steps)
        ended = emit("or", emit("olt", length, limit), emit("oge", steps, float(MOST_STEPS)))
        states = [emit("select", good, after[k], self.x[k]) for k in range(self.n)]
        states = [emit("select", ended, np.nan, state) for state in states]
        moduli = [emit("select", good, sizes[k], self.largest[k]) for k in range(self.n)]
        longer = emit("select", good, LONGER, AFTER_REFUSED)
        longer = emit("select", is_nothing, of.longer, longer)
        length = emit("select", ended, 0.0, length)
        self.results = [*states, *moduli, later, length, longer, steps]
