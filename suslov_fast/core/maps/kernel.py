"""Kahan's map of any quadratic field f (theory, section 7):

x_next = x + eps A(x)**-1 f(x), where A(x) = 1 - (eps/2) f'(x).

A field consists of terms. With one more component, x_D = 1, all terms are quadratic, and f_i is the
sum of its v x_j x_k, j <= k. The indices of the terms determine the expression program of a step
(`kahan_step`), and `stage_code` makes machine code of it. If the increment cancels the state, or
elimination loses digits, `pivoting_step` repeats it. A step of other methods has several
stages, which are steps by fractions of eps (`stages`). States are in lines of W lanes,
x[line, component, lane]. After a failure a trajectory is NaN. In calls of the kernel

arguments   are a `Scheme`, values (1 or B, T) and eps (1 or B,)
final       has the states (B, D) that a run continues from
carry       has, for each trajectory, the number n of the first state after a step with det A < 0,
            or 0; -n if det A > 0, but a component that keeps its sign along motions changed it
"""

import functools
from contextlib import nullcontext

import numpy as np
from numba import config

from ..llvm.compiler import address_of, call, code_of
from ..llvm.tolerances import WIDTH
from ..numba.decorators import Kernel, calling_python
from ..numba.threads import in_parts
from .dense import take_dense
from .driver import NOT_READY, SLOT, DriverArguments, text_of_steps
from .kahan_step import Step
from .packs import in_lines, note_undefined, packed, plan_of, tables_of
from .pivoting import ENDED, PASSED, arguments_of, pivoting_step
from .stages import WHOLE, Scheme
from .tolerances import (
    FIELDS_IN_MEMORY,
    SHORT_RUN,
    TIME_OF_OPERATION_IN_PYTHON,
    TIME_OF_PIVOTING,
    TRAJECTORIES_IN_LINES,
)


@functools.lru_cache(FIELDS_IN_MEMORY)
def _step_of(places, D):
    # A copy, because kernels would be compiled once more for arrays that cannot be written.
    return Step(np.frombuffer(places, np.int64).reshape(3, -1).copy(), D)


def scheme_of(indices, D, stages=WHOLE):
    """Return the `Scheme` of fields of D variables; `indices` (3, T) are i, j, k of their terms."""
    return Scheme(_step_of(np.ascontiguousarray(indices, np.int64).tobytes(), D), stages)


class _Lines:
    """Trajectories in lines of W lanes, with all the arrays that their steps need.

    x       states (lines, D, W)
    marks   (2, lines), bits of lanes that have ended, and that have passed a pole or ended; lanes
            without a trajectory have ended
    notes   status, failed_at and the first state beyond a pole, of each trajectory
    """

    def __init__(self, arguments, states, notes, W):
        self.scheme, *parameters = arguments
        self.notes = notes
        self.W, self.D = W, self.scheme.step.D
        self.B, self.count = len(states), -(-len(states) // W)
        self.for_each = max(map(len, parameters)) > 1
        self.halves, self.table = tables_of(self.scheme, *parameters, W)
        self.marks = np.zeros((2, self.count), np.uint8)
        self.start_from(states)

    def start_from(self, states):
        """Set the states to `states` (B, D), or to NaN if a trajectory has ended."""
        self.x = in_lines(states, self.W)
        status, _, poles = self.notes
        if status.any() or self.count * self.W > self.B:
            ended = status < 0
            self.x.swapaxes(1, 2)[self._of_lanes(ended, False)] = np.nan
            self.marks[ENDED] = packed(self._of_lanes(ended, True))
            self.marks[PASSED] = packed(self._of_lanes(ended | (poles != 0.0), True))

    def _of_lanes(self, truths, unused):
        """Return truth values (B,) as (lines, W); lanes without a trajectory get `unused`."""
        padded = np.full(self.count * self.W, unused)
        padded[: self.B] = truths
        return padded.reshape(self.count, self.W)

    def states(self):
        """Return the states of all trajectories (B, D), copied from the lines."""
        return self.x.swapaxes(1, 2).reshape(-1, self.D)[: self.B]

    def take(self, start, stop, saved, every, abandoned, seconds=None):
        """Take the steps from state `start` to state `stop`; save states at multiples of `every`.

        Return False if a step needs `pivoting_step`, and this is not prepared. Then the caller
        repeats the steps with `seconds`, the time that pivoting would take in Python, which decides
        whether it is compiled. The steps end early if `abandoned` becomes true.
        """
        stages = len(self.scheme.stages.fractions)
        every = min(every, stop + 1)  # so `every` times `stages` is an integer of 64 bits
        until, steps = every - start % every if every else 0, (stop - start) * stages
        rows = saved, until * stages - 1, every * stages - 1
        address = code_of(text_of_steps, self.scheme.step, self.W, self.for_each, saved.size > 0)
        is_short = self.count * (stop - start) <= SHORT_RUN
        pivoting_address, in_python = 0, False
        is_field = self.scheme.step.of is None
        if is_field and (seconds is not None or (pivoting_step.is_compiled and not is_short)):
            pivoting_address = pivoting_step.address(seconds or 0.0)
            in_python = not pivoting_step.is_compiled
        numbers, _kept_alive = self._driver_arguments(start, steps, *rows, pivoting_address)
        of_one = self.W * (self.D**3 + 200) * (1000 if in_python else 1)
        budget = max(TIME_OF_PIVOTING // of_one, 1)
        while numbers[SLOT.line] < numbers[SLOT.lines] and not abandoned:
            numbers[SLOT.budget] = budget
            with calling_python() if in_python or config.DISABLE_JIT else nullcontext():
                if call(address, numbers) == NOT_READY:
                    return False
        return True

    def _driver_arguments(self, start, steps, saved, until, between, pivoting):
        """Return the array of `DriverArguments`, and what must stay alive while the driver runs."""
        arrays, of_pivoting = (), np.empty(0)
        if pivoting:
            step, stages = self.scheme
            memory = np.empty(step.state_D * (3 * step.state_D + 4) + step.T)
            arrays = self.x, self.halves, np.array(stages.fractions), step.indices
            arrays = *arrays, *self.notes, self.marks, memory
            of_pivoting = arguments_of(arrays, step.state_D, start)
        # Lines of a block stay in the L1 cache. Blocks have equal lengths: a short last block would
        # have too few lines to compute while one of them waits for the results of its last step.
        blocks = -(-8 * self.x.size // 2**15)
        block = -(-self.count // min(blocks, -(-self.count // 4)))
        row = saved.ctypes.data
        plan = plan_of(self.scheme.stages, self.table)
        numbers = DriverArguments(
            x=address_of(self.x),
            lines=self.count,
            block=block,
            steps=steps,
            plan=address_of(plan),
            stages=len(plan),
            first_row=row,
            row_bytes=saved.strides[0],
            first_until=until,
            between=between,
            trajectories=self.B,
            ended=address_of(self.marks[ENDED]),
            passed=address_of(self.marks[PASSED]),
            status=address_of(self.notes[0]),
            failed_at=address_of(self.notes[1]),
            first=start + 1,
            pivoting_step=pivoting,
            pivoting_arguments=address_of(of_pivoting),
            until=until,
            row=row,
        )
        return np.array(numbers, np.int64), (arrays, of_pivoting, plan)


class FieldSteps(Kernel):
    """The kernel of steps of fields, which calls the machine code of the field."""

    def __init__(self):
        self.py_func = _iterate_part

    def __call__(self, part, parts, *arguments, abandoned=()):
        with np.errstate(all="ignore"):  # each thread has its own error state
            _iterate_part(part, parts, *arguments, abandoned)

    def serial(self, arguments, *others):
        self.parallel(1, arguments, *others)

    def interpreted_or_serial(self, _, *arguments):
        self.parallel(1, *arguments)

    def parallel(self, threads, arguments, *others):
        step = arguments[0].step
        if not (step.usual or step.is_sparse):  # a dense field without operations (`Step`)
            take_dense(threads, arguments, *others)
            return
        if threads == 1:
            self(0, 1, arguments, *others)
            return
        abandoned = []

        def work(part):
            self(part, threads, arguments, *others, abandoned=abandoned)

        in_parts(threads, work, abandoned, threads)


def _iterate_part(part, parts, arguments, x0, span, output, abandoned):
    """Take part `part` of `parts` of the steps of a `Span`, unless they are `abandoned`."""
    scheme, *parameters = arguments
    begin, end = span.begin, span.end
    starts = x0 if span.start == 0 else output.final
    W = WIDTH if end - begin > WIDTH else min(1 << (end - begin - 1).bit_length(), 4)
    count = -(-(end - begin) // W)
    first, last = (begin + W * (count * k // parts) for k in (part, part + 1))
    last = min(last, end)
    for at in range(first, last, TRAJECTORIES_IN_LINES):
        chunk = slice(at, min(at + TRAJECTORIES_IN_LINES, last))
        of_chunk = scheme, *(array[chunk] if len(array) > 1 else array for array in parameters)
        states, written = starts[chunk], output.of(chunk)
        notes = written.status, written.failed_at, written.carry[0]
        if span.start == 0:
            note_undefined(states, notes)
        if not scheme.step.usual:
            from . import superlu  # here, because importing SciPy takes time

            superlu.take(of_chunk, states, span, written, abandoned)
            continue
        lines = _Lines(of_chunk, states, notes, W)
        _take_steps(lines, states, span, written.saved, abandoned)
        written.final[:] = lines.states()


def _take_steps(lines, states, span, saved, abandoned):
    """Take steps of `_Lines`; take them again from `states` (B, D) if they need pivoting."""
    _, _, start, stop, every, row = span
    if every and start == 0:
        saved[row] = lines.states()
        row += 1
    if stop == start:
        return
    arguments = start, stop, saved[row:] if every else saved[:0], every, abandoned
    if not lines.take(*arguments):
        step, stages = lines.scheme
        work = (stop - start) * len(stages.fractions) * (step.length + lines.B * step.D**2)
        lines.start_from(states)
        # Again from the start: few runs need it.
        lines.take(*arguments, seconds=TIME_OF_OPERATION_IN_PYTHON * work)


field_steps = FieldSteps()
