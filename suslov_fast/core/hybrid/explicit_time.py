"""Right-hand sides with clocks that count from the start; the start of each is a new parameter.

A clock is c = c0 + e with the elapsed time e. At c0 = 1.7e9, a date in seconds, c is rounded to
2e-7, and f(c) would be a staircase. So each sum of clocks and of values that are constant along a
step is a pair p + q: p is 0 at e = 0, and q is constant. For example t - t1 is e + (c0 - t1), with
all its digits; t >= t1 is e >= t1 - c0; and knots of tables are shifted by c0. Whole turns are
removed from large phases q.
"""

import math
from typing import NamedTuple

from ..expressions.function_records import same
from ..expressions.numpy_evaluation import OF_TRUTH_VALUES
from ..expressions.programs import Expressions, emitted, needed_for, program_of
from ..expressions.tables import is_table
from .event_formulas import EventAction, components_of
from .tolerances import LARGE_PHASE

_COMPARISONS = "olt", "ogt", "oge", "oeq"


class _Pair(NamedTuple):
    """Operands of a value p + q: p is 0 at the start, and q is constant along a step.

    `whole` is one operand for p + q if it has more digits than the sum, else None.
    """

    p: object
    q: object
    whole: object = None


class ElapsedTime:
    """A right-hand side rewritten for clocks that count from 0, so that late dates cost no digits.

    A clock is a component of constant rate that no action sets. `values`, `results`, `P` and
    `actions` replace the given ones.

    offsets  {clock: number of the parameter that is its start}
    shifts   {number of a value: (p, q)} for values of tables at arguments p + q (`_Pair`)
    """

    def __init__(self, values, results, P, actions=(), invariants=()):
        self.values, self.results, self.P, self.actions = values, results, P, actions
        self.invariants = [*invariants]
        self.offsets, self.shifts = {}, {}
        changed = {i for action in actions for i in components_of(action)}
        rates = [a != 0.0 if isinstance(a, float) else a in values.fixed for a in results]
        clocks = [i for i, is_rate in enumerate(rates) if is_rate and i not in changed]
        if not clocks:
            return
        of_actions = [[each and emitted(values, each) for each in action[:2]] for action in actions]
        wanted = [
            *results,
            *invariants,
            *(a for pair in of_actions for own in pair for a in own or ()),
        ]
        self._shift(needed_for(values.operations, wanted), clocks)
        self.invariants = [self._whole(a) for a in invariants]
        self.actions = [self._act(*each) for each in zip(actions, of_actions, strict=True)]

    def _act(self, action, results):
        """Rewrite an `EventAction`; `results` are old operands of its surface and its new state."""
        surface, to = results
        surface = surface and [self._whole(a) for a in surface]
        # An unchanged clock counts from 0 after the event, too, as the clocks in the state do.
        to = to and [
            a if a == i and i in self.offsets else self._whole(a) for i, a in enumerate(to)
        ]
        new = (of and program_of(self.values.operations, of) for of in (surface, to))
        return EventAction(*new, *action[2:])

    def _shift(self, operations, clocks):
        """Rewrite `operations` for `clocks` that count from 0; their starts become parameters."""
        D = len(self.results)
        first, old = D + self.P, self.values
        self.P += len(clocks)
        self.values = new = Expressions(D + self.P, range(D, D + self.P))
        self.offsets = {i: first + k for k, i in enumerate(clocks)}
        self.known = {a: a for a in range(first)} | {
            i: _Pair(i, offset) for i, offset in self.offsets.items()
        }
        # Values that are constant along a step. `floor` and truth values are branches, so constant.
        self.rigid = {a for a in old.fixed if a < first}
        for name, number, operands in operations:
            is_choice = name == "floor" or name in OF_TRUTH_VALUES
            if is_choice or all(self._is_rigid(a) for a in operands):
                self.rigid.add(number)
            self.known[number] = self._value(name, operands)
        named = [a for _, operands, *_ in old.written.values() for a in operands] + [*old.written]
        named = {a for a in named if type(a) is int and a in self.known and a not in self.offsets}
        written = {a: self._whole(a) for a in named}
        self.results = [self._whole(a) for a in self.results]
        new.take_written(old, written)

    def _is_rigid(self, a):
        return isinstance(a, float) or a in self.rigid

    def _pair(self, old):
        """Return the operand `old` as a `_Pair` p + q, or None if it is no sum of this kind."""
        new = None if isinstance(old, float) else self.known[old]
        if isinstance(new, _Pair):
            return new
        return _Pair(0.0, self._whole(old)) if self._is_rigid(old) else None

    def _whole(self, old):
        """Return the new operand of the operand `old`; for a pair p + q the operand of the sum."""
        new = old if isinstance(old, float) else self.known[old]
        if not isinstance(new, _Pair):
            return new
        if new.whole is not None:
            return new.whole
        return self.values.emit("fadd", new.q, new.p)

    def _value(self, name, operands):
        """Return the new operand, or the `_Pair`, of operation `name` on old `operands`."""
        emit, wholes = self.values.emit, [self._whole(a) for a in operands]
        is_sum = any(isinstance(self.known.get(a), _Pair) for a in operands if type(a) is int)
        pairs = [self._pair(a) for a in operands]
        if not is_sum:
            return emit(name, *wholes)
        if name in ("fadd", "fsub") and None not in pairs:
            a, b = pairs
            return _Pair(_sum(emit, name, a.p, b.p), emit(name, a.q, b.q))
        rigid = [self._is_rigid(a) for a in operands]
        is_scaled = (name == "fmul" and any(rigid)) or (name == "fdiv" and rigid[1])
        if is_scaled and None not in pairs:
            a, b = pairs
            p = [x.q if same(x.p, 0.0) else x.p for x in pairs]
            offsets = self.offsets.values()
            is_plain = any(x.q in offsets and x.whole is None for x in (a, b) if not same(x.p, 0.0))
            whole = None if is_plain else emit(name, *wholes)
            return _Pair(emit(name, *p), emit(name, a.q, b.q), whole)
        if name in _COMPARISONS and None not in pairs:
            a, b = pairs
            if None is a.whole is b.whole:
                return emit(name, _sum(emit, "fsub", a.p, b.p), emit("fsub", b.q, a.q))
        if name in ("sin", "cos", "tan") and pairs[0].whole is None:
            return emit(name, emit("fadd", self._without_turns(pairs[0].q), pairs[0].p))
        number = emit(name, *wholes)
        if is_table(name) and pairs[0].whole is None:
            self.shifts[number] = pairs[0][:2]
        return number

    def _without_turns(self, q):
        """Return the operand q of a phase, less whole turns of 2 pi if q is large."""
        q, turn = self.values.number(q), 2.0 * math.pi
        rest = q - turn * (1.0 / turn * q).then("floor")
        return (abs(q) > LARGE_PHASE).select(rest, q).number


def _sum(emit, name, a, b):
    """Return the operand of a + b (`name` "fadd") or a - b ("fsub"); a constant 0 is left out."""
    if same(b, 0.0):
        return a
    if same(a, 0.0):
        return b if name == "fadd" else emit("fmul", -1.0, b)
    return emit(name, a, b)
