"""Kahan's map of any quadratic field f (theory, section 7), lanes side by side.

x_next = x + eps A(x)**-1 f(x), where A(x) = 1 - (eps/2) f'(x). A field is a list of terms: with one
more component, x_D = 1, all are quadratic, and f_i is the sum of its v x_j x_k, j <= k. A step is a
list of operations, planned from the indices of the terms (`operations`), of which `generated` makes
machine code; where that is impossible NumPy carries it out. Where the increment cancels the state,
or elimination loses digits, a lane solves A(x) x_next = x + (eps/2) l x + eps c, where l and c are
the linear and constant parts. A step of order 4, 6 or 8 is several of these steps, of fractions of
eps.

arguments   a `Method`; values (1 or B, T); eps (1 or B,)
final       (B, D), the states that a run continues from
carry       (1, B), the first state beyond a step from det A < 0, 0 if there is none

States lie in lines of W lanes, x[line, component, lane]. After its end a trajectory has NaN.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from .careful import careful, solve_lane, step_carefully
from .codes import NONFINITE, OK, PASSED_POLE
from .generated import BUDGET, LINE, WIDTH, text_of_step, text_of_steps
from .llvm import call_code, with_address
from .machine_code import LARGE, MANY, call, code_of
from .numba import STREAM_FROM, Kernel, function
from .operations import Step, evaluate
from .pool import in_parts

CHUNK = 2**13  # trajectories whose states are in lines at once
SOLVED = 5 * 10**7  # nanoseconds of steps by `solve`, after which Python handles Ctrl-C
PLANS = 32  # patterns whose lists are remembered


class Method(NamedTuple):
    """A list of operations, and the fractions of eps of the steps by it that make one step."""

    step: Any
    fractions: tuple[float, ...]


@functools.lru_cache(PLANS)
def _step_of(places, D):
    return Step(np.frombuffer(places, np.int64).reshape(3, -1), D)


def method_of(indices, D, fractions=(1.0,)):
    """Return the method for fields with terms at these indices (3, T)."""
    step = _step_of(np.ascontiguousarray(indices, np.int64).tobytes(), D)
    return Method(step, fractions)


# -------------------------------------------------------------------------- steps in users' loops
@with_address
class FieldSystem(NamedTuple):
    """A field and a step size, for `compiled`; in another process the address is found anew."""

    address: int  # of `generated.text_of_step`, 0 if there is none
    half: Any  # (stages, T), half of the step size times the values of the terms
    table: Any  # (stages, n), what depends on them alone
    indices: Any  # (3, T)
    dimension: int

    def __reduce__(self):
        return system_of, (self.indices, self.half, self.dimension)


def system_of(indices, half, D):
    """Return the system of half the values of each stage (stages, T)."""
    step = method_of(indices, D).step
    table = np.ascontiguousarray(step.table_of(half.T).T)
    address = code_of(text_of_step, step) if 0 < len(step.usual) < LARGE else None
    return FieldSystem(address or 0, half, table, step.indices, D)


@function
def field_memory(system):
    """The memory of `field_step_of_one`."""
    D = system.dimension
    return np.empty((D, D + 1, 1)), np.empty((2, D)), np.empty((D,))


@function
def field_step_of_one(system, given, out, memory):
    """Write the state that follows `given` to `out`; return its status. For `compiled`."""
    of_step, units, x = memory
    status, passed = OK, False
    for i in range(len(x)):
        x[i] = given[i]
    for stage in range(len(system.half)):
        found = np.int64(1)
        if system.address != 0:
            found = call_code(system.address, (x.ctypes.data, system.table[stage].ctypes.data))
        negative = found == 2
        if found == 1:
            status, negative = solve_lane(system.indices, system.half[stage], x, of_step, units)
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
    """Return (B, n) as lines (-, n, W); lanes beyond the last repeat it."""
    beyond = -len(rows) % W
    padded = np.concatenate([rows, rows[-1:].repeat(beyond, axis=0)]) if beyond else rows
    return padded.reshape(len(padded) // W, W, rows.shape[1]).swapaxes(1, 2).copy()


def tables_of(method, values, eps, W):
    """Return half of eps times the values (lines, T, W), and the table of values that depend on
    them alone (stages, lines, n, W); or (1, T, 1) and (stages, 1, n, 1), if all have the same.
    """
    halves = 0.5 * eps[:, np.newaxis] * values
    if len(halves) == 1:
        return halves[:, :, np.newaxis], _common_table(*method, halves.tobytes())
    halves = in_lines(halves, W)
    fractions = np.array(method.fractions)[:, np.newaxis, np.newaxis]
    table = method.step.table_of(np.moveaxis(halves, 1, 0)[:, np.newaxis] * fractions)
    return halves, np.ascontiguousarray(np.moveaxis(table, 0, 2))


@functools.lru_cache(PLANS)  # for small calls
def _common_table(step, fractions, halves):
    """Return the table (stages, 1, n, 1) of one field, from the bytes of its halves."""
    table = step.table_of(np.outer(np.frombuffer(halves), fractions))
    return np.ascontiguousarray(table.T)[:, np.newaxis, :, np.newaxis]


def _packed(truths):
    """Return truth values (lines, W) as bits of lanes, for each line."""
    return np.packbits(truths, axis=1, bitorder="little")[:, 0]


class _Lines:
    """Trajectories in lines of W lanes, with all that their steps need.

    x         states (lines, D, W)
    for_each  True if lanes have parameters of their own
    marks     (2, lines), bits of lanes that have ended, or have passed a pole or ended; those
              beyond the last trajectory have
    notes     status, failed_at and the first state beyond a pole, of each trajectory
    """

    def __init__(self, arguments, states, notes, W):
        (self.method, *parameters), self.notes, self.W = arguments, notes, W
        self.B, self.count, self.D = len(states), -(-len(states) // W), states.shape[1]
        self.halves, self.table = tables_of(self.method, *parameters, W)
        self.for_each = self.halves.shape[2] > 1
        self.marks = np.zeros((2, self.count), np.uint8)
        self.put(states)

    def put(self, states):
        """Begin with these states, NaN where trajectories have ended."""
        self.x = in_lines(states, self.W)
        status, _, poles = self.notes
        if status.any() or self.count * self.W > self.B:
            ended = status < 0
            self.x.swapaxes(1, 2)[self._of_lanes(ended, False)] = np.nan
            self.marks[0] = _packed(self._of_lanes(ended, True))
            self.marks[1] = _packed(self._of_lanes(ended | (poles > 0.0), True))

    def _of_lanes(self, truths, beyond):
        """Return truth values (lines, W) of trajectories; `beyond` for lanes beyond the last."""
        padded = np.full(self.count * self.W, beyond)
        padded[: self.B] = truths
        return padded.reshape(self.count, self.W)

    def states(self):
        """Return the states (B, D)."""
        return self.x.swapaxes(1, 2).reshape(-1, self.D)[: self.B]

    def take(self, start, stop, saved, every, is_large, abandoned):
        """Take the steps from state `start` to state `stop`, and save the multiples of `every`.

        When something is in `abandoned`, nothing that follows is of use. Return False if some steps
        needed `careful`, which is not compiled: then all are to be taken again.
        """
        step, stages = self.method.step, len(self.method.fractions)
        align = _alignment(saved, self.W, is_large)
        if len(step.usual) > MANY:  # one code for runs that save states and for others
            align = 8
        address = code_of(text_of_steps, step, self.W, self.for_each, align) if step.usual else None
        until = every - start % every if every else 0
        rows = saved, until * stages - 1, every * stages - 1
        if address is None:
            self._take_in_numpy(start, (stop - start) * stages, *rows)
            return True
        job, _arrays = self._job(start, (stop - start) * stages, *rows)
        budget = max(SOLVED // (self.W * (self.D**3 + 200)), 1)
        while job[LINE] < self.count and not abandoned:
            job[BUDGET] = budget
            if not call(address, job):
                return False
        return True

    def _job(self, start, steps, saved, until, every):
        """Return the integers that machine code takes, see `generated`, and the arrays at them."""
        (step, fractions), D = self.method, self.D
        own = D * (D + 4) + step.T
        memory = np.empty(own + len(step.pieces[1]) * self.W)
        fractions = np.array(fractions)
        arrays = (
            self.x, self.table, saved, self.marks, memory,
            self.halves, fractions, step.indices, *self.notes,
        )  # fmt: skip
        x, table, rows, marks, work, *others = (each.ctypes.data for each in arrays)
        # Lines of a block stay in the first cache, and blocks are alike: a short one has to wait.
        blocks = -(-8 * self.x.size // 2**15)
        block = -(-self.count // min(blocks, -(-self.count // 4)))
        job = np.array([
            x, self.count, block, steps, table, self.table.strides[0], len(fractions),
            rows, saved.strides[0], until, every, self.B, marks, marks + self.count,
            careful.address if careful.is_compiled else 0, work + 8 * own,
            0, 0, 0, 0, until, rows,
            *others, work, self.W, D, step.T, start, self.for_each,
        ], np.int64)  # fmt: skip
        return job, arrays

    def _carry_out(self, n):
        """Carry out the operations of a step where they are accurate; return bits of these lanes,
        and of those from det A < 0.
        """
        step, shape = self.method.step, (self.count, self.W)
        values = dict(enumerate(self.x.swapaxes(0, 1)))
        table = self.table[n % len(self.table)].swapaxes(0, 1)
        values.update(zip(step.table, table, strict=True))
        evaluate(step.usual, values)
        evaluate(step.rare, values)
        accurate = np.broadcast_to(values[step.accurate], shape)
        for k, number in enumerate(step.after):
            self.x[:, k] = np.where(accurate, values[number], self.x[:, k])
        return _packed(accurate), _packed(np.broadcast_to(values[step.negative], shape))

    def _take_in_numpy(self, start, steps, saved, until, every):
        """Carry out the operations as NumPy does: the reference, where there is no machine code."""
        (step, fractions), (ended, passed), row = self.method, self.marks, 0
        memory = np.empty(self.D * (self.D + 4) + step.T)
        arrays = (
            self.x, self.halves, np.array(fractions), step.indices, *self.notes,
            ended, passed, memory,
        )  # fmt: skip
        for n in range(steps):
            good, negative = self._carry_out(n) if step.usual else (np.zeros_like(ended),) * 2
            bad = ~(good | ended) & np.uint8(2**self.W - 1)
            negative = negative & good & ~passed
            for line in np.flatnonzero(bad | negative):
                step_carefully(arrays, start, line, int(bad[line]), int(negative[line]), n)
            if n == until:
                saved[row] = self.states()
                row, until = row + 1, until + every + 1


def _alignment(saved, W, is_large):
    """Return the multiple of bytes at which lines of saved states begin, 0 if none are saved."""
    if not saved.size:
        return 0
    if not is_large or W == 1:
        return 8
    both = saved.ctypes.data | saved.strides[0]
    return next(size for size in (64, 16, 8) if both % size == 0)


class FieldSteps(Kernel):
    """The kernel of steps of fields, see `maps.Map`; it calls machine code of the field."""

    def __init__(self):
        self.py_func = self._take_part

    def __call__(self, part, parts, *arguments, abandoned=()):
        with np.errstate(all="ignore"):  # of NumPy's threads, each has its own
            self._take_part(part, parts, *arguments, abandoned)

    def serial(self, *arguments):
        self(0, 1, *arguments)

    def parallel(self, threads, *arguments):
        abandoned = []
        in_parts(
            threads, lambda part: self(part, threads, *arguments, abandoned=abandoned), abandoned
        )

    def _take_part(
        self,
        part,
        parts,
        arguments,
        omega0,
        carry,
        span,
        saved,
        final,
        status,
        failed_at,
        abandoned,
    ):
        """Iterate the trajectories of a part, as `steps_3d.steps`."""
        begin, end, *steps = span
        states = omega0 if steps[0] == 0 else final
        W = WIDTH if end - begin > 1 else 1
        lines = -(-(end - begin) // W)
        first, last = (begin + W * (lines * each // parts) for each in (part, part + 1))
        last = min(last, end)
        is_large = saved.size >= STREAM_FROM
        for low in range(first, last, CHUNK):
            some = slice(low, min(low + CHUNK, last))
            method, *parameters = arguments
            own = method, *(each[some] if len(each) > 1 else each for each in parameters)
            given, notes = states[some], (status[some], failed_at[some], carry[0, some])
            if steps[0] == 0:
                _begin(given, notes)
            lines = _Lines(own, given, notes, W)
            _take_steps(lines, given, steps, saved[:, some], is_large, abandoned)
            final[some] = lines.states()


def _begin(states, notes):
    """Note which trajectories begin with NaN."""
    status, failed_at, poles = notes
    poles[:] = 0.0
    if not np.isfinite(states.sum()):  # which takes a tenth of the time
        undefined = np.isnan(states).any(axis=1)
        status[undefined], failed_at[undefined] = NONFINITE, 0


def _take_steps(lines, states, steps, saved, is_large, abandoned):
    """Take the steps of a run that stands at these states, and save states."""
    start, stop, every, row = steps
    if every and start == 0:
        saved[row] = lines.states()
        row += 1
    if stop == start:
        return
    rest = start, stop, saved[row:] if every else saved[:0], every, is_large, abandoned
    if not lines.take(*rest):  # few runs need it, and most of those that do not are short
        careful.compile()
        lines.put(states)
        lines.take(*rest)


field_steps = FieldSteps()
