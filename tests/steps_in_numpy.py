"""The steps of the motion in NumPy: a second opinion on their machine code, with the same bits.

All lanes of all lines are columns of the arrays. It shares the rules, the tables of columns and the
lists of operations with the code, and has a program of control of its own. It covers both halves,
clocks, variational equations and dense fields. Surfaces and choices of f are not here: closed forms
and matrix exponentials judge them.
"""

import itertools
from functools import singledispatch
from types import SimpleNamespace

import numpy as np

from suslov_fast.core.code.sparse_code import add_factors
from suslov_fast.core.lists.sparse import Head
from suslov_fast.core.lists.step import evaluate
from suslov_fast.core.motion import (
    engine,
    errors,
    functions,
    growth,
    implicit,
    inside,
    lengths,
    second_trial,
    step,
)
from suslov_fast.core.motion.arguments import COMPONENT, NUMBER, Component, Numbers
from suslov_fast.core.motion.columns import EXPLICIT, IMPLICIT, weights, weights_of_errors
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
        self.components = range(half.block.D)  # without columns
        self.extended = self.D + len(half.f.denominators)
        self.lanes, self.table = trajectories.T, np.atleast_2d(table).T  # rows of all lanes
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
            length = self._apply(lengths.LENGTH, mode=self.mode, reach=lengths.REACH, **own)
            if is_taken := (length["taken"] > 0.0).any():
                self._step(**length)
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
        for m in range(N - 1):
            right = s * self._value(x + change)[: self.D]
            if m == 0:
                self.apart = self.apart + weight * (right - change)
            last = self._solve(factors, right)
            change = change + last
        self.apart, self.factors = self.apart + weight * 0.5 * last, factors
        return change

    def _solve(self, factors, right):
        return carried_out(self.half.functions["solve"], [*factors, *right])

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
        if self.f.steady:
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
        fallen = self._fold(growth.FALLEN, {"fallen": 0.0}, self.components, **own)[0]["fallen"]
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
        if is_implicit and self.f.entries:
            f_new, least = self._keep_signs(own | {"f": f, "signed": signed})
            kept = {"kept": np.where(taken > least, 0.0, kept["kept"])}
        sums |= {"taken": taken, "aside": aside, **kept}
        before = self.row("t").copy()
        near = {"reach": lengths.REACH, "shortest": lengths.SHORTEST}
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
        for lane in np.flatnonzero(served > 0.0):
            self._save(lane, new[:, lane])
        passed = SimpleNamespace(
            before=before, taken=taken, x=x, f=f, new=new, f_new=f_new, inverse=inverse, ends=ends,
            accepted=accepted,
        )  # fmt: skip
        self._save_inside(passed)
        is_taken = passed.accepted > 0.0
        own = {"new": new, "f_new": f_new, "inverse": inverse, "taken": taken}
        self._watch_small(is_taken, fallen, own)
        self._rows("x", D)[:] = np.where(is_taken, new, x)
        self._rows("f", self.extended)[:] = np.where(is_taken, f_new, f)
        modulus = abs(new)
        largest[:] = np.where(is_taken & (modulus > largest), modulus, largest)

    # -------------------------------------------------------------------- below allowed errors
    def _fed(self, x, inverse, times):
        """Return f at states without components below so many allowed errors."""
        own, alone = {"x": x, "inverse": inverse, "times": times}, x.copy()
        found = self._fold(growth.LARGE_ALONE, None, self.components, **own)[1]["alone"]
        alone[: len(found)] = found
        return self._value(alone)

    def _keep_signs(self, step):
        """Return f at the next states, where some keep their signs, and the longest step."""
        new = step["new"]
        grows = self._fold(growth.GROWS, {"grows": 0.0}, self.components, **step)[0]["grows"] > 0.0
        remembers, found = self._growth(step["x"], np.inf, step)
        own = step | {"remembers": remembers, "feeds": found["feeds"]}
        kept = self._fold(growth.KEEPS_SIGN, None, self.components, **own)[1]["new"]
        new[: len(kept)] = np.where(grows, kept, new[: len(kept)])
        _, found = self._growth(new, found["least"], step)
        return self._value(new), np.where(grows, found["least"], np.inf)

    def _growth(self, x, least, step):
        """Return which components remember, and `feeds` and `least` of `growth.LONGEST`."""
        of_x = step | {"x": x, "fed": self._fed(x, step["inverse"], 1.0)}
        found = self._fold(growth.REMEMBERS, None, self.components, **of_x)[1]["remembers"]
        remembers, feeds = np.zeros_like(x), 1.0
        remembers[: len(found)] = found
        entries = derivative_entries(self.f, x, self.table)
        for k, (i, j) in enumerate(self.f.pattern):
            of_place = {"of_row": remembers[i], "of_column": remembers[j], "feeds": feeds}
            of_place |= {"entry": entries[k], "is_diagonal": float(i == j)}
            found = self._apply(growth.ENTRY, signed=step["signed"], **of_place)
            entries[k], feeds, remembers[i] = found.values()
        found = {"length": np.inf, "sign": 1.0}
        factors = carried_out(self.half.functions["factor"], [*entries, step["signed"]])
        for pivot in factors[: self.half.pivots]:
            found = self._apply(growth.PIVOT, pivot=pivot, taken=step["taken"], **found)
        found = self._apply(growth.LONGEST, feeds=feeds, least=least, **found)
        return remembers, found | {"feeds": feeds}

    def _watch_small(self, is_taken, fallen, step):
        """Note which components have fallen below what is allowed, and grown again."""
        looks = is_taken & ((fallen > 0.0) | (self.row("watches") > 0.0))
        low = self._rows("low", len(self.components))
        own = {"low": low, "largest": self._rows("largest", self.D)}
        own["fed"] = self._fed(step["new"], step["inverse"], growth.FEW)
        sums, found = self._fold(growth.LOW, {"watches": 0.0}, self.components, **own, **step)
        low[:] = np.where(looks, found["low"], low)
        self.row("watches")[:] = np.where(looks, sums["watches"], self.row("watches"))

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
