"""The driver of steps of fields: the control flow around SIMD packs, as LLVM's text.

A line is a SIMD pack of W lanes. A block of lines takes all its steps before the next block begins.
A stage of a step is computed for one line after the other. If lanes need pivoting, `pivoting_step`
computes them. At the end of a whole step states are saved.
"""

import math
from typing import NamedTuple

from ..llvm.text import Carried, Code, Index, Integers, Shared, Truth
from ..llvm.tolerances import WRITTEN_OUT
from ..numba.status_codes import CHANGED, NONFINITE
from .stage_code import Stage, loader

NOT_READY, DONE = range(2)  # what the code of `text_of_steps` returns


class DriverArguments(NamedTuple):
    """Integers that the code of `text_of_steps` takes: addresses, counts, place in its loops."""

    x: int  # address of the states (lines, D, W)
    lines: int
    block: int  # lines of a block, which takes all steps before the next block begins
    steps: int  # number of stages in all steps
    plan: int  # address of an array: for each stage the address of its table of constants
    stages: int
    first_row: int = 0  # address of the first saved states
    row_bytes: int = 0  # bytes from one saved row to the next
    first_until: int = 0  # stages before the stage that makes the first saved state
    between: int = 0  # stages from one saved state to the next, minus 1
    trajectories: int = 0
    ended: int = 0  # address of bytes (lines,), with a bit for each lane that has ended
    passed: int = 0  # address of such bytes for lanes that have passed a pole or ended
    status: int = 0  # address of statuses (i8), written only by steps of a `Map`; 0 if none is kept
    failed_at: int = 0  # address of `failed_at`, as for `status`
    first: int = 0  # number of the state after the first step
    pivoting_step: int = 0  # address of `pivoting.pivoting_step`, 0 if it is not ready
    pivoting_arguments: int = 0  # address of the arguments of `pivoting_step`
    # The place in the loops: if the budget is spent, the code returns; the next call continues.
    budget: int = 0  # calls of `pivoting_step` that are left
    line: int = 0  # the first line of the block in work
    n: int = 0  # number of the next stage, counted over all steps
    stage: int = 0  # number of the next stage within its step
    until: int = 0  # stages before the next stage that makes a saved state
    row: int = 0  # address of the next saved states


SLOT = DriverArguments(*range(len(DriverArguments._fields)))  # places of the arguments in an array


def text_of_steps(step, name, W, for_each, saves):
    """Return LLVM's text of i64 name(address of `DriverArguments`): steps of lines of W lanes.

    The code returns DONE; it returns NOT_READY if it needs the address of `pivoting_step`, or of
    statuses, and the address is 0. If `for_each` is true, each lane has its own parameters.
    """
    return _Driver(step, name, W, for_each, saves).finished()


class _Driver:
    """Writer of the text of `text_of_steps` (same arguments): loops around the code of a stage."""

    def __init__(self, step, name, W, for_each, saves):
        self.text, self.name = Code(W), name
        self.step, self.D = step, step.D
        self.for_each, self.saves = for_each, saves
        self.all_lanes = (1 << W) - 1

    def finished(self):
        """Return the whole text: loops over blocks, steps and lines."""
        text = self.text
        text.begin(self.name, "arguments")
        self.slots = Integers(text, "%arguments")
        self.of = of = DriverArguments(*(self.slots[k] for k in SLOT))
        at = Carried(lo=of.line, n=of.n, stage=of.stage, until=of.until, row=of.row)
        for _ in text.rounds(at):
            self.block(at)
        self.slots[SLOT.line] = at.lo
        text.add(f"  ret i64 {DONE}")
        return text.finished()

    def block(self, at):
        """Add the code of all steps of a block of lines; set loop variables `at` for the next."""
        text, of, lo = self.text, self.of, at.lo
        end = lo + of.block
        hi = (end < of.lines).select(end, of.lines)
        now = Carried(n=at.n, stage=at.stage, until=at.until, row=at.row)
        for _ in text.rounds(now):
            self.step_of(lo, hi, now)
        at.lo = hi
        at.n, at.stage = 0, 0
        at.until, at.row = of.first_until, of.first_row
        at.goes_on = hi < of.lines

    def step_of(self, lo, hi, now):
        """Add the code of a stage of lines lo to hi - 1; set loop variables `now` for the next."""
        text, of, n, row = self.text, self.of, now.n, now.row
        saves = now.until.equals(0)
        table = Integers(text, of.plan)[now.stage]
        following = now.stage + 1
        is_last = following.equals(of.stages)
        for at in text.rounds(Carried(line=lo)):
            line = at.line
            state = of.x + line * (Index(text, self.D) * text.size)
            final = self.take_stage(state, table, line, n)
            if self.saves:
                with text.when(saves):
                    self.save(line, row, state, final)
            at.line = line + 1
            at.goes_on = at.line < hi
        now.n = n + 1
        now.stage = is_last.select(0, following)
        now.until = saves.select(of.between, now.until - 1)
        now.row = saves.select(row + of.row_bytes, row)
        now.goes_on = now.n < of.steps
        with text.when(now.goes_on, likely=True):
            sign_bit = (self.slots[SLOT.budget] - 1) >> 63
            is_spent = sign_bit.equals(1)  # the budget is 0 or negative
            with text.when(is_spent, likely=False):
                self.slots[SLOT.line] = lo  # the line with which the next call continues
                for key in ("n", "stage", "until", "row"):
                    self.slots[getattr(SLOT, key)] = getattr(now, key)
                text.leave(f"i64 {DONE}")

    def others(self, bits, line, marks):
        """Return bits of the lanes of a line that are neither in `bits` nor marked in `marks`."""
        marked = self.text.load("i8", marks + line, 1)
        marked = Index(self.text, self.text.new(f"zext i8 {marked} to i64"))
        return (bits | marked) ^ self.all_lanes

    def call_pivoting(self, line, bad, signs, n):
        """Add a call of `pivoting_step`, or a return of NOT_READY if its address is 0."""
        text, of = self.text, self.of
        with text.when(of.pivoting_step.equals(0)):
            text.leave(f"i64 {NOT_READY}")
        text.call("void", of.pivoting_step, of.pivoting_arguments, line, bad, signs, n)
        self.slots[SLOT.budget] = self.slots[SLOT.budget] - 1

    def take_stage(self, state, table, line, n):
        """Add stage n for a SIMD pack, the state at the address `state`; return the next state."""
        text, step, rows = self.text, self.step, self.text.array(state)
        if self.for_each:
            table = table + line * (len(step.table) * text.size)
        stage = Stage(text, step, loader(text, step, self.for_each, state, table))
        usual = stage.take([rows[i] for i in range(step.D)])
        rare = self.take_rare_stage if step.of is None else self.end_lanes
        final = text.otherwise(stage.is_good(), usual, lambda: rare(stage, rows, line, n))
        for k, number in enumerate(step.after):
            if number != k:
                rows[k] = final[k]
        return final

    def take_rare_stage(self, stage, rows, line, n):
        """Add the rare operations of stage n, and pivoting if needed; return the next state."""
        text, components = self.text, range(self.D)
        # Load x and compute the stage again, so that usual lines need not save registers for this.
        x = [rows[i] for i in components]
        stage.take(x)
        after, accurate, good, signs = stage.take_rare()
        after = [accurate.select(*both) for both in zip(after, x, strict=True)]
        for k, value in enumerate(after):
            rows[k] = value
        # `bad` are lanes that need pivoting, `signs` good lanes with det A < 0 or a changed sign.
        bad = self.others(good, line, self.of.ended)
        signs = signs & (good & self.others(0, line, self.of.passed)) * (1 | 1 << CHANGED)

        def with_pivoting():
            self.call_pivoting(line, bad, signs, n)
            return [rows[k] for k in components]

        return text.otherwise((bad | signs).equals(0), after, with_pivoting)

    def end_lanes(self, stage, rows, line, n):
        """Add code that ends trajectories where f of a map has no value; return the next state."""
        text, of, one = self.text, self.of, self.text.lanes(1)
        with text.when(of.status.equals(0)):
            text.leave(f"i64 {NOT_READY}")
        for k, value in enumerate(stage.results()):
            rows[k] = value
        finite = Truth(text, stage.values[self.step.accurate]).bits()
        bad = finite ^ self.all_lanes
        new = self.others(finite, line, of.ended)
        for lane in text.each(text.W):
            number = line * text.W + lane
            x = one.array(rows.at() + 8 * lane)
            with text.when(((bad >> lane) & 1).equals(1)):
                for k in text.each(self.D):
                    x[k] = one.constant(math.nan)
            with text.when(((new >> lane) & 1).equals(1)):
                text.store("i8", str(NONFINITE), of.status + number, align=1)
                Integers(text, of.failed_at + number * 8)[0] = of.first + n
        marked = new | (self.others(0, line, of.ended) ^ self.all_lanes)
        text.store("i8", text.new(f"trunc i64 {marked} to i8"), of.ended + line, align=1)
        return [rows[k] for k in range(self.D)]

    def save_by_lane(self, line, row, state):
        """Add code that copies lanes in use of the line at `state` to the saved states at `row`."""
        text, one = self.text, self.text.lanes(1)
        first = line * text.W
        for l in range(text.W):
            number = first + l
            with text.when(number < self.of.trajectories):
                place = Shared(one, row + number * self.D * 8)
                x = one.array(state + 8 * l)
                for k in text.each(self.D, most=WRITTEN_OUT):
                    place[k] = x[k]

    def save(self, line, row, state, final):
        """Add code that copies a pack of lanes, `line`, to saved states, trajectory by trajectory.

        `row` and `state` are the addresses of the saved states and of the pack. If all lanes are in
        use, their values `final` are transposed in registers: loops take 1.57 times as long.
        """
        text, W, D = self.text, self.text.W, self.D
        place = row + line * (8 * W * D)
        if W == 1:
            for k in range(D):
                text.store("double", final[k], place + 8 * k)
            return
        is_whole = (line + 1) * W <= self.of.trajectories
        with text.when(is_whole, likely=True):
            for first in range(0, W * D, W):
                vector = "undef"
                sources = [divmod(n, D) for n in range(first, first + W)]
                for k in dict.fromkeys(component for _, component in sources):
                    order = [
                        W + lane if component == k else n
                        for n, (lane, component) in enumerate(sources)
                    ]
                    vector = text.shuffled(vector, final[k], order)
                text.store(text.V, vector, place + 8 * first)
        with text.when(~is_whole):
            self.save_by_lane(line, row, state)
