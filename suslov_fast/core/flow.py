"""The motion of fields at given times, to a tolerance: `tolerance` has the equations.

Trajectories are in lines of W lanes, whose rows hold all that their steps need
(`generated_flow.Rows`). Machine code takes the steps; where it is impossible, NumPy does, with the
same bits. Fields of many variables have loops (`sparse_flow`).
"""

import functools
from math import comb

import numpy as np

from .generated import WIDTH
from .generated_flow import SLOT, FlowArguments, rows_of, text_of_flow
from .lines import in_lines, zeros
from .listed_code import runs_code
from .machine_code import call, code_of
from .numba import Kernel
from .operations import evaluate
from .sparse_flow import LONGEST, Loops
from .stages import extrapolation, weights_of
from .threads import in_parts
from .tolerance import AT_FIRST, MOST_STEPS, REACH

COLUMNS = 2, 4, 6, 8, LONGEST
# Factors of x_1 - x_0, ..., x_n - x_0 in the difference of order n of the longest column.
DIFFERENCE = np.array([(-1) ** k * comb(LONGEST, k) / 2**LONGEST for k in range(1, LONGEST + 1)])
ACTIVE = 2**15  # bytes of the rows of lines that are taken side by side
# Operations of a stage (of a lifted field: of all lists), above which compiling takes longer than
# most runs. One trajectory of a lifted field has more: compiled in 3 s, five times as fast.
MOST, MOST_OF_ONE = 10_000, 25_000
BUDGET = 2**21  # steps of lines times operations of a stage, after which Python handles Ctrl-C


@functools.lru_cache
def plan_of(direction):
    """Return the columns (k, 4) of `generated_flow.Column`, for time forward or backward."""
    stages = extrapolation(*COLUMNS)
    weights, plan = weights_of(stages), np.empty((len(COLUMNS), 4))
    plan.view(np.int64)[:, 0] = COLUMNS
    plan[:, 1] = direction * 0.5 / np.array(COLUMNS)
    plan[:, 2:] = weights[weights[:, 0] != 0.0]
    return plan


class Motion:
    """Trajectories x0 (B, n) of fields with one `tolerance.Stage`, in lines of lanes.

    values      (1 or B, parameters), of the terms and of the lift
    direction   1 or -1, forward or backward in time
    last        modulus of the last time, the length of the first step of a state at rest
    """

    def __init__(self, step, values, x0, rtol, direction, last):
        self.B, self.given = x0.shape
        W = min(1 << (self.B - 1).bit_length(), 4) if self.B <= WIDTH else WIDTH
        self.step, self.W = step, W
        self.places, self.rtol = rows_of(self.step), np.array([rtol])
        self.plan, self.for_each, self.loops = plan_of(direction), len(values) > 1, None
        x = in_lines(x0, W)
        self.values = in_lines(values, W) if self.for_each else values.reshape(1, -1, 1)
        if not step.usual or (_is_long(step, W) and runs_code(W, step.prologue) is not None):
            self.loops = Loops(step, W, self.places, self.values)
        self.has_lists = self.loops is not None and self.loops.code is not None
        self.rows = rows = zeros(len(x), self.places.size, W)
        rows[:, self.places.base : self.places.base + self.given] = x
        rows[:, self.places.wanted], rows[:, self.places.longer] = last, AT_FIRST
        self.beginning = len(rows)

    def ends(self):
        """Return which trajectories have ended, when, and which took too many steps (B,) each."""
        time, wanted, steps = (
            self.rows[:, place].reshape(-1)[: self.B]
            for place in (self.places.time, self.places.wanted, self.places.steps)
        )
        return wanted == 0.0, time, steps >= MOST_STEPS

    def advance(self, times, out, abandoned=()):
        """Write the states at later times (n,), ascending moduli, to out (n, B, D)."""
        address = None
        if self.step.usual and not self.loops:
            address = code_of(text_of_flow, self.step, self.W, self.for_each)
        if address is None:
            self._advance_in_numpy(times, out, abandoned)
            return
        arguments, _kept_alive = self._arguments(times, out)
        budget = max(BUDGET // len(self.step.usual), 1)
        while not abandoned:
            arguments[SLOT.budget] = budget
            has_ended = call(address, arguments)
            self.beginning = 0
            if has_ended:
                break

    def _arguments(self, times, out):
        """Return the arguments of machine code, and what has to stay alive while it runs."""
        lines = len(self.rows)
        most = min(max(ACTIVE // self.rows[0].nbytes, 4), lines)
        active, place = np.arange(most), np.zeros(lines, np.int64)
        kept = np.empty(len(self.step.pieces[1]) * self.W)
        times = np.ascontiguousarray(times)
        arguments = FlowArguments(
            rows=self.rows.ctypes.data,
            lines=lines,
            values=self.values.ctypes.data,
            plan=self.plan.ctypes.data,
            columns=len(self.plan),
            difference=DIFFERENCE.ctypes.data,
            times=times.ctypes.data,
            count=len(times),
            states=out.ctypes.data,
            state_bytes=out.strides[0],
            trajectories=self.B,
            rtol=self.rtol.ctypes.data,
            kept=kept.ctypes.data,
            place=place.ctypes.data,
            beginning=self.beginning,
            active=active.ctypes.data,
            taking=most,
            next=most,
            budget=0,
        )
        return np.array(arguments, np.int64), (kept, active, place, times)

    def _advance_in_numpy(self, times, out, abandoned):
        """Take the same steps by NumPy: the reference, where there is no machine code."""
        if self.beginning:
            self._begin()
        for end, states in zip(times, out, strict=True):
            while not abandoned:
                time, wanted = self.rows[:, self.places.time], self.rows[:, self.places.wanted]
                if ((time == end) | (wanted == 0.0)).all():
                    break
                self._step_to(end)
            base = self.rows[:, self.places.base : self.places.base + self.given]
            states[:] = base.swapaxes(1, 2).reshape(-1, self.given)[: self.B]

    def _begin(self):
        """Find the first lengths of all lanes."""
        self.beginning, places = 0, self.places
        if self.has_lists:
            self.loops.begin(self.rows, self.rtol[0])
            return
        step, n, rows, values = self.step, self.given, self.rows.swapaxes(0, 1), self.values
        x, values = rows[places.base : places.base + n], values.swapaxes(0, 1)
        words = step.words(x, values)[0] if step.lift is not None else []
        inputs = [*x, *words, *values[: step.T], rows[places.wanted], self.rtol[0]]
        found = dict(enumerate(inputs))
        evaluate(step.beginning.operations, found)
        results = [found[number] for number in step.beginning.results]
        x[:], rows[places.largest : places.largest + n] = results[:n], results[n : 2 * n]
        rows[places.wanted], rows[places.first] = results[2 * n :]

    def _step_to(self, end):
        """Take one step of all lanes, at most to a time."""
        rows, places, (D, n) = self.rows.swapaxes(0, 1), self.places, (self.step.D, self.given)
        words, all_base = rows[places.x : places.x + D], rows[places.base : places.base + D]
        x, base, total, second, difference, largest = (
            rows[first : first + n] for first in (places.x, *places[1:6])
        )
        rest, wanted = end - rows[places.time], rows[places.wanted]
        taken = rows[places.taken] = np.where(wanted < REACH * rest, wanted, rest)
        total[:], second[:], difference[:], rows[places.least] = 0.0, 0.0, 0.0, 1.0
        values = self.values.swapaxes(0, 1)
        for (_, scale, weight, without), stages in zip(self.plan, COLUMNS, strict=True):
            half = scale * taken
            halves = None if self.has_lists else self._scaled(half, values)
            if stages == COLUMNS[0] and self.step.lift is not None:
                if self.has_lists:
                    self.loops.lift(self.rows, half)
                else:
                    all_base[n:], rows[places.least] = self.step.words(base, halves)
            words[:] = all_base
            is_listed = self.has_lists and self.step.usual
            if is_listed:
                factors = DIFFERENCE if stages == LONGEST else np.zeros(LONGEST)
                self.loops.take_column(self.rows, half, stages, factors[:, np.newaxis])
            elif self.loops:
                self.loops.prepare(half)
            for k in range(0 if is_listed else stages):
                if self.loops:
                    self.loops.take_stage(self.rows)
                else:
                    self._take_stage(rows, halves)
                if stages == LONGEST:
                    difference += DIFFERENCE[k] * (x - base)
            change = x - base
            total += weight * change
            second += without * change
        if self.has_lists:
            self.loops.choose(self.rows, end, self.rtol[0])
            return
        choice = self.step.choice
        inputs = [*all_base, *total, *second, *difference, *largest, *values[: self.step.T]]
        found = dict(enumerate(inputs))
        scalars = [rows[k] for k in range(places.time, places.least + 1)]
        others = [*words[n:], *values[self.step.T :]] if self.step.lift is not None else []
        found.update(enumerate([*scalars, end, self.rtol[0], *others], len(found)))
        evaluate(choice.operations, found)
        results = [found[number] for number in choice.results]
        base[:], largest[:] = results[:n], results[n : 2 * n]
        rows[places.time : places.time + 4] = results[2 * n :]

    def _scaled(self, half, values):
        """Return h v of the terms, and the coefficients of the lift."""
        T = self.step.T
        return [*half * values[:T], *values[T:]]

    def _take_stage(self, rows, halves):
        """Take a stage of all lanes by NumPy; halves are those of `_scaled`."""
        step, least = self.step, rows[self.places.least]
        found = dict(enumerate([*rows[: step.D], *halves]))
        evaluate(step.fixed, found)
        evaluate(step.usual, found)
        if step.lift is None:
            lower = found[step.least]
            least[:] = np.where(lower < least, lower, least)
        rows[: step.D] = [found[number] for number in step.after]


def _is_long(step, W):
    """Return whether the code of the lists of a step would take long to compile.

    Of lifted fields loops carry out the same lists, with the same bits.
    """
    if step.lift is None:
        return len(step.usual) > MOST
    count = len(step.usual) + len(step.prologue) + len(step.choice.operations)
    return count > (MOST if W > 1 else MOST_OF_ONE)


class FlowKernel(Kernel):
    """The kernel that advances each `Motion` of a list to times, and writes to its array."""

    def __init__(self):
        self.py_func = _advance

    def __call__(self, motions, times, outs, abandoned=()):
        with np.errstate(all="ignore"):  # each thread has its own
            for motion, out in zip(motions, outs, strict=True):
                _advance(motion, times, out, abandoned)

    def serial(self, motions, times, outs):
        self(motions, times, outs)

    def parallel(self, threads, motions, times, outs):
        abandoned = []

        def take(part):
            self(motions[part::threads], times, outs[part::threads], abandoned)

        in_parts(threads, take, abandoned)


def _advance(motion, times, out, abandoned):
    if not abandoned:
        motion.advance(times, out, abandoned)


flow_kernel = FlowKernel()
