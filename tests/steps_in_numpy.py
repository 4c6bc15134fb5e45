"""The steps of the motion in NumPy: a second opinion on their machine code, with the same bits.

All lanes of all lines are columns of the arrays. It shares the rules, the tables of columns and the
lists of operations with the code, and has a program of control of its own. It covers both halves,
choices, kinks, clocks, variational equations and dense fields. It does not cover changes of the
state and crossings that are recorded: closed forms and matrix exponentials judge those.
"""

import itertools
from functools import singledispatch
from types import SimpleNamespace

import numpy as np

from suslov_fast.core.code.sparse_code import add_factors
from suslov_fast.core.lists.hidden import MIDDLE, POINTS
from suslov_fast.core.lists.sparse import Head
from suslov_fast.core.lists.step import evaluate
from suslov_fast.core.lists.tables import is_table
from suslov_fast.core.motion import (
    choosing,
    engine,
    errors,
    functions,
    implicit,
    inside,
    lengths,
    second_trial,
    step,
    surfaces,
)
from suslov_fast.core.motion.arguments import COMPONENT, NUMBER, Component, Numbers
from suslov_fast.core.motion.choosing import shift_of
from suslov_fast.core.motion.columns import (
    EXPLICIT,
    IMPLICIT,
    QUARTERS,
    weights,
    weights_of_errors,
)
from suslov_fast.core.motion.rows import State
from suslov_fast.engine import motions


def of_list(list_, rows):
    """Return the results (-, ...) of a list for its inputs (-, ...)."""
    values = dict(enumerate(rows))
    evaluate(list_.operations, values)
    shape = np.shape(rows[0])
    return np.array([np.full(shape, a) if isinstance(a, float) else values[a]
                     for a in list_.results])  # fmt: skip


def _applied(rule, **inputs):
    """Return the results of a rule by name, for numbers or arrays."""
    values = {k: inputs[name] for k, name in enumerate(rule.inputs)}
    evaluate(rule.operations, values)
    return {name: a if isinstance(a, float) else values[a] for name, a in rule.results.items()}


def _interval_of(table, x, shift):
    """Return the rows (4, ...) of the intervals that hold arguments x + shift.

    Their knots are less by the shift, because x has digits that the sum has not.
    """
    place = np.searchsorted(table.rows[0, 1:], x + shift, "right")
    place = place - (x < table.rows[0, place] - shift)
    rows = table.rows[:, place + (x >= table.rows[1, place] - shift)]
    rows[:2] -= shift
    return rows


@singledispatch
def carried_out(function, rows):
    """Return the results (-, ...) of a function of a half, for rows (-, ...) without a table."""
    return of_list(function.list_, rows)


@carried_out.register
def _sparse(function: functions.SparseLoops, rows):
    is_factors = function.add_function is add_factors
    return (_sparse_factors if is_factors else _sparse_solution)(function.plan, rows)


def _sparse_factors(plan, rows):
    """Return the factors for entries of J and s."""
    *entries, s = rows
    D, entries, first = len(plan.order), np.array(entries), len(plan.order) + len(plan.lower)
    factors, w = np.zeros((D + plan.size, *np.shape(s))), np.zeros((D, *np.shape(s)))

    def parts(j):
        """Return the rows of column j in L and U, and where their numbers begin."""
        own, after = (Head(*head) for head in plan.heads[j : j + 2].tolist())
        for begin, end, number in (
            (own.lower, after.spans, D + own.of_lower),
            (own.spans, own.lower, first + own.of_upper),
        ):
            rows = [range(k, k + n) for k, n in plan.spans[begin:end].tolist()]
            rows = np.array([*itertools.chain(*rows)], int)
            yield rows, slice(number, number + len(rows))

    for j in range(D):
        (lower, of_lower), (upper, of_upper) = parts(j)
        own, after = (Head(*head) for head in plan.heads[j : j + 2].tolist())
        w[upper] = w[lower] = w[j] = 0.0
        given = slice(own.entries, after.entries)
        w[plan.rows[given]] = 0.0 - s * entries[plan.numbers[given]]
        w[j] = 1.0 + w[j]
        for pivot in plan.pivots[own.pivots : after.pivots]:
            for k in range(pivot // 2, pivot // 2 + pivot % 2 + 1):
                (below, numbers), _ = parts(k)
                w[below] = w[below] - factors[numbers] * w[k]
        factors[j] = 1.0 / w[j]
        factors[of_upper], factors[of_lower] = w[upper] * factors[upper], w[lower] * factors[j]
    return factors


def _sparse_solution(plan, rows):
    D, size = len(plan.order), len(plan.lower)
    v = np.array(rows[D + plan.size :])
    for (i, j), number in zip(plan.lower, rows[D : D + size], strict=True):
        v[i] = v[i] - number * v[j]
    v[plan.order] = v[plan.order] * np.array(rows[:D])
    upper = rows[D + size : D + plan.size]
    for (i, j), number in zip(plan.upper[::-1], upper[::-1], strict=True):
        v[i] = v[i] - number * v[j]
    return v


@carried_out.register
def _dense_product(function: functions.DenseProduct, rows):
    D, totals = function.D, []
    for i in range(D):
        total = 0.0
        for j in range(D):
            total = total + rows[i * D + j] * rows[D * D + 1 + j]
        totals.append(total)
    return np.array(totals)


def derivative_entries(f, x, table):
    """Return the entries of f' that the implicit half has, at states (D, ...)."""
    slopes = f.jacobian(x, table)
    return np.array([slopes[place] for place in f.pattern])


class StepsInNumPy:
    """Steps of one half of trajectories (count, rows)."""

    def __init__(self, half, motion, trajectories, table):
        self.half, self.motion, self.f = half, motion, half.f
        self.rows, self.D = half.rows, half.f.D
        self.extended = self.D + len(half.f.denominators)
        self.lanes, self.given = trajectories.T, np.atleast_2d(table)  # rows of all lanes
        self.table = np.atleast_2d(table)[:, : len(half.f.table)].T.copy()
        self.columns = IMPLICIT if half.is_implicit else EXPLICIT
        self.p = 1 if half.is_implicit else 2
        self.mode = float(State.IMPLICIT if half.is_implicit else State.EXPLICIT)
        self.own = weights(self.columns, self.p)
        factor = errors.CAUTION if half.sets else 1.0
        self.of_error = [factor * w for w in weights_of_errors(self.columns, self.p)]

    def take(self):
        """Take a step of all trajectories; return whether none was in this half."""
        with np.errstate(all="ignore"):
            if (self.row("state") < 0.0).any():
                self._begin()
            own = {"second": np.inf} if self.half.is_implicit else {}
            length = self._apply(lengths.LENGTH, mode=self.mode, **self._apply(lengths.NEAR), **own)
            if is_taken := (length["taken"] > 0.0).any():
                self._step(**length)
        if self.f.conditions:
            self.given[:, : len(self.table)] = self.table.T
        return not is_taken

    def row(self, name):
        """Return the row of a line with this name."""
        return self.lanes[getattr(self.rows, name)]

    def _rows(self, name, count):
        first = getattr(self.rows, name)
        return self.lanes[first : first + count]

    def _apply(self, rule, **inputs):
        """Carry out a rule; inputs that are not given are rows of the line and numbers."""
        for name in {*rule.inputs} - {*inputs}:
            if name in Numbers._fields:
                inputs[name] = self.motion.numbers[getattr(NUMBER, name)]
            else:
                inputs[name] = self.row(name)
        found, shape = _applied(rule, **inputs), self.lanes.shape[1:]
        return {name: np.broadcast_to(a, shape).copy() for name, a in found.items()}

    def _fold(self, rule, sums=None, components=None, **inputs):
        """Carry out a rule for components in turn, of which arrays (D, lanes) have a row each.

        Return sums over them, and what else it finds of each.
        """
        sums, others = dict(sums or {}), {}
        for i in range(self.D) if components is None else components:
            given = {name: inputs[name] for name in rule.inputs if name in inputs}
            own = {name: a[i] if np.ndim(a) > 1 else a for name, a in given.items()} | sums
            for name in {*rule.inputs} & {*Component._fields}:
                own.setdefault(name, self.motion.components[getattr(COMPONENT, name), i])
            for name, a in self._apply(rule, **own).items():
                if name in sums:
                    sums[name] = a
                else:
                    others.setdefault(name, []).append(a)
        return sums, {name: np.array(a) for name, a in others.items()}

    def _keep(self, found):
        for name, value in found.items():
            self.row(name)[:] = value

    def _value(self, x):
        """Return f, and the denominators of clocks, at states (D, lanes)."""
        return self.f.value_and_denominators(x, self.table)

    def _begin(self):
        x = self._rows("x", self.D)
        if self.f.conditions:
            self._make_choices(x, self.row("state") < 0.0)
        self._rows("f", self.extended)[:] = f = self._value(x)
        self._rows("largest", self.D)[:], self._rows("mode", self.D)[:] = abs(x), 1.0
        sums = dict.fromkeys(("size", "rate", "total"), 0.0)
        sums, _ = self._fold(lengths.BEGIN_COMPONENT, sums, x=x, f=f)
        found = self._apply(lengths.BEGIN, **sums)
        self._keep(found)

    # ------------------------------------------------------------------------------------- columns
    def _ends(self, x, f, signed, count):
        """Return y_c - x at the ends of the first columns; the last y_N and f there are kept."""
        column = self._implicit_column if self.half.is_implicit else self._explicit_column
        self.apart = [] if not self.half.is_implicit else np.zeros_like(x)
        self.quarters = np.zeros((3, *x.shape))
        return [column(x, f, signed * (1.0 / N), N) for N in self.columns[:count]]

    def _explicit_column(self, x, f, s, N):
        a, b, double = x, x + s * f[: self.D], s + s
        for m in range(1, N // 2 + 1):
            a = a + double * self._value(b)[: self.D]
            self.f_last = self._value(a)[: self.D]
            b = b + (s if m == N // 2 else double) * self.f_last
        end, apart = (a + b) * 0.5, a - b
        if sets := self.half.sets:  # Störmer's rule is half of it
            f_of_b, (A, B) = self._value(b)[: self.D], (np.array(own, int) for own in sets)
            a[B], self.f_last[A] = b[B], f_of_b[A]
            is_rough = self.row("rough") >= lengths.ROUGH
            end, apart = np.where(is_rough, end, a), np.where(is_rough, apart, 0.0)
        self.last = a
        self.apart.append(apart)
        return end - x

    def _implicit_column(self, x, f, s, N):
        factors = carried_out(self.half.functions["factor"], [*self.entries, s])
        change = self._solve(factors, s * f[: self.D])
        weight = N * self.own[self.columns.index(N)]
        of_quarter = dict(zip(QUARTERS, weights(QUARTERS, 1), strict=True)).get(N, 0.0)
        for m in range(N - 1):
            if of_quarter and 4 * (m + 1) % N == 0:
                self.quarters[4 * (m + 1) // N - 1] += of_quarter * change
            right = s * self._value(x + change)[: self.D]
            if m == 0:
                self.apart = self.apart + weight * (right - change)
            last = self._solve(factors, right)
            change = change + last
        self.apart, self.factors = self.apart + weight * 0.5 * last, factors
        return change

    def _solve(self, factors, right):
        return carried_out(self.half.functions["solve"], [*factors, *right])

    def _surfaces(self, x):
        """Return the values of the surfaces at states (watched, lanes)."""
        f, values = self.f, dict(enumerate(x))
        values |= {number: self.table[place] for number, place in self.half.block.places.items()}
        evaluate(f.watched.operations, values)
        found = [a if isinstance(a, float) else values[a] for a in f.watched.results]
        return np.array([np.broadcast_to(a, x.shape[1:]) for a in found])

    def _watch(self, before, after):
        """Return what `watch` finds between two points, from the values of surfaces there."""
        return of_list(self.f.watch, [*before, *after, *self.table])

    @staticmethod
    def _sum(factors, ends):
        total = factors[0] * ends[0]
        for factor, end in zip(factors[1:], ends[1:], strict=True):
            total = total + factor * end
        return total

    # ------------------------------------------------------------------------------------ one step
    def _step(self, taken, signed, aside):
        is_implicit, D = self.half.is_implicit, self.D
        x, f = self._rows("x", D).copy(), self._rows("f", self.extended).copy()
        if is_implicit:
            rate = self._derive(x)
        ends = self._ends(x, f, signed, len(self.columns))
        new, error = x + self._sum(self.own, ends), self._sum(self.of_error, ends)
        largest, kept = self._rows("largest", D), {"kept": 1.0}
        if self.f.clocks:
            new = self._fold(step.CLOCK, x=x, new=new, f=f, signed=signed)[1]["new"]
        if self.f.of_one_sign:
            own = {"x": x, "new": new, "size": abs(x) if self.half.has_atol else largest}
            kept, found = self._fold(step.KEPT, kept, **own)
            new = found["new"]
        f_new = self._value(new)
        for k in range(D, self.extended):
            kept = self._apply(step.SAME_SIGN, x=f[k], new=f_new[k], **kept)
        if is_implicit:
            apart = self._solve(self.factors, self.apart - signed * 0.5 * f_new[:D])
        else:
            apart = self._sum(self.own, self.apart)
        noise = self._sum([abs(w) for w in self.own], [abs(end) for end in ends])
        own = {"x": x, "new": new, "error": error, "largest": largest, "noise": noise}
        own |= {"f_new": f_new, "taken": taken, "inverse": (inverse := np.empty_like(x))}
        sizes = dict.fromkeys(self.half.largest.results, 0.0)
        large, is_rounding = {} if self.half.has_atol else {"large": 0.0}, {}
        for k, (first, count) in enumerate(self.half.parts):
            part = range(first, first + count)
            sizes, _ = self._fold(self.half.largest, sizes, part, **own)
            if sizes:
                smallest = errors.SMALLEST_OF_COLUMNS if k else errors.SMALLEST
                is_rounding = self._apply(errors.LEAST_ALLOWED, smallest=smallest, **sizes)
            found = self._fold(self.half.allowed, None, part, **own, **sizes, **is_rounding)
            inverse[first : first + count] = found[1]["inverse"]
            if sizes:
                large, _ = self._fold(errors.LARGE, large, part, **own, **is_rounding)
        sums = large | self._fold(errors.RATIO, {"ratio": 0.0, "total": 0.0}, **own)[0]
        of_apart = {"error": apart, "inverse": inverse}
        sums["apart"] = self._fold(errors.LARGER_RATIO, {"ratio": 0.0}, **of_apart)[0]["ratio"]
        zero = {"rates": 0.0, "states": 0.0}
        if not is_implicit:
            own |= {"last": self.last, "f_last": self.f_last}
            of_sets = [self._fold(errors.DIFFERENCES, zero, components, **own)[0]
                       for components in (self.half.sets or (range(D),))]  # fmt: skip
            sums |= of_sets[0]
        if self.half.sets:
            sums |= {name: of_sets[0][name] * of_sets[1][name] for name in zero}
            sums["limit"] = self.motion.numbers[NUMBER.limit] ** 2
        sums |= {"on_trial": 0.0, "of_length": sums["ratio"]}
        sums |= self._second_trial(sums, own | {"f": f, "apart": apart})
        sums |= {"taken": taken, "aside": aside, **kept}
        before = self.row("t").copy()
        near = self._apply(lengths.NEAR)
        found = self._apply(lengths.AFTER, **near, **sums)
        sums["accepted"] = accepted = found.pop("accepted")
        served = found.pop("served")
        self._keep(found)
        if self.half.sets:
            of_step = {"taken": taken, "accepted": accepted, "served": served}
            of_step["ratio"] = sums["ratio"]
            self._keep(self._apply(lengths.REFUSALS, **of_step))
        if is_implicit:
            sums["rate"] = rate
        rule = lengths.TURN_IMPLICIT if is_implicit else lengths.TURN_EXPLICIT
        self._keep(self._apply(rule, **near, **sums))
        if self.half.watched:
            own = {"before": before, "accepted": accepted, "total": sums["total"]}
            found, kinks = self._cut((x, new, f, f_new), taken, signed, served=served, **own)
            at_surface, accepted = found.pop("at_surface"), found.pop("accepted")
            jumped = found.pop("jumped")
            served = found.pop("served")
            self._keep(found)
        for lane in np.flatnonzero(served > 0.0):
            self._save(lane, new[:, lane])
        passed = SimpleNamespace(
            before=before, taken=taken, x=x, f=f, new=new, f_new=f_new, inverse=inverse, ends=ends,
            accepted=accepted,
        )  # fmt: skip
        self._save_inside(passed)
        is_taken = passed.accepted > 0.0
        if self.half.kinks:
            first = self.f.conditions.P + self.f.conditions.jumps
            self._put_choices(is_taken & (at_surface > 0.0), self.half.kinks, kinks, first)
            f_new = self._value(new)
        if self.half.low:
            self._watch_small(is_taken, new, f_new, inverse)
        if self.f.conditions:
            new, f_new, is_taken = self._renew(
                is_taken, jumped > 0.0, taken > 0.0, (x, f, new, f_new)
            )
        self._rows("x", D)[:] = np.where(is_taken, new, x)
        self._rows("f", self.extended)[:] = np.where(is_taken, f_new, f)
        modulus = abs(new)
        largest[:] = np.where(is_taken & (modulus > largest), modulus, largest)

    def _watch_small(self, is_taken, new, f_new, inverse):
        low, components = self._rows("low", self.half.low), range(self.half.low)
        own = {"new": new, "largest": self._rows("largest", self.D), "low": low}
        own |= {"f_new": f_new, "inverse": inverse}
        sums, found = self._fold(errors.LOW, {"watches": 0.0}, components, **own)
        low[:], watches = np.where(is_taken, found["low"], low), sums["watches"]
        self.row("watches")[:] = np.where(is_taken, watches, self.row("watches"))

    def _second_trial(self, sums, line):
        """Return what a second trial changes in the sums over components; `inverse` changes."""
        again = self.row("longer") <= lengths.AFTER_TRIAL
        refused = (sums["ratio"] > 1.0) | (sums["apart"] > lengths.MOST_APART)
        is_finite = sums["total"] < np.inf
        refused = tried = refused & is_finite & again
        if not self.half.has_atol:
            is_noisy = self._apply(second_trial.IS_NOISY, **sums)["is_noisy"]
            tried = refused | (is_noisy > 0.0) & is_finite
        if not tried.any():
            return {}
        top = self._fold(second_trial.TOP, {"top": 0.0}, **line)[0]["top"]
        noisy = errors.NOISY * top
        large = self._fold(errors.LARGE, {"large": 0.0}, noisy=noisy, **line)[0]["large"]
        is_noise = tried & (large < sums["ratio"])
        zero, inverse = np.zeros_like(line["x"]), line["inverse"]
        found = {"least": zero + np.inf, "largest": zero, "second": zero}
        for u, is_end in zip(second_trial.ALONG, second_trial.ENDS, strict=True):
            state = self._fold(second_trial.ON_LINE, u=u, **line)[1]["point"]
            base, most = self._value(state), zero
            for part, first in zip(second_trial.BESIDES, second_trial.FIRST, strict=True):
                own = {"state": state, "part": part, "is_end": is_end}
                beside = self._fold(second_trial.BESIDE, **own, **line)[1]["beside"]
                change = (self._value(beside) - base)[: self.D]
                if self.half.is_implicit:
                    change = self._solve(self.factors, change)
                change = np.where(is_noise | (is_end * first > 0.0), change, 0.0)
                most = np.fmax(abs(change), most)
            found = self._fold(second_trial.BESIDE_POINTS, is_end=is_end, most=most, **found)[1]
        trial = {"ratio": 0.0, "of_length": 0.0, "of_apart": 0.0}
        own = line | found | {"top": top, "grows": second_trial.GROWS[self.half.is_implicit]}
        trial, found = self._fold(second_trial.SECOND, trial, **own)
        inverse[:] = np.where(tried, found["inverse"], inverse)
        counts = refused | tried & (trial["of_length"] < sums["ratio"])
        pairs = zip(("ratio", "of_length", "apart"), trial.values(), strict=True)
        found = {name: np.where(counts, value, sums[name]) for name, value in pairs}
        if not self.half.is_implicit:
            found["rates"] = np.where(counts, 0.0, sums["rates"])
        return found | {"on_trial": np.where(counts, 1.0, 0.0)}

    def _cut(self, states, taken, signed, **found):
        """Return what changes in lanes whose step crosses a surface, or is on the way to one.

        The choices of kinks at the end of the step follow.
        """
        x, new, f, f_new = (each[: self.half.watched] for each in states)
        far, is_far = self._rows("far", self.half.watched), self.row("outer") == np.inf
        rule, rates = surfaces.POINT, {"signed": signed, "f": f, "f_new": f_new}
        if self.half.is_implicit:
            quarters = self.quarters[:, : len(x)]
            rates = {f"quarter{k}": own for k, own in enumerate(quarters, 1)}
            rule = surfaces.POINT_IMPLICIT
        elif self.half.reads_states:
            rule = surfaces.POINT_WITH_QUARTIC
            rates["quartic"] = self._quartic(states, signed)[: len(x)]
        points = [x]
        for u in POINTS[:-1]:
            point = _applied(rule, x=x, new=new, u=u, **rates)["point"]
            points.append(np.broadcast_to(point, x.shape))
        points.append(new)
        parts, ends = dict.fromkeys(("crossed", "place", "end"), 0.0), (0.0, *POINTS)
        values = [self._surfaces(point) for point in points]
        for k, u in enumerate(POINTS):
            part, crosses, *_ = self._watch(*values[k : k + 2])
            own = {"part": part, "crosses": crosses, "u": u, "width": u - ends[k], "taken": taken}
            parts = self._apply(surfaces.LOOK, **own, **parts)
            far[:] = np.where(is_far & (parts.pop("is_first") > 0.0), points[k + 1], far)
        found |= {"hidden": 0.0, "twice": 0.0, "known": np.inf, "starts": parts["crossed"]}
        found["goal"] = self.motion.numbers[NUMBER.last]
        if self.half.hidden:
            rtol = np.full(len(taken), self.motion.numbers[NUMBER.rtol])
            rows = [*np.concatenate(values), *points[MIDDLE], rtol, *self.table]
            found["hidden"], found["twice"] = of_list(self.half.hidden, rows)
            found["known"] = taken if self.half.has_waves else np.inf
        part, *_ = self._watch(values[-1], self._surfaces(far))
        whole_part, crosses, jumps, *kinks = self._watch(values[0], values[-1])
        if self.half.reads_states:
            found["starts"] = np.where(found["twice"] > 0.0, 1.0, crosses)
        inputs = {"whole_part": whole_part, "crosses": crosses, "jumps": jumps, "part": part}
        rates = self.motion.numbers[NUMBER.sign] * f_new
        aim, since = of_list(self.f.aim[self.half.is_implicit], [*new, *rates, *self.table])
        inputs |= {"aim": np.where(is_far, np.inf, taken + aim)}
        inputs |= {"since": np.where(is_far, 0.0, since)}
        found = self._apply(surfaces.CUT, taken=taken, mode=self.mode, **inputs, **parts, **found)
        far[:] = np.where(found.pop("beyond") > 0.0, new, far)
        return found, kinks

    def _quartic(self, states, signed):
        """Return what polynomials of degree 4 have in an explicit step beside cubics."""
        names = "x", "new", "f", "f_new"
        own = {name: each[: self.D] for name, each in zip(names, states, strict=True)}
        own["signed"] = signed
        point = _applied(surfaces.POINT, u=POINTS[0], **own)["point"]
        f_point = self._value(point)[: self.D]
        return _applied(surfaces.QUARTIC, f_point=f_point, **own)["quartic"]

    # ----------------------------------------------------------------------------------- choices
    def _choices_at(self, x):
        """Return what the list `choices` finds at states."""
        f, conditions = self.half.block, self.f.conditions
        given = conditions.P + conditions.jumps + conditions.kinks
        return of_list(f.choices, [*x[: f.D], *self.table[:given]])

    def _make_choices(self, x, truth):
        """Make all choices of lanes anew; return the number of the surface where f jumps."""
        f, conditions = self.half.block, self.f.conditions
        surface, _, *found = self._choices_at(x)
        self._put_choices(truth, conditions.kinds, found, conditions.P)
        given = conditions.P + conditions.jumps + conditions.kinks
        derived = of_list(f.derived, [*np.zeros((f.D, len(truth))), *self.table[:given]])
        for number, now in zip(f.derived.results, derived, strict=True):
            self.table[f.places[number]] = np.where(truth, now, self.table[f.places[number]])
        return surface

    def _put_choices(self, truth, kinds, found, place):
        first = len(self.f.conditions.kinds) - len(kinds)
        for k, (kind, a) in enumerate(zip(kinds, found, strict=True), first):
            rows = [a]
            if is_table(kind):
                shift = shift_of(self.half.block, k)
                rows = _interval_of(kind, a, 0.0 if shift is None else self.table[shift])
            for row in rows:
                self.table[place] = np.where(truth, row, self.table[place])
                place += 1

    def _choose(self, truth, new, f_new):
        """Return the state and f after jumps in these lanes."""
        f, table = self.half.block, self.table.copy()
        surface = self._make_choices(new, truth)
        after = self._value(new)
        if f is not self.f and (jumps := truth & (surface >= 0.0)).any():
            largest = self._rows("largest", self.D)
            largest[:] = np.where(jumps, np.maximum(largest, abs(new)), largest)
            moved = self._columns_after_jump(new, f_new, after, table, surface)
            new = np.where(jumps, moved, new)
            after = self._value(new)
        low = self._rows("low", self.half.low)
        own = {"low": low, "before": f_new, "after": after}
        found = self._fold(choosing.INFLOW, None, range(self.half.low), **own)[1]
        low[:] = np.where(truth, found["low"], low) if len(low) else low
        return new, after

    def _columns_after_jump(self, x, before, after, table, surface):
        whole, f, x = self.f, self.half.block, x.copy()
        D, q, values = f.D, whole.q, dict(enumerate(x[: f.D]))
        values |= {number: table[place] for number, place in f.places.items()}
        evaluate(f.slopes.operations, values)
        gradient = np.zeros((D + q, x.shape[1]))
        for (k, j), a in zip(f.slope_places, f.slopes.results, strict=True):
            slope = a if isinstance(a, float) else values[a]
            gradient[j] = np.where(surface == k, slope, gradient[j])
        ends = [0.0, 0.0]
        for slope, *rates in zip(gradient, before[:D], after[:D], strict=False):
            ends = [end + slope * rate for end, rate in zip(ends, rates, strict=True)]
        jump = after[:D] - before[:D]
        for c in range(whole.columns):
            column, n = x[D * (1 + c) : D * (2 + c)], c - (whole.columns - q)
            ds = gradient[D + n] * table[len(f.table) + n] if n >= 0 else 0.0
            for slope, a in zip(gradient, column, strict=False):
                ds = ds + slope * a
            column += np.where(jump == 0.0, 0.0, jump * (ds / ends[0]))
        if whole.has_trace:
            own = {"jumps": 1.0 * (jump != 0.0).any(axis=0), "u": x[-2]}
            x[-1] += self._apply(choosing.TRACE, before=ends[0], after=ends[1], **own)["change"]
        return x

    def _renew(self, accepted, jumped, taken, states):
        """Return the next states, f there, and where they are taken, after jumps of f."""
        *before, new, f_new = states
        jumped, mode = jumped & accepted, self.mode
        if jumped.any():
            moved, after = self._choose(jumped, new, f_new)
            new, f_new = np.where(jumped, moved, new), np.where(jumped, after, f_new)
            self._keep_in(jumped, self._apply(choosing.CHOSEN, acted=0.0, mode=mode))
            ahead = self._apply(choosing.LOOK_AHEAD, part=choosing.AHEAD)
            point = new + ahead["signed"] * f_new[: self.D]
            back = jumped & (self._choices_at(point)[0] >= 0.0)
            far = self._rows("far", self.half.watched)
            far[:] = np.where(back, point[: len(far)], far)
            self._keep_in(back, self._apply(choosing.SEEK, ahead=ahead["ahead"]))
        t = self.row("t")
        ended = (self.row("state") == State.ENDED) & taken
        ended = ended & ((t > self.row("chosen_at")) | (t == 0.0))
        if ended.any():
            return self._go_on(ended, accepted, before, new, f_new)
        return new, f_new, accepted

    def _keep_in(self, truth, found):
        for name, value in found.items():
            self.row(name)[:] = np.where(truth, value, self.row(name))

    def _go_on(self, ended, accepted, before, new, f_new):
        x = np.where(ended & ~accepted, before[0], new)
        f = np.where(ended & ~accepted, before[1], f_new)
        found = {"ahead": 0.0, "signed": 0.0}
        for part in (choosing.NEAREST, 8.0 * choosing.NEAREST, choosing.AHEAD):
            own = self._apply(choosing.LOOK_AHEAD, part=part)
            point = x + own["signed"] * f[: self.D]
            is_first = (found["ahead"] == 0.0) & (self._choices_at(point)[1] > 0.0)
            found = {name: np.where(is_first, own[name], a) for name, a in found.items()}
        ended, t = ended & (found["ahead"] > 0.0), self.row("t").copy()
        after = self._apply(choosing.GOES_ON, ahead=found["ahead"])
        is_saved = ended & (after.pop("slides") < 1.0)
        for lane in np.flatnonzero(is_saved):
            while self.row("next")[lane] <= t[lane] + found["ahead"][lane]:
                signed = self.motion.numbers[NUMBER.sign] * (self.row("next")[lane] - t[lane])
                self._save(lane, x[:, lane] + signed * f[: self.D, lane])
        self._keep_in(ended, after)
        x = np.where(ended, x + found["signed"] * f[: self.D], x)
        moved, rates = self._choose(ended, x, f)
        return np.where(ended, moved, x), np.where(ended, rates, f), accepted | ended

    def _derive(self, x):
        """Find the entries of f'; return its rate by a step of the power iteration."""
        largest, mode = self._rows("largest", self.D), self._rows("mode", self.D)
        entries = derivative_entries(self.f, x, self.table)
        self.entries = np.where(abs(entries) < np.inf, entries, 0.0)
        top = self._fold(implicit.SIZE, {"top": 0.0}, modulus=largest)[0]["top"]
        scales = self._fold(implicit.SCALE, largest=largest, top=top, mode=mode)[1]
        own = [*self.entries[: self.f.entries], np.zeros_like(top), *scales["scaled"]]
        products = carried_out(self.half.functions["power"], own)
        own = {"product": products, "scale": scales["scale"]}
        sums, found = self._fold(implicit.RATE, {"size": 0.0}, **own)
        size, product = sums["size"], found["product"]
        own = {"seed": self.motion.components[COMPONENT.seeds][:, np.newaxis]}
        mode[:] = self._fold(implicit.MODE, product=product, size=size, mode=mode, **own)[1]["mode"]
        return size

    # ----------------------------------------------------------------------------------- the times
    def _save_inside(self, passed):
        """Save the states at times that the step has passed."""
        if self._passed(passed, np.greater).any():
            nodes, signed = self._nodes(passed)
        while self._passed(passed, np.greater).any():
            of_step = {"t": passed.before, "taken": passed.taken}
            weights = self._apply(inside.BETWEEN, **of_step)
            states = passed.x + self._between(passed, nodes, signed, weights)
            states = self._with_signs(states, passed)
            for lane in np.flatnonzero(self._passed(passed, np.greater)):
                self._save(lane, states[:, lane])
        for lane in np.flatnonzero(self._passed(passed, np.equal)):
            self._save(lane, passed.new[:, lane])

    def _passed(self, passed, how):
        """Return which lanes have taken a step to their next time, or beyond it."""
        return (passed.accepted > 0.0) & how(self.row("t"), self.row("next"))

    def _save(self, lane, state):
        place, trajectory = (self.row(name).view(np.int64) for name in ("place", "trajectory"))
        self.motion.states[place[lane], trajectory[lane]] = state
        place[lane] += 1
        following = self.motion.times[place[lane] :]
        self.row("next")[lane], self.row("second")[lane] = following[:2]
        self.row("tries")[lane] = 0.0

    def _nodes(self, passed):
        """Return states and rates at the ends of quarters, and their length; refuse steps."""
        of_step, D = {"t": passed.before, "taken": passed.taken}, self.D
        own = {"after": self.row("t"), "accepted": passed.accepted}
        signed = self._apply(inside.QUARTER, **of_step, **own)["signed"]
        few, more = inside.WEIGHTS
        own = {"error": self._sum(few - self.own, passed.ends), "inverse": passed.inverse}
        ratio = self._fold(errors.LARGER_RATIO, {"ratio": 0.0}, **own)[0]["ratio"]
        needs, x, f, nodes = ratio > inside.OF_FEW, passed.x, passed.f[:D], []
        for _ in range(3):
            ends = self._ends(x, f, signed, inside.FEW + 1)
            ends[inside.FEW] = np.where(needs, ends[inside.FEW], 0.0)
            factors = np.where(needs, more[:, np.newaxis], few[:, np.newaxis])[: inside.FEW + 1]
            x = x + self._sum(factors, ends)
            f = self._value(x)[:D]
            nodes.append((x, f))
        sums = {"ratio": 0.0, "total": 0.0}
        for v in inside.TESTS:
            of_value, of_slope = inside.weights_of_test(v)
            states = passed.x + self._between(passed, nodes, signed, of_value)
            rates = self._value(self._with_signs(states, passed))
            slopes = self._between(passed, nodes, signed, of_slope)
            own = {"slope": slopes, "f": rates, "inverse": passed.inverse, "signed": signed}
            sums, _ = self._fold(inside.DEFECT, sums, **own)
        found = self._apply(inside.FAILS, signed=signed, **of_step, **sums)
        fails = found.pop("fails") > 0.0
        for name, value in found.items():
            self.row(name)[:] = np.where(fails, value, self.row(name))
        passed.accepted = np.where(fails, 0.0, passed.accepted)
        return nodes, signed

    def _between(self, passed, nodes, signed, weights):
        """Return the polynomial with these weights, less x."""
        inputs = {"x": passed.x, "f": passed.f[: self.D], "signed": signed}
        for k, (x, f) in enumerate([*nodes, (passed.new, passed.f_new[: self.D])], 1):
            inputs |= {f"x{k}": x, f"f{k}": f}
        return _applied(inside.INTERPOLATED, **inputs, **weights)["value"]

    def _with_signs(self, states, passed):
        if self.f.of_one_sign:
            return self._fold(inside.WITH_SIGN, value=states, x=passed.x)[1]["value"]
        return states


def take_in_numpy(monkeypatch):
    """Have this program take the steps of all motions."""

    def taker(self, half, rows, table, W):
        return StepsInNumPy(half, self, rows, table).take

    monkeypatch.setattr(engine.Motion, "_taker", taker)
    monkeypatch.setattr(motions, "_FEW", 0)  # all but single ones
