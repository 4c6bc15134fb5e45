"""Kahan's map of any quadratic field f (theory, section 7):

x_next = x + eps A(x)**-1 f(x), where A(x) = 1 - (eps/2) f'(x).

A field is a list of terms. With one more component, x_D = 1, all terms are quadratic, and f_i is
the sum of its v x_j x_k, j <= k. The indices of the terms determine a list of operations for a step
(`operations`). `generated` makes machine code of it; where that is impossible, NumPy carries it
out. `careful` takes a step where the increment cancels the state, or elimination loses digits. A
step of order 4, 6 or 8 consists of several stages, which are steps with fractions of eps.

arguments   a `Scheme`; values (1 or B, T); eps (1 or B,)
final       (B, D), the states that a run continues from
carry       (1, B), the first state beyond a step from det A < 0, 0 if there is none

States are in lines of W lanes, x[line, component, lane]. After a failure a trajectory is NaN.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from .careful import ENDED, PASSED, LineArrays, arguments_of, careful, solve_lane, step_carefully
from .codes import NONFINITE, OK, PASSED_POLE
from .generated import SLOT, WIDTH, CodeArguments, text_of_step, text_of_steps
from .llvm import call_code, with_address
from .machine_code import LARGE, MANY, call, code_of
from .numba import STREAM_FROM, Kernel, function
from .operations import Step, evaluate
from .pool import in_parts

CHUNK = 2**13  # trajectories that are copied into lines at once
SOLVED = 5 * 10**7  # nanoseconds of `careful` steps, after which Python handles Ctrl-C
FEW = 256  # steps of lines, which are prepared for `careful` only when they need it
PLANS = 32  # patterns of terms whose lists of operations are kept


class Scheme(NamedTuple):
    """A list of operations, and the fractions of eps of the stages of one step."""

    step: Any  # `operations.Step`
    fractions: tuple[float, ...]


@functools.lru_cache(PLANS)
def _step_of(places, D):
    return Step(np.frombuffer(places, np.int64).reshape(3, -1), D)


def scheme_of(indices, D, fractions=(1.0,)):
    """Return the scheme for fields with terms at these indices (3, T)."""
    step = _step_of(np.ascontiguousarray(indices, np.int64).tobytes(), D)
    return Scheme(step, fractions)


# -------------------------------------------------------------------------- steps in users' loops
@with_address
class FieldSystem(NamedTuple):
    """A field and a step size, for `compiled`. Unpickling it finds the address in that process."""

    address: int  # of the code of `generated.text_of_step`, 0 if there is none
    half: Any  # (stages, T), half of the step size times the values of the terms
    table: Any  # (stages, n), see `Step.table`
    indices: Any  # (3, T)
    dimension: int

    def __reduce__(self):
        return system_of, (self.indices, self.half, self.dimension)


def system_of(indices, half, D):
    """Return the system of a field, from eps / 2 times its values for each stage (stages, T)."""
    step = scheme_of(indices, D).step
    table = np.ascontiguousarray(step.table_of(half.T).T)
    has_code = 0 < len(step.usual) < LARGE  # which lasts: users may store the system anywhere
    address = code_of(text_of_step, step, lasts=True) if has_code else None
    return FieldSystem(int(address or 0), half, table, step.indices, D)


@function
def field_memory(system):
    """The memory of `field_step_of_one`."""
    D = system.dimension
    return np.empty((D, D + 1, 1)), np.empty((2, D)), np.empty((D,))


@function
def field_step_of_one(system, state, out, memory):
    """Write the state that follows `state` to `out`; return its status. For `compiled`."""
    matrix, units, x = memory
    status, passed = OK, False
    for i in range(len(x)):
        x[i] = state[i]
    for stage in range(len(system.half)):
        code = np.int64(1)  # of `text_of_step`: 1 if the step is not accurate, 2 if det A < 0
        if system.address != 0:
            code = call_code(system.address, (x.ctypes.data, system.table[stage].ctypes.data))
        negative = code == 2
        if code == 1:
            status, negative = solve_lane(system.indices, system.half[stage], x, matrix, units)
        passed |= negative
        if status != OK:
            break
    for i in range(len(x)):
        out[i] = x[i]
    return PASSED_POLE if passed and status == OK else status


# What `compiled` calls for a system of this kind.
FieldSystem.memory, FieldSystem.one_step = field_memory, field_step_of_one


# ------------------------------------------------------------------------------------------- lines
def in_lines(rows, W):
    """Return rows (B, n) as lines (-, n, W); lanes without a row repeat the last one."""
    missing = -len(rows) % W
    padded = np.concatenate([rows, rows[-1:].repeat(missing, axis=0)]) if missing else rows
    return padded.reshape(len(padded) // W, W, rows.shape[1]).swapaxes(1, 2).copy()


def tables_of(scheme, values, eps, W):
    """Return eps / 2 times the values (lines, T, W), and `Step.table` (stages, lines, n, W).

    Their shapes are (1, T, 1) and (stages, 1, n, 1) if all trajectories have the same field.
    """
    halves = 0.5 * eps[:, np.newaxis] * values
    if len(halves) == 1:
        return halves[:, :, np.newaxis], _common_table(*scheme, halves.tobytes())
    halves = in_lines(halves, W)
    fractions = np.array(scheme.fractions)[:, np.newaxis, np.newaxis]
    table = scheme.step.table_of(np.moveaxis(halves, 1, 0)[:, np.newaxis] * fractions)
    return halves, np.ascontiguousarray(np.moveaxis(table, 0, 2))


@functools.lru_cache(PLANS)  # because it takes long beside a few steps
def _common_table(step, fractions, halves):
    """Return the table (stages, 1, n, 1) of one field, from the bytes of its halves."""
    table = step.table_of(np.outer(np.frombuffer(halves), fractions))
    return np.ascontiguousarray(table.T)[:, np.newaxis, :, np.newaxis]


def _packed(truths):
    """Return truth values (lines, W) as bits, a number for each line."""
    return np.packbits(truths, axis=1, bitorder="little")[:, 0]


class _Lines:
    """Trajectories in lines of W lanes, with all that their steps need.

    x         states (lines, D, W)
    for_each  True if lanes have parameters of their own
    marks     (2, lines), bits of lanes that have ended, and that have passed a pole or ended; lanes
              of no trajectory have ended
    notes     status, failed_at and the first state beyond a pole, of each trajectory
    """

    def __init__(self, arguments, states, notes, W):
        (self.scheme, *parameters), self.notes, self.W = arguments, notes, W
        self.B, self.count, self.D = len(states), -(-len(states) // W), states.shape[1]
        self.halves, self.table = tables_of(self.scheme, *parameters, W)
        self.for_each = self.halves.shape[2] > 1
        self.marks = np.zeros((2, self.count), np.uint8)
        self.start_from(states)

    def start_from(self, states):
        """Set the states, to NaN where trajectories have ended."""
        self.x = in_lines(states, self.W)
        status, _, poles = self.notes
        if status.any() or self.count * self.W > self.B:
            ended = status < 0
            self.x.swapaxes(1, 2)[self._of_lanes(ended, False)] = np.nan
            self.marks[ENDED] = _packed(self._of_lanes(ended, True))
            self.marks[PASSED] = _packed(self._of_lanes(ended | (poles > 0.0), True))

    def _of_lanes(self, truths, unused):
        """Return truth values of trajectories as (lines, W), `unused` for lanes of none."""
        padded = np.full(self.count * self.W, unused)
        padded[: self.B] = truths
        return padded.reshape(self.count, self.W)

    def states(self):
        """Return the states (B, D)."""
        return self.x.swapaxes(1, 2).reshape(-1, self.D)[: self.B]

    def take(self, start, stop, saved, every, is_large, abandoned, again=False):
        """Take the steps from state `start` to state `stop`; save states at multiples of `every`.

        Return False if a step needs `careful`, but it is not compiled, or there are FEW steps: then
        the steps must be taken again. End early if there is something in `abandoned`.
        """
        step, stages = self.scheme.step, len(self.scheme.fractions)
        align = _alignment(saved, self.W, is_large)
        if len(step.usual) > MANY:  # compile one code for runs that save states and for others
            align = 8
        address = code_of(text_of_steps, step, self.W, self.for_each, align) if step.usual else None
        until = every - start % every if every else 0
        rows = saved, until * stages - 1, every * stages - 1
        if address is None:
            self._take_in_numpy(start, (stop - start) * stages, *rows)
            return True
        is_ready = careful.is_compiled and (again or self.count * (stop - start) > FEW)
        steps = (stop - start) * stages
        arguments, _kept_alive = self._code_arguments(start, steps, *rows, is_ready)
        budget = max(SOLVED // (self.W * (self.D**3 + 200)), 1)
        while arguments[SLOT.line] < self.count and not abandoned:
            arguments[SLOT.budget] = budget
            if not call(address, arguments):
                return False
        return True

    def _line_arrays(self):
        """Return the arrays for `careful`."""
        step, fractions = self.scheme
        return LineArrays(
            self.x, self.halves, np.array(fractions), step.indices, *self.notes, self.marks,
            np.empty(self.D * (self.D + 4) + step.T),
        )  # fmt: skip

    def _code_arguments(self, start, steps, saved, until, between, is_ready):
        """Return the arguments of machine code, and what has to stay alive while it runs."""
        kept, arrays, own = np.empty(len(self.scheme.step.pieces[1]) * self.W), None, None
        if is_ready:
            arrays = self._line_arrays()
            own = arguments_of(arrays, start)
        # Lines of a block stay in the first cache. Blocks have equal lengths, because each step of
        # a short block waits for the one before it.
        blocks = -(-8 * self.x.size // 2**15)
        block = -(-self.count // min(blocks, -(-self.count // 4)))
        first_row = saved.ctypes.data
        arguments = CodeArguments(
            x=self.x.ctypes.data,
            lines=self.count,
            block=block,
            steps=steps,
            table=self.table.ctypes.data,
            table_bytes=self.table.strides[0],
            stages=len(self.scheme.fractions),
            first_row=first_row,
            row_bytes=saved.strides[0],
            first_until=until,
            between=between,
            trajectories=self.B,
            marks=self.marks.ctypes.data,
            careful=careful.address if is_ready else 0,
            careful_arguments=own.ctypes.data if is_ready else 0,
            kept=kept.ctypes.data,
            budget=0,
            line=0,
            n=0,
            stage=0,
            until=until,
            row=first_row,
        )
        return np.array(arguments, np.int64), (kept, arrays, own)

    def _carry_out(self, n):
        """Carry out the operations of step n where that is accurate.

        Return the bits of these lanes, and of lanes with det A < 0.
        """
        step, shape = self.scheme.step, (self.count, self.W)
        values = dict(enumerate(self.x.swapaxes(0, 1)))
        table = self.table[n % len(self.table)].swapaxes(0, 1)
        values.update(zip(step.table, table, strict=True))
        evaluate(step.usual, values)
        evaluate(step.rare, values)
        accurate = np.broadcast_to(values[step.accurate], shape)
        for k, number in enumerate(step.after_rare):
            self.x[:, k] = np.where(accurate, values[number], self.x[:, k])
        return _packed(accurate), _packed(np.broadcast_to(values[step.negative], shape))

    def _take_in_numpy(self, start, steps, saved, until, between):
        """Carry out the operations by NumPy: the reference, where there is no machine code."""
        (ended, passed), row, arrays = self.marks, 0, self._line_arrays()
        for n in range(steps):
            if self.scheme.step.usual:
                accurate, negative = self._carry_out(n)
            else:
                accurate, negative = np.zeros((2, self.count), np.uint8)
            bad = ~(accurate | ended) & np.uint8(2**self.W - 1)
            negative = negative & accurate & ~passed
            for line in np.flatnonzero(bad | negative):
                step_carefully(arrays, start, line, int(bad[line]), int(negative[line]), n)
            if n == until:
                saved[row] = self.states()
                row, until = row + 1, until + between + 1


def _alignment(saved, W, is_large):
    """Return the alignment of the lines of saved states, in bytes; 0 if none are saved."""
    if not saved.size:
        return 0
    if not is_large or W < WIDTH:
        return 8
    bits = saved.ctypes.data | saved.strides[0]
    return next(size for size in (64, 16, 8) if bits % size == 0)


class FieldSteps(Kernel):
    """The kernel of steps of fields, which calls the machine code of the field."""

    def __init__(self):
        self.py_func = _iterate_part

    def __call__(self, part, parts, *arguments, abandoned=()):
        with np.errstate(all="ignore"):  # each thread has its own
            _iterate_part(part, parts, *arguments, abandoned)

    def serial(self, *arguments):
        self(0, 1, *arguments)

    def parallel(self, threads, *arguments):
        abandoned = []
        in_parts(
            threads, lambda part: self(part, threads, *arguments, abandoned=abandoned), abandoned
        )


def _iterate_part(
    part, parts, arguments, omega0, carry, span, saved, final, status, failed_at, abandoned
):
    """Iterate the trajectories of a part; the arguments are those of `steps_3d.steps`.

    End early if there is something in `abandoned`.
    """
    (scheme, *parameters), (begin, end, *steps) = arguments, span
    starts = omega0 if steps[0] == 0 else final
    W = min(1 << (end - begin - 1).bit_length(), 4) if end - begin <= WIDTH else WIDTH
    count = -(-(end - begin) // W)
    first, last = (begin + W * (count * k // parts) for k in (part, part + 1))
    last = min(last, end)
    is_large = saved.size >= STREAM_FROM
    for low in range(first, last, CHUNK):
        chunk = slice(low, min(low + CHUNK, last))
        own = scheme, *(array[chunk] if len(array) > 1 else array for array in parameters)
        states, notes = starts[chunk], (status[chunk], failed_at[chunk], carry[0, chunk])
        if steps[0] == 0:
            _note_undefined(states, notes)
        lines = _Lines(own, states, notes, W)
        _take_steps(lines, states, steps, saved[:, chunk], is_large, abandoned)
        final[chunk] = lines.states()


def _note_undefined(states, notes):
    """Note which trajectories begin with NaN, and that none has passed a pole."""
    status, failed_at, poles = notes
    poles[:] = 0.0
    if not np.isfinite(states.sum()):  # a sum takes a tenth of the time of the next line
        undefined = np.isnan(states).any(axis=1)
        status[undefined], failed_at[undefined] = NONFINITE, 0


def _take_steps(lines, states, steps, saved, is_large, abandoned):
    """Take the steps of a run from these states, and save states."""
    start, stop, every, row = steps
    if every and start == 0:
        saved[row] = lines.states()
        row += 1
    if stop == start:
        return
    arguments = start, stop, saved[row:] if every else saved[:0], every, is_large, abandoned
    if not lines.take(*arguments):
        careful.compile()  # only now, because few runs need it
        lines.start_from(states)
        lines.take(*arguments, again=True)


field_steps = FieldSteps()
